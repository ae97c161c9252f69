"""Stance test: a simulated robot holds its home pose for two seconds and then squats."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.envs.env import SimpleQuadEnv
from quad_env.robots.robot import Robot

STAND_TIME = 2.0
"""Time for which the robot holds its home pose, s."""


@dataclass(frozen=True)
class StanceLimits:
    """Limits of the stance test; a robot that exceeds one of them does not stand."""

    tilt: float = 0.1
    """Largest tilt of the trunk, rad."""
    sink: float = 0.2
    """Largest sink of the trunk, as a fraction of its height in the home pose."""
    tracking_error: float = 0.1
    """Largest distance of a joint from its target under the robot's weight, rad."""
    torque: float = 0.95
    """Largest joint torque at rest, as a fraction of the rated torque; a joint above it has no reserve."""
    joint_speed: float = 1.0
    """Largest root mean square of all joint speeds after the squat, rad/s; named robots have at most 0.3."""


LIMITS = StanceLimits()
SETTLING_TIME = 0.5
"""Duration of the squat, s; the robot has to come to rest in this time."""
MEASURED_TIME = 0.2
"""Duration of the measurement at the end of the home pose and of the squat, s."""
SQUAT_STEP = 0.1
"""Step of the thigh targets at the start of the squat, rad; the step of the calf targets is twice as large."""


class DivergedError(ValueError):
    """Error that the simulation of a robot has diverged."""


@dataclass(frozen=True)
class Stance:
    """Result of the stance test; made by `measure_stance`. Numbers are NaN if the simulation has diverged."""

    robot: Robot
    """The tested robot."""
    diverged: bool = False
    """True if the simulation has diverged."""
    height: float = math.nan
    """Height of the trunk's origin at the end of the home pose, m."""
    tilt: float = math.nan
    """Tilt of the trunk at the end of the home pose, rad."""
    tracking_errors: NDArray[np.float64] | None = None
    """Distance of each joint from its target in the home pose, (12,), rad; None if the simulation has diverged."""
    torque: float = math.nan
    """Largest mean torque of a joint in the home pose, N·m."""
    joint_speed: float = math.nan
    """Root mean square of all joint speeds at the end of the squat, rad/s."""

    @property
    def tracking_error(self) -> float:
        """Largest distance of a joint from its target, rad; NaN if the simulation has diverged."""
        return math.nan if self.tracking_errors is None else float(self.tracking_errors.max())

    @property
    def is_overloaded(self) -> bool:
        """True if the torque of a joint is above the limit, so that the joint has no reserve."""
        return self.torque > LIMITS.torque * self.robot.rated_torque

    @property
    def fault(self) -> str | None:
        """Description of the first fault; None if the robot stands. A number that is not finite is a fault."""
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
        """Text about the joint that is farthest from its target."""
        assert self.tracking_errors is not None
        worst = self.robot.joint_names[int(self.tracking_errors.argmax())]
        return f"standing, {worst} is {self.tracking_error:.3f} rad off its target"

    @property
    def trunk_text(self) -> str:
        """Text about height and tilt of the trunk."""
        return f"its trunk is {self.height:.3f} m high and tilted by {self.tilt:.3f} rad"


def measure_stance(env: Any) -> Stance:
    """Run the stance test in the single environment `env`, which is reset first, and return the result."""
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
    """Let the robot squat; return the root mean square of its joint speeds at the end, rad/s."""
    robot = env.robot
    step = SQUAT_STEP * np.array([[0.0, -knee, 2.0 * knee] for knee in robot.knee_direction]).ravel()
    squatting = hold_target(env, robot.home_pose + step, SETTLING_TIME)[-round(MEASURED_TIME / env.dt) :]
    return float(np.sqrt(np.mean(np.square([state.joint_velocity for state in squatting]))))


def hold_target(env: Any, target: NDArray[np.float64], seconds: float) -> list[Any]:
    """Simulate a robot while its joints hold a target.

    Args:
        env: Single environment with the robot.
        target: Target joint angles, (12,), rad.
        seconds: Simulated time, s.

    Returns:
        State of the robot after each control step.

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
    """Make a single environment with a robot; it does not end at a fall."""
    return SimpleQuadEnv(robot=robot, terminate_on_fall=False)
