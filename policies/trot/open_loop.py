"""A diagonal trot that follows a velocity command: the baseline, and the base of the residual.

Each standing foot moves against the velocity that the body is to have at that foot, -(v + ω × r), so that forward,
lateral and turning commands are one formula; each swing brings it back. It looks at nothing but the command.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Actions, GaitedPolicy, flat_joints, to_actions
from policies.gait_cycle import TROT_OFFSETS, Floats, Gait, map_command
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
    """What the search tunes."""

    frequency: float = parameter(2.8, limits=(0.1, 50.0), search=(2.0, 3.1), unit="Hz")
    """Gait cycles a second, Hz."""
    duty: float = parameter(0.55, limits=(0.01, 0.99), search=(0.5, 0.65))
    """Share of the cycle that a foot is on the ground."""
    body_height: float = parameter(0.47, limits=(0.01, 5.0), search=(0.45, 0.52), unit=HIP_HEIGHT)
    """Hip joints above the centres of the standing feet, m."""
    step_height: float = parameter(0.07, limits=(-1.0, 1.0), search=(0.03, 0.14), unit="m")
    """Lift of the foot at mid-swing, m."""
    stance_width: float = parameter(0.54, limits=(-10.0, 10.0), search=(0.4, 0.72), unit=LATERAL_LENGTH)
    """Between the left and the right feet's lines, m; 0.5 has the legs hang straight down."""
    stance_shift: float = parameter(-0.02, limits=(-1.0, 1.0), search=(-0.1, 0.05), unit="m ahead")
    """Middle of the strides ahead of the hip joints, m."""
    servo_lead: float = parameter(0.01, limits=(-1.0, 1.0), search=(0.0, 0.05), unit="s")
    """How far the targets run ahead of the path along its tangent, s: makes up for the lag of the joint servo."""
    stance_load: float = parameter(50.0, limits=(-1e5, 1e5), search=(0.0, 90.0), unit="N")
    """Ground force on a standing foot whose give in the joint servos the targets make up for, N."""
    blend_time: float = parameter(0.3, limits=(1e-3, 100.0), unit="s")
    """From the home pose to the gait at the start of an episode, s."""
    turn_lead: float = parameter(0.06, limits=(-10.0, 10.0), search=(0.0, 0.2), unit="s")
    """How far ahead the gait's velocity is turned at the commanded yaw rate, s: in a curve the body lags behind."""
    linear_acceleration: float = parameter(14.0, limits=(1e-3, 1e6), search=(2.0, 20.0), unit="m/s²")
    """Fastest change of the forward and of the lateral command that the gait follows, m/s²."""
    yaw_acceleration: float = parameter(16.0, limits=(1e-3, 1e6), search=(3.0, 40.0), unit="rad/s²")
    """Fastest change of the yaw rate command that the gait follows, rad/s²."""


SEARCH_RANGES = search_ranges_of(TrotParameters)
FILE = ParameterFile(Path(__file__).with_name("trot.json"), TrotParameters, "trot")


def searched_parameters(robot: Robot = SIMPLE_QUAD) -> TrotParameters:
    """The robot's parameters, see `ParameterFile.in_force`."""
    return FILE.load_for_robot(robot)


class Trot(GaitedPolicy):
    """Command-following trot; steps in place at zero command."""

    name = "trot"
    _command: Floats = per_robot(np.zeros(3))
    _joints: Floats = per_robot()

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
        """Move the command that the gait follows towards the one given, no faster than its limits."""
        p = self.parameters
        reach = self.control_period * np.array([p.linear_acceleration, p.linear_acceleration, p.yaw_acceleration])
        self._command = self._command + np.clip(command - self._command, -reach, reach)

    def _gait_velocity(self, command: Floats) -> Floats:
        """The velocity to ask of the gait so that the robot achieves the commanded one; shape (n, 3)."""
        p = self.parameters
        yaw_rate = command[:, 2]
        forward = command[:, 0] - p.turn_lead * yaw_rate * command[:, 1]
        lateral = command[:, 1] + p.turn_lead * yaw_rate * command[:, 0]
        return np.stack(map_command(p, forward, lateral, yaw_rate), axis=-1)

    def _targets(self, phase: Floats, velocity: Floats) -> Floats:
        """Joint targets (n, 12) in rad for a phase (n,) and a gait velocity (n, 3)."""
        p, robot = self.parameters, self.robot
        cycle = self._gait.legs(phase)
        foot_x = robot.hip_positions[:, 0] + p.stance_shift
        foot_y = robot.side * (p.stance_width / 2.0)
        forward, lateral, yaw_rate = velocity[:, 0:1], velocity[:, 1:2], velocity[:, 2:3]
        # While a foot stands it passes under the body at -(v + ω × r), r from the trunk's centre to the foot.
        stance_time = p.duty / p.frequency
        along = stride_displacement(cycle, p.duty) * stance_time
        x = p.stance_shift + along * (forward - yaw_rate * foot_y)
        y = (foot_y - robot.hip_positions[:, 1]) + along * (lateral + yaw_rate * foot_x)
        z = p.step_height * swing_lift(cycle) - p.body_height
        hip, thigh, calf = leg_angles(robot, x, y, z)
        force = load_fraction(cycle) * p.stance_load
        return flat_joints(np.stack(compensate_servo_load(robot, hip, thigh, calf, x, y, force), axis=-1))
