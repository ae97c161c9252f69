"""Open-loop diagonal trot that follows a velocity command; the baseline of the benchmark.

Relative to the trunk, each stance foot moves with the velocity -(v + ω × r). Here v and ω are the commanded linear and
angular velocity, and r is the position of the foot relative to the trunk centre. This formula covers forward, lateral
and turning commands. Each swing phase moves the foot back. The trot does not use measurements, only the command.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Actions, GaitedPolicy, flat_joints, to_actions
from policies.gait_cycle import TROT_OFFSETS, Floats, Gait, LegCycle, map_command
from policies.legs.foot_path import load_fraction, stride_displacement, swing_lift
from policies.legs.kinematics import compensate_servo_load, leg_angles
from policies.memory import initialize_state, per_robot
from policies.parameters import CommandMap, ParameterFile, parameter, search_ranges_of
from quad_env import OBSERVATION
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import HIP_HEIGHT, LATERAL_LENGTH
from quad_env.robots.simple_quad import SIMPLE_QUAD


@dataclass(frozen=True)
class TrotParameters(CommandMap):
    """Parameters of the open-loop trot: gait, foot paths, servo compensation and limits of acceleration."""

    frequency: float = parameter(2.8, limits=(0.1, 50.0), search=(2.0, 3.1), unit="Hz")
    """Gait frequency: gait cycles per second, Hz."""
    duty: float = parameter(0.55, limits=(0.01, 0.99), search=(0.5, 0.65))
    """Duty factor: fraction of the gait cycle that a foot is on the ground."""
    body_height: float = parameter(0.47, limits=(0.01, 5.0), search=(0.45, 0.52), unit=HIP_HEIGHT)
    """Height of the hip joints above the centres of the stance feet, m."""
    step_height: float = parameter(0.07, limits=(-1.0, 1.0), search=(0.03, 0.14), unit="m")
    """Height of a swing foot above the stance feet at mid-swing, m."""
    stance_width: float = parameter(0.54, limits=(-10.0, 10.0), search=(0.4, 0.72), unit=LATERAL_LENGTH)
    """Lateral distance between the left and the right feet, m; at 0.5 the legs of SimpleQuad hang straight down."""
    stance_shift: float = parameter(-0.02, limits=(-1.0, 1.0), search=(-0.1, 0.05), unit="m ahead")
    """Forward position of the middle of the stride of each foot, relative to its hip joint, m."""
    servo_lead: float = parameter(0.01, limits=(-1.0, 1.0), search=(0.0, 0.05), unit="s")
    """Lead time of the joint targets, which compensates the lag of the servos, s.

    A joint target is the wanted angle plus the lead time times the rate of change of the wanted angle."""
    stance_load: float = parameter(50.0, limits=(-1e5, 1e5), search=(0.0, 90.0), unit="N")
    """Assumed largest force on a stance foot, for which the joint targets compensate the sag of the servos, N."""
    blend_time: float = parameter(0.3, limits=(1e-3, 100.0), unit="s")
    """Duration of the transition from the home pose to the gait at the start of an episode, s."""
    turn_lead: float = parameter(0.06, limits=(-10.0, 10.0), search=(0.0, 0.2), unit="s")
    """Lead time of the direction of motion in a curve, s.

    The direction in which the trunk moves lags behind the command. The gait therefore rotates the commanded direction
    of motion by the lead time times the yaw rate."""
    linear_acceleration: float = parameter(14.0, limits=(1e-3, 1e6), search=(2.0, 20.0), unit="m/s²")
    """Largest rate of change of the forward and the lateral velocity with which the gait follows a command, m/s²."""
    yaw_acceleration: float = parameter(16.0, limits=(1e-3, 1e6), search=(3.0, 40.0), unit="rad/s²")
    """Largest rate of change of the yaw rate with which the gait follows a command, rad/s²."""


SEARCH_RANGES = search_ranges_of(TrotParameters)
"""Parameter name -> (lower, upper) bound of the parameter search for the open-loop trot."""
# Parameter file of the open-loop trot, which the command `python -m train search trot` writes. This is a comment,
# because a docstring would add the constant to the API pages, with the path on the machine that builds them.
FILE = ParameterFile(Path(__file__).with_name("trot.json"), TrotParameters, "trot")


def searched_parameters(robot: Robot = SIMPLE_QUAD) -> TrotParameters:
    """Return the searched parameters of the open-loop trot for a `robot`.

    The parameters of SimpleQuad are scaled to the robot if it has no parameter file of its own, see
    `ParameterFile.load_for_robot`.
    """
    return FILE.load_for_robot(robot)


class Trot(GaitedPolicy):
    """Open-loop trot that follows a velocity command. The robot steps in place if the command is zero.

    Args:
        parameters: Parameters of the gait; None for the result of `searched_parameters`.
        robot: Robot that trots, or its name.
        control_period: Time between two control steps, s.
    """

    name = "trot"
    _command: Floats = per_robot(np.zeros(3))
    """Velocity command (forward, lateral, yaw rate) after the limits of acceleration, (n, 3), m/s and rad/s."""
    _joints: Floats = per_robot()
    """Joint targets of the last control step, before `servo_lead` corrects them for the servo lag, (n, 12), rad."""

    def __init__(
        self,
        parameters: TrotParameters | None = None,
        *,
        robot: str | Robot = SIMPLE_QUAD,
        control_period: float = CONTROL_PERIOD,
    ) -> None:
        super().__init__(robot=robot, control_period=control_period)
        self.parameters = parameters if parameters is not None else self._searched()
        self.frequency = self.parameters.frequency
        self.leg_offsets = self.robot.in_leg_order(TROT_OFFSETS)
        self._gait = Gait(self.leg_offsets, self.parameters.duty)
        initialize_state(self, _joints=self.robot.home_pose)

    def _searched(self) -> TrotParameters:
        """Return the default parameters of the policy for its robot, which a parameter search has found."""
        return searched_parameters(self.robot)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self._tick()
        self._follow(observation[:, OBSERVATION["command"]].astype(np.float64))
        joints = self._blended(
            self._targets(self._phase, self._gait_velocity(self._command)), self.parameters.blend_time
        )
        velocity = (joints - self._joints) / self.control_period
        self._joints = joints
        return to_actions(self.robot, joints + self.parameters.servo_lead * velocity)

    def _follow(self, command: Floats) -> None:
        """Move the velocity command of the gait towards the observed one, with limited acceleration.

        `command`, (n, 3), m/s and rad/s, is the observed command (forward, lateral, yaw rate).
        """
        p = self.parameters
        reach = self.control_period * np.array([p.linear_acceleration, p.linear_acceleration, p.yaw_acceleration])
        self._command = self._command + np.clip(command - self._command, -reach, reach)

    def _gait_velocity(self, command: Floats) -> Floats:
        """Return the velocity input of the gait with which the robot moves at the commanded velocity.

        `command` and the result are forward velocity, lateral velocity and yaw rate, (n, 3), m/s and rad/s.
        """
        p = self.parameters
        yaw_rate = command[:, 2]
        forward = command[:, 0] - p.turn_lead * yaw_rate * command[:, 1]
        lateral = command[:, 1] + p.turn_lead * yaw_rate * command[:, 0]
        return np.stack(map_command(p, forward, lateral, yaw_rate), axis=-1)

    def _targets(self, phase: Floats, velocity: Floats) -> Floats:
        """Return the joint targets of the gait, (n, 12), rad.

        `phase`, (n,), rad, is the phase of the gait clock. `velocity`, (n, 3), m/s and rad/s, is the velocity input of
        the gait (forward, lateral, yaw rate).
        """
        robot = self.robot
        cycle = self._gait.legs(phase)
        x, y = self._foot_positions(cycle, velocity)
        z = self.parameters.step_height * swing_lift(cycle) - self.parameters.body_height
        hip, thigh, calf = leg_angles(robot, x, y, z)
        force = load_fraction(cycle) * self.parameters.stance_load
        return flat_joints(np.stack(compensate_servo_load(robot, hip, thigh, calf, x, y, force), axis=-1))

    def _foot_positions(self, cycle: LegCycle, velocity: Floats) -> tuple[Floats, Floats]:
        """Return the forward and the lateral coordinates of the feet relative to the hip joints, (n, 4), m.

        `velocity`, (n, 3), m/s and rad/s, is the velocity input of the gait (forward, lateral, yaw rate).
        """
        p = self.parameters
        foot_x = self.robot.hip_positions[:, 0] + p.stance_shift
        foot_y = self.robot.side * (p.stance_width / 2.0)
        forward, lateral, yaw_rate = np.split(velocity, 3, axis=1)
        # Relative to the trunk, a stance foot moves at -(v + ω × r), because the foot stands still on the ground.
        stance_time = p.duty / p.frequency
        along = stride_displacement(cycle, p.duty) * stance_time
        x = p.stance_shift + along * (forward - yaw_rate * foot_y)
        y = (foot_y - self.robot.hip_positions[:, 1]) + along * (lateral + yaw_rate * foot_x)
        return x, y
