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
LARGEST_TILT = 0.1
"""rad. Largest tilt of the trunk of a robot that stands."""
LARGEST_SINK = 0.2
"""Largest sink of a robot that stands, as a share of its height."""
LARGEST_LAG = 0.1
"""rad. Largest distance of a joint from its target under the robot's weight."""
FULL_LOAD = 0.95
"""Share of the rated torque above which a joint has no reserve."""
RINGING = 1.0
"""rad/s. Root mean square of all joint speeds at rest in the squat; at most 0.3 for a robot by name."""
SETTLED = 0.5
"""s. Time to come to rest in the squat."""
LAST = 0.2
"""s. Length of the window at the end that is measured."""
SQUAT = 0.1
"""rad. Step of the thighs' targets; the calves' step is half of it."""


class DivergedError(ValueError):
    """The simulation of a robot has diverged."""


@dataclass(frozen=True)
class Stance:
    """Result of a stance test: home pose, then a squat."""

    robot: Robot
    diverged: bool = False
    height: float = math.nan
    """Height of the trunk's origin, m."""
    tilt: float = math.nan
    """Tilt of the trunk, rad."""
    lags: NDArray[np.float64] | None = None
    """Joint errors from the targets, (12,), rad."""
    torque: float = math.nan
    """Largest torque of a joint at rest, N·m."""
    ringing: float = math.nan
    """Root mean square of the joint speeds after the squat, rad/s."""

    @property
    def lag(self) -> float:
        """Largest distance of a joint from its target, rad."""
        return math.nan if self.lags is None else float(self.lags.max())

    @property
    def is_overloaded(self) -> bool:
        """Return whether a joint has no reserve of torque."""
        return self.torque > FULL_LOAD * self.robot.rated_torque

    @property
    def fault(self) -> str | None:
        """Fault of the stance in words; None for a robot that stands. Numbers that are not finite are a fault."""
        robot = self.robot
        if self.diverged or not np.isfinite((self.height, self.tilt, self.lag, self.torque, self.ringing)).all():
            return "the simulation diverges: no finite state"
        if self.is_overloaded:
            return f"standing takes all of the joints' {robot.rated_torque:g} N·m, for {robot.mass:.3g} kg"
        if self.lag > LARGEST_LAG:
            return self.tracking_text
        if self.ringing > RINGING:
            return f"half a second after a step of their targets the joints still move at {self.ringing:.1f} rad/s"
        if self.tilt > LARGEST_TILT or self.height < (1.0 - LARGEST_SINK) * robot.home_height:
            return f"it does not stand: {self.trunk_text}"
        return None

    @property
    def tracking_text(self) -> str:
        """Tracking of the joint targets, in words."""
        assert self.lags is not None
        return f"standing, {self.robot.joint_names[int(self.lags.argmax())]} is {self.lag:.3f} rad off its target"

    @property
    def trunk_text(self) -> str:
        """Pose of the trunk, in words."""
        return f"its trunk is {self.height:.3f} m high and tilted by {self.tilt:.3f} rad"


def measure_stance(env: Any) -> Stance:
    """Reset a single environment, let its robot stand and squat, and return the result."""
    robot = env.robot
    env.reset(seed=0, options={"command": np.zeros(3)})
    try:
        at_rest = hold_target(env, robot.home_pose, STAND_TIME)[-round(LAST / env.dt) :]
        ringing = _ringing(env)
    except DivergedError:
        return Stance(robot, diverged=True)
    return Stance(
        robot,
        height=float(at_rest[-1].height),
        tilt=math.acos(min(max(at_rest[-1].rotation[2][2], -1.0), 1.0)),
        lags=np.abs(np.mean([state.joint_position - robot.home_pose for state in at_rest], axis=0)),
        torque=float(np.abs(np.mean([state.joint_torque for state in at_rest], axis=0)).max()),
        ringing=ringing,
    )


def _ringing(env: Any) -> float:
    """Return the root mean square of all joint speeds at the end of a squat, rad/s."""
    robot = env.robot
    step = SQUAT * np.array([[0.0, -knee, 2.0 * knee] for knee in robot.knee_direction]).ravel()
    squatting = hold_target(env, robot.home_pose + step, SETTLED)[-round(LAST / env.dt) :]
    return float(np.sqrt(np.mean(np.square([state.joint_velocity for state in squatting]))))


def hold_target(env: Any, target: NDArray[np.float64], seconds: float) -> list[Any]:
    """Return the states of the robot of a single environment while it holds a target.

    Args:
        env: The environment.
        target: Joint angles, (12,), rad.
        seconds: Time, s.

    Raises:
        DivergedError: The simulation diverges.
    """
    found = []
    for _ in range(round(seconds / env.dt)):
        *_, info = env.step(target.astype(np.float32))
        if info["diverged"]:
            raise DivergedError(f"{env.robot.name}: the simulation diverges in the home pose")
        found.append(env.simulation.state((0.0, 0.0, 0.0), None))
    return found


def make_standing_env(robot: Robot) -> SimpleQuadEnv:
    """Make a single environment with a robot, falls ignored."""
    return SimpleQuadEnv(robot=robot, terminate_on_fall=False)
