"""Residual policy: a base policy with a bounded correction by a small network."""

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats, GaitedPolicy, Policy, within_limits
from policies.history import History, Inputs
from policies.memory import PerRobotState, initialize_state, per_robot
from policies.network import Network
from quad_env.robots.robot import Robot
from quad_env.sensing.height_scan import UNSEEN, table_with
from quad_env.task.observations import observation_table

NO_HISTORY = Inputs()
"""Network inputs without history and clock: only the present observation and the base policy."""


def authority_of(robot: Robot, hip: float = 0.6, joint: float = 1.0) -> Actions:
    """Return the authority of a residual, the largest correction of each joint.

    Args:
        robot: Robot.
        hip: Largest correction of a hip joint, rad.
        joint: Largest correction of any other joint, rad.

    Returns:
        Largest corrections, (12,), rad.
    """
    return np.tile(np.array([hip, joint, joint], np.float32), len(robot.leg_names))


class Features(PerRobotState):
    """Network inputs of n robots, scaled to magnitudes of about 1. The caller resets the base.

    The inputs are, in this order:

    - the scaled observation. A height scan is relative to its values in the home pose, and zero where it is empty, so
      that a lost scan looks like level ground;
    - sine and cosine of the phase of a gaited base, and its action minus the home pose;
    - sine and cosine of the clock of `inputs`;
    - the history of the scaled observation.

    Args:
        base: Base policy.
        inputs: History and clock.
    """

    ticks: Floats = per_robot(0.0)
    """Number of observations of each robot since its reset, (n,)."""

    def __init__(self, base: Policy, inputs: Inputs = NO_HISTORY) -> None:
        self.base = base
        self.inputs = inputs
        self._table = table_with(base.robot, base.height_scan)
        self._own = observation_table(base.robot).size
        """Number of values in an observation before the height scan; only these values have a history."""
        self._level = np.float32(base.robot.home_height) * self._table.scale[self._own :]
        self._history = History(inputs, self._own, base.control_period)
        gaited = 2 + base.robot.num_joints if isinstance(base, GaitedPolicy) else 0
        self.width = self._table.size + gaited + (2 if inputs.clock else 0) + self._history.width
        """Number of network inputs of each robot."""
        super().__init__()

    def update(self, observation: NDArray[np.float32], base_action: Actions) -> NDArray[np.float32]:
        """Compute the features of an observation.

        Args:
            observation: Observation, (n, k).
            base_action: Action of the base for it, (n, 12), rad.

        Returns:
            Features, (n, `width`).
        """
        self.ticks += 1.0
        scaled = observation * self._table.scale
        scaled[:, self._own :] += self._level
        scaled[:, self._own :][observation[:, self._own :] <= UNSEEN] = 0.0
        seen = [scaled]
        if isinstance(self.base, GaitedPolicy):
            seen += [_phase_features(self.base.phase), base_action - _home(self.base.robot)]
        if self.inputs.clock:
            seen += [_phase_features(2.0 * np.pi * self.inputs.clock * self.base.control_period * self.ticks)]
        if self._history.width:
            seen += [self._history.update(scaled[:, : self._own])]
        return np.concatenate(seen, axis=-1) if len(seen) > 1 else scaled


def apply_correction(
    robot: Robot, base_action: Actions, correction: NDArray[np.float32], authority: Actions
) -> Actions:
    """Add a bounded correction to an action.

    Args:
        robot: Robot.
        base_action: Action of the base, (n, 12), rad.
        correction: Correction as a fraction of the authority, clipped to [-1, 1], (n, 12).
        authority: Largest correction of each joint, (12,), rad.

    Returns:
        Action within the joint limits, (n, 12), rad.
    """
    one = np.float32(1.0)
    return within_limits(robot, base_action + authority * np.clip(correction, -one, one))


def _phase_features(phase: Floats) -> NDArray[np.float32]:
    """Return sine and cosine of a phase, (n, 2)."""
    return np.stack([np.sin(phase), np.cos(phase)], axis=-1).astype(np.float32)


def _home(robot: Robot) -> Actions:
    """Return the home pose as an action, (12,), rad."""
    return robot.home_pose.astype(np.float32)


class ResidualPolicy(Policy):
    """Residual policy: base + authority · network(features), on the robot of the base.

    With a zero correction it equals its base bit for bit.

    Args:
        base: Base policy.
        network: Network from features to corrections.
        authority: Largest correction of each joint, (12,), rad; the result of `authority_of` by default.
        name: Name of the policy.
        inputs: History and clock of the features.
        hold: Number of control steps for which each correction is used. The base acts in every control step.

    Raises:
        ValueError: The network does not fit the features or the joints.
    """

    correction: NDArray[np.float32] = per_robot()
    """Latest correction as a fraction of the authority, from -1 to 1, (n, 12); zero before the first action."""
    base_action: Actions = per_robot()
    """Latest action of the base, (n, 12), rad; the home pose before the first."""

    def __init__(
        self,
        base: Policy,
        network: Network,
        authority: Actions | None = None,
        name: str = "residual",
        inputs: Inputs = NO_HISTORY,
        hold: int = 1,
    ) -> None:
        robot = base.robot
        self.features = Features(base, inputs)
        self.hold = hold
        if network.sizes[0] != self.features.width or network.sizes[-1] != robot.num_joints:
            raise ValueError(
                f"a network over {base.name} needs {self.features.width} inputs and {robot.num_joints} outputs, "
                f"not {network.sizes[0]} and {network.sizes[-1]}"
            )
        self.base = base
        self.network = network
        self.authority = authority if authority is not None else authority_of(robot)
        self.name = name
        self.height_scan = base.height_scan
        super().__init__(robot=robot, control_period=base.control_period)
        initialize_state(self, correction=np.zeros(robot.num_joints, np.float32), base_action=_home(robot))

    @property
    def phase(self) -> Floats | None:
        """Phase of the clock of the base, (n,), rad; None if the base has no clock."""
        return self.base.phase if isinstance(self.base, GaitedPolicy) else None

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Reset the policy and its base for `num_envs` robots with a `seed`."""
        super().reset(num_envs, seed)
        self.base.reset(num_envs, seed)

    def _reset_rows(self, mask: NDArray[np.bool_]) -> None:
        super()._reset_rows(mask)
        self.base.reset_where(mask)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self.base_action = self.base.act(observation)
        seen = self.features.update(observation, self.base_action)
        if (due := (self.features.ticks - 1.0) % self.hold == 0.0).any():
            corrected = np.clip(self.network(seen), np.float32(-1.0), np.float32(1.0))
            self.correction = np.where(due[:, None], corrected, self.correction)
        return apply_correction(self.robot, self.base_action, self.correction, self.authority)
