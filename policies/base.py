"""Base classes of all policies, which compute joint targets from observations for n robots."""

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
"""Type of actions: joint targets, (n, 12), rad."""
Mask = NDArray[np.bool_]
"""Type of boolean arrays, for example a selection of robots, (n,)."""

CONTROL_PERIOD = 1.0 / TaskConfig().control_rate
"""Default time between two control steps of the environment and of the policies, s."""


class PolicyError(UserError, ValueError):
    """Error for a policy that does not exist or cannot be loaded; its message has one line.

    Args:
        fault: Cause of the error, the first part of the message.
        remedy: Advice to the user, the second part of the message; empty for none.
    """

    def __init__(self, fault: str, remedy: str = "") -> None:
        super().__init__(f"{fault}; {remedy}" if remedy else fault)
        self.fault = fault
        self.remedy = remedy


class PolicyKwargs(TypedDict, total=False):
    """Types of the keyword arguments `robot` and `control_period`, which all policy constructors accept."""

    robot: str | Robot
    """Robot that the policy controls, or its name."""
    control_period: float
    """Time between two control steps, s."""


class Policy(ABC):
    """Base class of controllers: a policy controls a batch of n robots of one type at one control period.

    A subclass implements `_act`. The policy has a separate state for each robot of the batch. The actions for a robot
    depend only on the observations and resets of this robot. The actions are identical, bit for bit, for every batch
    size.

    Args:
        robot: Robot or its name. The attribute `robot` of the policy is this robot with the servo gains that the policy
            needs. Make the environment with `robot=policy.robot`.
        control_period: Time between two calls of `act`, equal to `dt` of the environment, s.

    Raises:
        ValueError: The control period is not positive.
    """

    name: str
    """Name of the policy in results and messages, for example `trot`."""
    height_scan: HeightScan | None = None
    """Height scan (grid of terrain heights) that the observation must have; None if the policy uses none."""
    observations: tuple[str | ObservationTerm, ...] = ()
    """Names or definitions of the observation terms that the policy needs in addition to the standard observation.

    The environment must be made with the same terms: `gym.make(..., observations=policy.observations)`."""
    stiff_servos: ClassVar[bool] = False
    """True if the policy uses the servo gains `Robot.stiff_servo`, because softer servos would sag too far."""

    def __init__(self, *, robot: str | Robot = SIMPLE_QUAD, control_period: float = CONTROL_PERIOD) -> None:
        if not 0.0 < control_period < math.inf:
            raise ValueError(f"control_period must be a time above 0 s, not {control_period}")
        self.robot = get_robot(robot).with_stiff_servos if self.stiff_servos else get_robot(robot)
        self.control_period = control_period
        self.num_envs = 1
        initialize_state(self)

    def mismatch(self, robot: Robot, control_period: float) -> str:
        """Describe the difference between a policy and an environment in robot or control period.

        Args:
            robot: Robot of the environment.
            control_period: Control period of the environment, s.

        Returns:
            Part of an error message, `made for ..., not for ...`; empty if robot and control period are the same.
        """
        if self.robot == robot and math.isclose(self.control_period, control_period):
            return ""
        own = f"made for {self.robot.name} with a control period of {self.control_period:g} s"
        return f"{own}, not for {robot.name} with one of {control_period:g} s"

    def check_compatible(self, robot: Robot, control_period: float) -> None:
        """Check that the policy fits the robot, the servo gains and the control period of an environment.

        Args:
            robot: Robot of the environment, with its servo gains.
            control_period: Control period of the environment, s.

        Raises:
            ValueError: The policy was made for another robot, control period or other servo gains. The message names a
                remedy.
        """
        if mismatch := self.mismatch(robot, control_period):
            raise ValueError(
                f"{self.name} was {mismatch}: make it for its environment, "
                f'policies.make("{self.name}", robot=env.unwrapped.robot, control_period=env.unwrapped.dt)'
            )
        if not self.robot.has_gains(robot.gains):
            raise ValueError(
                f"{self.name} commands servos of {self.robot.servo}, but the environment's have {robot.servo}: make it "
                "with robot=policy.robot"
            )

    def check_fits(self, robot: Robot, control_period: float) -> None:
        """Call `check_compatible(robot, control_period)`. The name `check_fits` is deprecated."""
        self.check_compatible(robot, control_period)

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Reset the policy for a batch of robots, each at the start of an episode.

        Args:
            num_envs: Number of robots in the batch.
            seed: Seed for policies that draw random numbers. No policy of this project draws any.

        Raises:
            ValueError: `num_envs` is below 1.
        """
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, not {num_envs}")
        self.num_envs = num_envs
        self._allocate(num_envs)

    def reset_where(self, mask: ArrayLike) -> None:
        """Reset the policy state of the robots for which `mask`, (num_envs,) bool, is True.

        All other robots keep their policy state. Call this method when some robots start a new episode.
        """
        self._restart(validate_mask(np.asarray(mask), self.num_envs))

    def copy_state_from(self, mask: Mask, other: "Policy") -> None:
        """Copy the per-robot state of another policy to some robots of this policy.

        The training of residual policies uses this method: when some robots start a new episode, they get the state of
        a base policy that was reset for them. The state of a policy inside this policy, for example inside `Safe`, is
        not copied.

        Args:
            mask: True for the robots of this policy that receive a state, (n,) bool.
            other: Policy that was made with the same arguments, with one robot for each True in `mask`.
        """
        copy_rows(self, validate_mask(mask, self.num_envs), other)

    def act(self, observation: ArrayLike) -> Actions:
        """Compute the action for one control step from an observation.

        Args:
            observation: Observation of n robots, (n, k), or of a single robot, (k,), with k numbers per robot.

        Returns:
            Action: joint targets within the joint limits, float32, rad; (n, 12), or (12,) for a single robot.
        """
        if not is_allocated(self):
            self._allocate(self.num_envs)
        batch, single = self._to_batch(observation)
        actions = self._act(batch)
        return actions[0] if single else actions

    def _to_batch(self, observation: ArrayLike) -> tuple[NDArray[np.float32], bool]:
        """Check an observation, and convert it to a float32 array with one row per robot, (n, k).

        An observation has k numbers per robot. The second item of the result is True if the observation was given for a
        single robot, (k,). Raises ValueError if the shape of the observation does not fit the policy.
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
        if not all_finite(rows):
            rows = self._replace_nonfinite(rows)
        return rows, single

    def _replace_nonfinite(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the observation `rows` of n robots with finite numbers in place of NaN and infinite values.

        This default implementation raises ValueError. A subclass that accepts missing sensor values overrides this
        method. The argument and the result have the shape (n, k), with k numbers per robot.
        """
        raise ValueError("observation must be finite")

    @abstractmethod
    def _act(self, observation: NDArray[np.float32]) -> Actions:
        """Compute the joint targets, (n, 12), rad, for one control step.

        The `observation` of n robots, (n, k) with k numbers per robot, has already been checked.
        """

    def _allocate(self, num_envs: int) -> None:
        """Allocate the state arrays (declared with `per_robot`) for `num_envs` robots, with initial values."""
        allocate(self, num_envs)

    def _reset_rows(self, mask: Mask) -> None:
        """Reset the policy state of the robots for which `mask`, (n,) bool, is True."""
        reset_rows(self, mask)

    def _restart(self, mask: Mask) -> None:
        """Call `_reset_rows`. The name `_restart` is deprecated, but policies of users may still override it."""
        self._reset_rows(mask)


class GaitedPolicy(Policy):
    """Base class of policies with a gait clock for each robot.

    A gait clock is a phase that increases by 2π in each gait cycle. The clock starts at phase 0 in each episode. It
    advances by one control period before each action, also before the first action.
    """

    frequency: float
    """Gait frequency: gait cycles per second, Hz."""
    stiff_servos = True
    leg_offsets: tuple[float, ...]
    """Phase of each leg minus the phase of the gait clock, (4,), rad, in the first gait of an episode."""
    _phase: Floats = per_robot(0.0)
    """Phase of the gait clock of each robot, (n,), in [0, 2π) rad."""
    _ticks: Floats = per_robot(0.0)
    """Number of control steps of each robot since its reset, (n,)."""

    @property
    def phase(self) -> Floats:
        """Phase of the gait clock of each robot at the latest action, (n,), in [0, 2π) rad."""
        return self._phase

    def _tick(self, faster: Floats | float = 0.0) -> None:
        """Advance the gait clocks by one control period.

        The gait frequency in this step is `frequency` + `faster`; `faster` is a number or an array, (n,), Hz.
        """
        # Each step makes a new array, because a caller may still use the array that `phase` has returned.
        self._phase = advance_phase(self._phase, self.frequency + faster, self.control_period)
        self._ticks = self._ticks + 1.0

    def _blended(self, targets: Floats, duration: float) -> Floats:
        """Compute the weighted mean of the home pose and joint targets, so that a gait starts smoothly.

        The weight of `targets`, (n, 12), rad, rises from 0 to 1 over the first `duration` seconds of an episode. The
        result has the shape (n, 12), rad.
        """
        share = np.minimum(self._ticks * (self.control_period / duration), 1.0)
        if share.min() >= 1.0:
            return targets
        weight = smoothstep(share)[:, None]
        # The formula also holds for robots that have finished the blend, because their home pose has the weight 0.
        return weight * targets + (1.0 - weight) * self.robot.home_pose


def validate_mask(mask: ArrayLike | None, num_envs: int) -> Mask:
    """Check the shape and type of a mask that selects robots of a batch.

    Args:
        mask: True for selected robots, (num_envs,) bool. None selects all robots.
        num_envs: Number of robots in the batch.

    Returns:
        The mask, (num_envs,) bool.

    Raises:
        ValueError: The mask has another shape or type.
    """
    rows = np.ones(num_envs, np.bool_) if mask is None else np.asarray(mask)
    if rows.dtype != np.bool_ or rows.shape != (num_envs,):
        raise ValueError(f"mask must be bool of shape ({num_envs},), not {rows.dtype} of {rows.shape}")
    return rows


def all_finite(values: NDArray[np.floating]) -> bool:
    """Return True if no element of `values` is infinite or NaN."""
    # `count_nonzero` is faster than `all` for the small arrays of one robot.
    return bool(np.count_nonzero(np.isfinite(values)) == values.size)


def to_actions(robot: Robot, targets: Floats) -> Actions:
    """Convert joint targets to actions: float32, clipped to the joint limits.

    The function adds zero, because this turns -0.0 into 0.0. A residual policy that adds a correction of zero then
    gives exactly the same bits as its base policy.

    Args:
        robot: Robot with the joint limits.
        targets: Joint targets, (n, 12), rad.

    Returns:
        Actions, (n, 12), float32, rad.
    """
    return within_limits(robot, targets.astype(np.float32)) + np.float32(0.0)


def within_limits(robot: Robot, actions: Actions) -> Actions:
    """Return the joint targets `actions`, (n, 12), rad, clipped to the joint limits of a `robot`."""
    return actions.clip(*robot.action_limits)


def flat_joints(legs: Floats) -> Floats:
    """Reshape joint angles of the `legs`, (..., 4 legs, 3 joints), to one axis for all joints, (..., 12)."""
    return legs.reshape(*legs.shape[:-2], legs.shape[-2] * legs.shape[-1])
