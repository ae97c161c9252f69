"""Base classes of all policies: observations in, joint targets out, for any number of robots."""

import math
from abc import ABC, abstractmethod
from typing import ClassVar, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.gait_cycle import Floats as Floats
from policies.gait_cycle import advance_phase, smoothstep
from policies.memory import allocate, copy_rows, initialize_state, is_allocated, per_robot, reset_rows
from quad_env.cli.command_line import UserError
from quad_env.config import TaskConfig
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.sensing.height_scan import HeightScan, table_with
from quad_env.task.observations import ObservationTerm, user_terms

Actions = NDArray[np.float32]
Mask = NDArray[np.bool_]

CONTROL_PERIOD = 1.0 / TaskConfig().control_rate
"""Default control period of the environment, s."""


class PolicyError(UserError, ValueError):
    """Error for a policy that does not exist or cannot be loaded; the message is one line.

    Args:
        fault: Cause of the error, the first part of the message.
        remedy: Advice to the user, the second part of the message; empty for none.
    """

    def __init__(self, fault: str, remedy: str = "") -> None:
        super().__init__(f"{fault}; {remedy}" if remedy else fault)
        self.fault = fault
        self.remedy = remedy


class PolicyKwargs(TypedDict, total=False):
    """Keyword arguments that all policies share; see `Policy`."""

    robot: str | Robot
    control_period: float


class Policy(ABC):
    """Batched controller with its own clock and state, for one robot and one control period.

    The actions of a robot depend only on the observations and resets of this robot. The batch size changes no bit of
    the actions.

    Args:
        robot: Robot or its name. The attribute `robot` of the policy has the servo gains that the policy needs. Make
            the environment with this attribute.
        control_period: Time between two calls of `act`, equal to `dt` of the environment, s.

    Raises:
        ValueError: The control period is not positive.
    """

    name: str
    height_scan: HeightScan | None = None
    """Height scan that the environment must have; None if the policy uses no height scan."""
    observations: tuple[str | ObservationTerm, ...] = ()
    """Extra observation terms that the environment must have, as in the option `observations` of `gym.make`."""
    stiff_servos: ClassVar[bool] = False
    """True if the policy uses the servo gains `stiff_servo` of the robot, because softer servos would sag too far."""

    def __init__(self, *, robot: str | Robot = SIMPLE_QUAD, control_period: float = CONTROL_PERIOD) -> None:
        if not 0.0 < control_period < math.inf:
            raise ValueError(f"control_period must be a time above 0 s, not {control_period}")
        self.robot = get_robot(robot).with_stiff_servos if self.stiff_servos else get_robot(robot)
        self.control_period = control_period
        self.num_envs = 1
        initialize_state(self)

    def mismatch(self, robot: Robot, control_period: float) -> str:
        """Describe the robot and control period of the policy if they differ from the given ones.

        Args:
            robot: Robot of the environment.
            control_period: Control period of the environment, s.

        Returns:
            Description; empty if neither differs.
        """
        if self.robot == robot and math.isclose(self.control_period, control_period):
            return ""
        own = f"made for {self.robot.name} with a control period of {self.control_period:g} s"
        return f"{own}, not for {robot.name} with one of {control_period:g} s"

    def check_compatible(self, robot: Robot, control_period: float) -> None:
        """Check that the policy was made for an environment.

        Args:
            robot: Robot of the environment, with its servo gains.
            control_period: Control period of the environment, s.

        Raises:
            ValueError: The policy was made for another robot, control period or servo. The message gives a remedy.
        """
        if mismatch := self.mismatch(robot, control_period):
            raise ValueError(
                f"{self.name} was {mismatch}: make it for its environment, "
                f'policies.make("{self.name}", robot=env.unwrapped.robot, control_period=env.unwrapped.dt)'
            )
        commanded, actual = ((each.servo_stiffness, each.servo_damping) for each in (self.robot, robot))
        if not np.array_equal(commanded, actual):
            raise ValueError(
                f"{self.name} commands servos of {self.robot.servo}, but the environment's have {robot.servo}: make it "
                "with robot=policy.robot"
            )

    def check_fits(self, robot: Robot, control_period: float) -> None:
        """Call `check_compatible(robot, control_period)`. Deprecated name."""
        self.check_compatible(robot, control_period)

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Reset the policy for a number of robots.

        Args:
            num_envs: Number of robots.
            seed: Seed for policies that draw random numbers. No policy of this project does.

        Raises:
            ValueError: The number is not positive.
        """
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, not {num_envs}")
        self.num_envs = num_envs
        self._allocate(num_envs)

    def reset_where(self, mask: ArrayLike) -> None:
        """Reset the robots where `mask`, (num_envs,) bool, is True; the other robots keep their state."""
        self._restart(validate_mask(np.asarray(mask), self.num_envs))

    def copy_state_from(self, mask: Mask, other: "Policy") -> None:
        """Copy the state of another policy to some robots of this policy.

        The method is for base policies of a residual. The state of policies inside a policy is not copied.

        Args:
            mask: Robots that receive a state, (n,) bool.
            other: Policy with the same constructor arguments, and one robot for each True in the mask.
        """
        copy_rows(self, validate_mask(mask, self.num_envs), other)

    def act(self, observation: ArrayLike) -> Actions:
        """Return the joint targets for an observation.

        Args:
            observation: Observation of n robots, (n, k), or of one, (k,).

        Returns:
            Joint targets within the limits, (n, 12) or (12,), float32, rad.
        """
        if not is_allocated(self):
            self._allocate(self.num_envs)
        batch, single = self._to_batch(observation)
        actions = self._act(batch)
        return actions[0] if single else actions

    def _to_batch(self, observation: ArrayLike) -> tuple[NDArray[np.float32], bool]:
        """Return the checked observation as (n, k), and True if it was given as (k,).

        Raises ValueError for another shape.
        """
        rows = np.asarray(observation, dtype=np.float32)
        single = rows.ndim == 1
        if single:
            rows = rows[None]
        table = table_with(self.robot, self.height_scan, user_terms(self.observations))
        if rows.shape != (self.num_envs, size := table.size):
            scan = "no height scan" if self.height_scan is None else f"the height scan {self.height_scan}"
            raise ValueError(
                f"observation must have shape ({self.num_envs}, {size}), not {np.shape(observation)}; "
                f"reset(num_envs=n) sets the number of robots, and {self.name} knows {scan}"
            )
        if not np.isfinite(rows).all():
            rows = self._replace_nonfinite(rows)
        return rows, single

    def _replace_nonfinite(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        """Replace values that are not finite in an observation, (n, k); here, raise ValueError instead."""
        raise ValueError("observation must be finite")

    @abstractmethod
    def _act(self, observation: NDArray[np.float32]) -> Actions:
        """Return the joint targets, (n, 12), rad, for a checked observation, (n, k)."""

    def _allocate(self, num_envs: int) -> None:
        """Allocate fresh state for `num_envs` robots, of the arrays declared with `per_robot`."""
        allocate(self, num_envs)

    def _reset_rows(self, mask: Mask) -> None:
        """Reset the state of the robots where `mask`, (n,), is true."""
        reset_rows(self, mask)

    def _restart(self, mask: Mask) -> None:
        """Call `_reset_rows`. Deprecated name, which policies of users may still override."""
        self._reset_rows(mask)


class GaitedPolicy(Policy):
    """Policy with a gait clock for each robot.

    A clock starts at phase 0 and advances by one step before each action, also before the first.
    """

    frequency: float
    """Frequency of the gait, Hz."""
    stiff_servos = True
    leg_offsets: tuple[float, ...]
    """Phase of each leg minus the phase of the clock, in the gait after a reset, rad."""
    _phase: Floats = per_robot(0.0)
    _ticks: Floats = per_robot(0.0)

    @property
    def phase(self) -> Floats:
        """Phase of the clocks at the latest action, (n,), in [0, 2π) rad."""
        return self._phase

    def _tick(self, faster: Floats | float = 0.0) -> None:
        """Advance the clocks by a control step; `faster`, (n,), Hz, is added to the frequency."""
        # Make a new array in each step, because callers may still hold the array that `phase` returned before.
        self._phase = advance_phase(self._phase, self.frequency + faster, self.control_period)
        self._ticks = self._ticks + 1.0

    def _blended(self, targets: Floats, duration: float) -> Floats:
        """Blend targets, (n, 12), rad, smoothly from the home pose over the first `duration` s of an episode."""
        share = np.minimum(self._ticks * (self.control_period / duration), 1.0)
        if share.min() >= 1.0:
            return targets
        weight = smoothstep(share)[:, None]
        # The formula also serves robots that have finished the blend: at weight 1 the home pose adds exactly zero.
        return weight * targets + (1.0 - weight) * self.robot.home_pose


def validate_mask(mask: ArrayLike | None, num_envs: int) -> Mask:
    """Validate a mask of robots.

    Args:
        mask: Mask, (num_envs,) bool; None for all robots.
        num_envs: Number of robots.

    Returns:
        The mask.

    Raises:
        ValueError: The mask has another shape or type.
    """
    rows = np.ones(num_envs, np.bool_) if mask is None else np.asarray(mask)
    if rows.dtype != np.bool_ or rows.shape != (num_envs,):
        raise ValueError(f"mask must be bool of shape ({num_envs},), not {rows.dtype} of {rows.shape}")
    return rows


def to_actions(robot: Robot, targets: Floats) -> Actions:
    """Convert joint targets to float32 actions, clipped to the joint limits as a real joint would be.

    The function adds zero, which turns -0.0 into 0.0. A residual that later adds a correction of zero changes no bit.

    Args:
        robot: Robot.
        targets: Joint targets, (n, 12), rad.

    Returns:
        Actions, (n, 12), rad.
    """
    return within_limits(robot, targets.astype(np.float32)) + np.float32(0.0)


def within_limits(robot: Robot, actions: Actions) -> Actions:
    """Clip `actions`, (n, 12), rad, to the joint limits of a `robot`."""
    lower = robot.joint_lower.astype(np.float32)
    upper = robot.joint_upper.astype(np.float32)
    return actions.clip(lower, upper)


def flat_joints(legs: Floats) -> Floats:
    """Reshape joint angles from (..., 4, 3) to (..., 12)."""
    return legs.reshape(*legs.shape[:-2], legs.shape[-2] * legs.shape[-1])
