"""A base policy corrected, within bounds, by a small network; training and running share all of it but the network."""

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
"""Those of a network that sees the present observation and its base alone."""


def authority_of(robot: Robot, hip: float = 0.6, joint: float = 1.0) -> Actions:
    """Largest correction of each joint, rad, (12,), of hip and of other joints."""
    return np.tile(np.array([hip, joint, joint], np.float32), len(robot.leg_names))


class Features(PerRobotState):
    """What the network over a base sees of n robots, about unit size.

    The scaled observation, of a height scan how far the ground is above where it is in the home pose, zero where
    nothing is seen, so that a lost scan looks like level ground; over a gaited base the sine and cosine of its phase,
    and its action minus the home pose; sine and cosine of a clock of its own; what is remembered of the scaled
    observations before. The base is reset by who uses it.
    """

    ticks: Floats = per_robot(0.0)
    """Observations that each robot has been seen with since it began, (n,)."""

    def __init__(self, base: Policy, inputs: Inputs = NO_HISTORY) -> None:
        self.base, self.inputs = base, inputs
        self._table = table_with(base.robot, base.height_scan)
        self._own = observation_table(base.robot).size
        """Numbers of an observation without a height scan; of these alone the past is remembered."""
        self._level = np.float32(base.robot.home_height) * self._table.scale[self._own :]
        self._history = History(inputs, self._own, base.control_period)
        gaited = 2 + base.robot.num_joints if isinstance(base, GaitedPolicy) else 0
        self.width = self._table.size + gaited + (2 if inputs.clock else 0) + self._history.width
        """Numbers of a row."""
        super().__init__()

    def update(self, observation: NDArray[np.float32], base_action: Actions) -> NDArray[np.float32]:
        """Features (n, `width`) of observations (n, k) that the base has just answered with its action, (n, 12)."""
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
    """The base's action (n, 12) plus authority (12,), rad, times the correction in [-1, 1], within the joint limits,
    rad."""
    one = np.float32(1.0)
    return within_limits(robot, base_action + authority * np.clip(correction, -one, one))


def _phase_features(phase: Floats) -> NDArray[np.float32]:
    return np.stack([np.sin(phase), np.cos(phase)], axis=-1).astype(np.float32)


def _home(robot: Robot) -> Actions:
    return robot.home_pose.astype(np.float32)


class ResidualPolicy(Policy):
    """base + authority · network(features); with a zero correction its base, bit for bit. Its robot is its base's."""

    correction: NDArray[np.float32] = per_robot()
    """The latest correction, in shares of the authority, -1 … 1, shape (n, 12); zero before the first action."""
    base_action: Actions = per_robot()
    """The base's latest action, rad, shape (n, 12); the home pose before the first."""

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
        """Control steps that a correction is held, while the base goes on at every one."""
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
        """The base's phase, rad, shape (n,); None over a base without a clock."""
        return self.base.phase if isinstance(self.base, GaitedPolicy) else None

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Restart the policy, base included, for `num_envs` robots."""
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
