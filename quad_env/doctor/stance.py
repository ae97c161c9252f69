"""Stance test: a robot holds its home pose for two seconds, and then squats."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.envs.env import SimpleQuadEnv
from quad_env.robots.robot import Robot

STAND_TIME = 2.0
"""s. Duration of the hold of the home pose."""


@dataclass(frozen=True)
class StanceLimits:
    """Limits of the stance test."""

    tilt: float = 0.1
    """rad. Largest tilt of the trunk."""
    sink: float = 0.2
    """Largest sink of the trunk, as a share of its height in the home pose."""
    tracking_error: float = 0.1
    """rad. Largest distance of a joint from its target under the robot's weight."""
    torque: float = 0.95
    """Share of the rated torque above which a joint has no reserve."""
    joint_speed: float = 1.0
    """rad/s. Root mean square of all joint speeds at rest in the squat; at most 0.3 for a robot by name."""


LIMITS = StanceLimits()
SETTLING_TIME = 0.5
"""s. Time to come to rest in the squat."""
MEASURED_TIME = 0.2
"""s. Length of the measured window at the end."""
SQUAT_STEP = 0.1
"""rad. Step of the thighs' targets; the calves' step is twice as large."""


class DivergedError(ValueError):
    """The simulation of a robot has diverged."""


@dataclass(frozen=True)
class Stance:
    """Result of a stance test, home pose and then a squat; made by `measure_stance`."""

    robot: Robot
    diverged: bool = False
    height: float = math.nan
    """Height of the trunk's origin, m."""
    tilt: float = math.nan
    """Tilt of the trunk, rad."""
    tracking_errors: NDArray[np.float64] | None = None
    """Mean distances of the joints from their targets, (12,), rad."""
    torque: float = math.nan
    """Largest torque of a joint at rest, N·m."""
    joint_speed: float = math.nan
    """Root mean square of the joint speeds after the squat, rad/s."""

    @property
    def tracking_error(self) -> float:
        """Largest distance of a joint from its target, rad."""
        return math.nan if self.tracking_errors is None else float(self.tracking_errors.max())

    @property
    def is_overloaded(self) -> bool:
        """True if a joint has no reserve of torque."""
        return self.torque > LIMITS.torque * self.robot.rated_torque

    @property
    def fault(self) -> str | None:
        """Fault of the stance in words; None for a robot that stands. Numbers that are not finite are a fault."""
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
        """Tracking of the joint targets, in words."""
        assert self.tracking_errors is not None
        worst = self.robot.joint_names[int(self.tracking_errors.argmax())]
        return f"standing, {worst} is {self.tracking_error:.3f} rad off its target"

    @property
    def trunk_text(self) -> str:
        """Pose of the trunk, in words."""
        return f"its trunk is {self.height:.3f} m high and tilted by {self.tilt:.3f} rad"


def measure_stance(env: Any) -> Stance:
    """Reset the single environment `env`, let its robot stand and squat, and return the result."""
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
    """Return the root mean square of all joint speeds at the end of a squat, rad/s."""
    robot = env.robot
    step = SQUAT_STEP * np.array([[0.0, -knee, 2.0 * knee] for knee in robot.knee_direction]).ravel()
    squatting = hold_target(env, robot.home_pose + step, SETTLING_TIME)[-round(MEASURED_TIME / env.dt) :]
    return float(np.sqrt(np.mean(np.square([state.joint_velocity for state in squatting]))))


def hold_target(env: Any, target: NDArray[np.float64], seconds: float) -> list[Any]:
    """Return the states of the robot of a single environment while it holds a target.

    Args:
        env: The environment.
        target: Joint angles, (12,), rad.
        seconds: Time, s.

    Returns:
        State after each control step.

    Raises:
        DivergedError: The simulation diverges.
    """
    states = []
    for _ in range(round(seconds / env.dt)):
        *_, info = env.step(target.astype(np.float32))
        if info["diverged"]:
            raise DivergedError(f"{env.robot.name}: the simulation diverges in the home pose")
        states.append(env.simulation.state((0.0, 0.0, 0.0), None))
    return states


def make_standing_env(robot: Robot) -> SimpleQuadEnv:
    """Make a single environment with a robot that ignores falls."""
    return SimpleQuadEnv(robot=robot, terminate_on_fall=False)
