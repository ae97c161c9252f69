"""What every policy is: observation in, joint targets out, for any number of robots at once."""

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
"""The environment's default control period, s."""


class PolicyError(UserError, ValueError):
    """A policy that does not exist or cannot be loaded; the message is one line: the fault, then the remedy."""

    def __init__(self, fault: str, remedy: str = "") -> None:
        super().__init__(f"{fault}; {remedy}" if remedy else fault)
        self.fault, self.remedy = fault, remedy


class PolicyKwargs(TypedDict, total=False):
    """Arguments that all policies share; see `Policy`."""

    robot: str | Robot
    control_period: float


class Policy(ABC):
    """A batched controller with its own clock and state, made for one robot and one control period.

    One row's actions depend on that row's observations and resets alone: the same bits in any batch.

    Args:
        robot: whose joints it moves; a `quad_env.Robot`, or what `policies.make` takes for one, such as "go1". The
            policy's `robot` has the servo gains that the policy commands: its environment is to be made with it.
        control_period: time between two calls of `act`, s: an environment's `dt`.
    """

    name: str
    height_scan: HeightScan | None = None
    """The scan that its environment is to have; None: it is shown none."""
    observations: tuple[str | ObservationTerm, ...] = ()
    """Further observation terms that its environment is to have, as the option `observations` of `gym.make`."""
    stiff_servos: ClassVar[bool] = False
    """Whether it commands the robot's `stiff_servo`, since softer servos would yield too far under its targets."""

    def __init__(self, *, robot: str | Robot = SIMPLE_QUAD, control_period: float = CONTROL_PERIOD) -> None:
        if not 0.0 < control_period < math.inf:
            raise ValueError(f"control_period must be a time above 0 s, not {control_period}")
        self.robot = get_robot(robot).with_stiff_servos if self.stiff_servos else get_robot(robot)
        self.control_period = control_period
        self.num_envs = 1
        initialize_state(self)

    def mismatch(self, robot: Robot, control_period: float) -> str:
        """What else than that robot and that control period, s, it was made for, in words; empty if for these."""
        if self.robot == robot and math.isclose(self.control_period, control_period):
            return ""
        own = f"made for {self.robot.name} with a control period of {self.control_period:g} s"
        return f"{own}, not for {robot.name} with one of {control_period:g} s"

    def check_compatible(self, robot: Robot, control_period: float) -> None:
        """Raise ValueError, which names the remedy, unless it was made for that robot, its servo gains and that control
        period, s."""
        if mismatch := self.mismatch(robot, control_period):
            raise ValueError(
                f"{self.name} was {mismatch}: make it for its environment, "
                f'policies.make("{self.name}", robot=env.unwrapped.robot, control_period=env.unwrapped.dt)'
            )
        own, theirs = ((each.servo_stiffness, each.servo_damping) for each in (self.robot, robot))
        if not np.array_equal(own, theirs):
            raise ValueError(
                f"{self.name} commands servos of {self.robot.servo}, but the environment's have {robot.servo}: make it "
                "with robot=policy.robot"
            )

    def check_fits(self, robot: Robot, control_period: float) -> None:
        """Call `check_compatible(robot, control_period)`. Deprecated name."""
        self.check_compatible(robot, control_period)

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Restart the policy for `num_envs` robots. `seed` is for policies that draw; none here does."""
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, not {num_envs}")
        self.num_envs = num_envs
        self._allocate(num_envs)

    def reset_where(self, mask: ArrayLike) -> None:
        """Restart the robots where `mask`, shape (num_envs,) of bool, is true; the others go on."""
        self._restart(validate_mask(np.asarray(mask), self.num_envs))

    def copy_state_from(self, mask: Mask, other: "Policy") -> None:
        """Go on where the mask, (n,), is true with the robots of another policy made alike, as many as these. For bases
        of a residual: a policy that holds other policies does not hand these over."""
        copy_rows(self, validate_mask(mask, self.num_envs), other)

    def act(self, observation: ArrayLike) -> Actions:
        """Joint targets in rad, float32, within the limits: (n, 12) for observations (n, k), (12,) for one (k,)."""
        if not is_allocated(self):
            self._allocate(self.num_envs)
        batch, single = self._checked(observation)
        actions = self._act(batch)
        return actions[0] if single else actions

    def _checked(self, observation: ArrayLike) -> tuple[NDArray[np.float32], bool]:
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
        """What a policy makes of observations (n, k) that are not finite; one that can do without does so here."""
        raise ValueError("observation must be finite")

    @abstractmethod
    def _act(self, observation: NDArray[np.float32]) -> Actions:
        """Actions (n, 12) for a checked batch of observations (n, k)."""

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
    """A policy on a clock, which starts at phase 0 and has advanced by one tick when the first action is chosen."""

    frequency: float
    """Gait cycles a second, Hz."""
    stiff_servos = True
    leg_offsets: tuple[float, ...]
    """Phase of each leg ahead of the clock in the gait that it starts with, rad."""
    _phase: Floats = per_robot(0.0)
    _ticks: Floats = per_robot(0.0)

    @property
    def phase(self) -> Floats:
        """Phase of the latest action, rad in [0, 2π), shape (n,)."""
        return self._phase

    def _tick(self, faster: Floats | float = 0.0) -> None:
        """Advance the clocks by a tick, faster by (n,) Hz."""
        # A fresh array each time, so that a phase handed out earlier stays what it was.
        self._phase = advance_phase(self._phase, self.frequency + faster, self.control_period)
        self._ticks = self._ticks + 1.0

    def _blended(self, targets: Floats, duration: float) -> Floats:
        """Targets (n, 12) approached from the home pose over the first `duration` s of an episode, smoothly."""
        share = np.minimum(self._ticks * (self.control_period / duration), 1.0)
        if share.min() >= 1.0:
            return targets
        weight = smoothstep(share)[:, None]
        # One formula for blended and settled rows: with weight 1 the home pose's part is exactly zero.
        return weight * targets + (1.0 - weight) * self.robot.home_pose


def validate_mask(mask: ArrayLike | None, num_envs: int) -> Mask:
    """The mask of robots, (num_envs,) of bool, all of them for None; ValueError for another shape or type."""
    rows = np.ones(num_envs, np.bool_) if mask is None else np.asarray(mask)
    if rows.dtype != np.bool_ or rows.shape != (num_envs,):
        raise ValueError(f"mask must be bool of shape ({num_envs},), not {rows.dtype} of {rows.shape}")
    return rows


def to_actions(robot: Robot, targets: Floats) -> Actions:
    """Raw targets (n, 12) in rad as float32 actions, clipped to the action space as a real joint would stop.

    Adding zero turns -0.0 into 0.0, so that adding a zero correction later changes no bit.
    """
    return within_limits(robot, targets.astype(np.float32)) + np.float32(0.0)


def within_limits(robot: Robot, actions: Actions) -> Actions:
    """Actions (n, 12), rad, clipped to the joint limits."""
    lower, upper = robot.joint_lower.astype(np.float32), robot.joint_upper.astype(np.float32)
    return actions.clip(lower, upper)


def flat_joints(legs: Floats) -> Floats:
    """Joint angles (..., 4, 3) as (..., 12)."""
    return legs.reshape(*legs.shape[:-2], legs.shape[-2] * legs.shape[-1])
