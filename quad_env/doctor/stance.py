"""Stance test: a simulated robot holds its home pose for two seconds and squats; the test measures both."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.envs.env import SimpleQuadEnv
from quad_env.robots.robot import Robot

STAND_TIME = 2.0
"""Duration of the first part of the stance test, in which the robot holds its home pose, s."""


@dataclass(frozen=True)
class StanceLimits:
    """Largest valid measurements of the stance test; a robot that exceeds one of these limits does not stand."""

    tilt: float = 0.1
    """Largest valid angle between the trunk's z axis and the vertical in the home pose, rad."""
    sink: float = 0.2
    """Largest valid loss of the trunk's height under the robot's weight, as a fraction of its home height."""
    tracking_error: float = 0.1
    """Largest valid difference between a joint angle and its target under the robot's weight, rad."""
    torque: float = 0.95
    """Largest valid joint torque in the home pose, as a fraction of the rated torque.

    A joint with a larger torque has no reserve for motion.
    """
    joint_speed: float = 1.0
    """Largest valid root mean square of all joint speeds at the end of the squat, rad/s.

    For the robots in `quad_env.ROBOTS`, the measured value is at most 0.3 rad/s.
    """


LIMITS = StanceLimits()
"""Largest measurements with which a robot passes the stance test, that is, stands in simulation."""
SETTLING_TIME = 0.5
"""Duration of the squat in the stance test, s; a robot that stands comes to rest within this time."""
MEASURED_TIME = 0.2
"""Duration over which the stance test averages its measurements, s.

The test averages over the last part of the time in which the robot holds its home pose, and over the last part of the
squat.
"""
SQUAT_STEP = 0.1
"""Change of the thigh joint targets with which the squat of the stance test starts, rad.

The change of the calf joint targets is twice as large.
"""


class DivergedError(ValueError):
    """Error that is raised when the simulated state of a robot becomes infinite or NaN in the stance test."""


@dataclass(frozen=True)
class Stance:
    """Measurements of the stance test of one robot; made by `measure_stance`.

    All measured numbers are NaN if the simulation has diverged, that is, its state has become infinite or NaN.
    """

    robot: Robot
    """The tested robot."""
    diverged: bool = False
    """True if the simulated state has become infinite or NaN."""
    height: float = math.nan
    """Height of the trunk above the ground after two seconds in the home pose, m."""
    tilt: float = math.nan
    """Angle between the trunk's z axis and the vertical after two seconds in the home pose, rad."""
    tracking_errors: NDArray[np.float64] | None = None
    """Absolute difference between each joint angle and its target in the home pose, (12,), rad.

    The attribute is None if the simulation has diverged.
    """
    torque: float = math.nan
    """Largest joint torque in the home pose, N·m: magnitude of the mean over time of each joint's torque."""
    joint_speed: float = math.nan
    """Root mean square of all joint speeds at the end of the squat, rad/s."""

    @property
    def tracking_error(self) -> float:
        """Largest difference between a joint angle and its target in the home pose, rad.

        It is NaN if the simulation has diverged.
        """
        return math.nan if self.tracking_errors is None else float(self.tracking_errors.max())

    @property
    def is_overloaded(self) -> bool:
        """True if the torque of a joint in the home pose exceeds the limit `StanceLimits.torque`.

        A joint that needs almost its rated torque to stand has no reserve for motion.
        """
        return self.torque > LIMITS.torque * self.robot.rated_torque

    @property
    def fault(self) -> str | None:
        """Text about the first limit in `LIMITS` that the robot exceeds; None if the robot stands.

        An infinite or NaN measurement counts as a fault, too.
        """
        robot = self.robot
        values = (self.height, self.tilt, self.tracking_error, self.torque, self.joint_speed)
        if self.diverged or not np.isfinite(values).all():
            return "the simulation diverges: no finite state"
        if self.is_overloaded:
            return f"standing takes all of the joints' {robot.rated_torque:g} N·m, for {robot.mass:.3g} kg"
        if self.tracking_error > LIMITS.tracking_error:
            return self.tracking_text
        if self.joint_speed > LIMITS.joint_speed:
            return f"half a second after a step of their targets the joints still move at {self.joint_speed:.1f} rad/s"
        if self.tilt > LIMITS.tilt or self.height < (1.0 - LIMITS.sink) * robot.home_height:
            return f"it does not stand: {self.trunk_text}"
        return None

    @property
    def tracking_text(self) -> str:
        """Text about the joint that is farthest from its target in the home pose, in rad."""
        assert self.tracking_errors is not None
        worst = self.robot.joint_names[int(self.tracking_errors.argmax())]
        return f"standing, {worst} is {self.tracking_error:.3f} rad off its target"

    @property
    def trunk_text(self) -> str:
        """Text about the height, m, and the tilt, rad, of the trunk in the home pose."""
        return f"its trunk is {self.height:.3f} m high and tilted by {self.tilt:.3f} rad"


def measure_stance(env: Any) -> Stance:
    """Run the stance test of the robot in an environment of one robot, and return the measurements.

    The environment `env` is reset first, with the zero command.
    """
    robot = env.robot
    env.reset(seed=0, options={"command": np.zeros(3)})
    try:
        at_rest = hold_target(env, robot.home_pose, STAND_TIME)[-round(MEASURED_TIME / env.dt) :]
        joint_speed = _joint_speed_after_squat(env)
    except DivergedError:
        return Stance(robot, diverged=True)
    return Stance(
        robot,
        height=float(at_rest[-1].height),
        tilt=math.acos(min(max(at_rest[-1].rotation[2][2], -1.0), 1.0)),
        tracking_errors=np.abs(np.mean([state.joint_position - robot.home_pose for state in at_rest], axis=0)),
        torque=float(np.abs(np.mean([state.joint_torque for state in at_rest], axis=0)).max()),
        joint_speed=joint_speed,
    )


def _joint_speed_after_squat(env: Any) -> float:
    """Run the squat of the stance test in `env`; return the RMS of all joint speeds at its end, rad/s."""
    robot = env.robot
    step = SQUAT_STEP * np.array([[0.0, -knee, 2.0 * knee] for knee in robot.knee_direction]).ravel()
    squatting = hold_target(env, robot.home_pose + step, SETTLING_TIME)[-round(MEASURED_TIME / env.dt) :]
    return float(np.sqrt(np.mean(np.square([state.joint_velocity for state in squatting]))))


def hold_target(env: Any, target: NDArray[np.float64], seconds: float) -> list[Any]:
    """Simulate a robot with constant joint targets, and return its states.

    Args:
        env: Environment of one robot.
        target: Target joint angles, (12,), rad.
        seconds: Simulated time, s.

    Returns:
        State of the robot after each control step, as a list of `QuadState`.

    Raises:
        DivergedError: The simulation has diverged.
    """
    states = []
    for _ in range(round(seconds / env.dt)):
        *_, info = env.step(target.astype(np.float32))
        if info["diverged"]:
            raise DivergedError(f"{env.robot.name}: the simulation diverges in the home pose")
        states.append(env.simulation.state((0.0, 0.0, 0.0), None))
    return states


def make_standing_env(robot: Robot) -> SimpleQuadEnv:
    """Make an environment of one robot for the stance test; a fall does not end the episode."""
    return SimpleQuadEnv(robot=robot, terminate_on_fall=False)
