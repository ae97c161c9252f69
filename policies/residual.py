"""A base policy corrected, within bounds, by a small network; training and running use the same two functions."""

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats, GaitedPolicy, Policy, within_limits
from policies.network import Network
from quad_env.robots.robot import Robot
from quad_env.task.observations import observation_table


def authority_of(robot: Robot, hip: float = 0.15, joint: float = 0.3) -> Actions:
    """Largest correction of each joint, rad, (12,), of hip and of other joints; of more than this a learner would learn
    from scratch in disguise.
    """
    return np.tile(np.array([hip, joint, joint], np.float32), len(robot.leg_names))


def feature_count(base: Policy) -> int:
    """Width of the features over a base."""
    return observation_table(base.robot).size + (2 + base.robot.num_joints if isinstance(base, GaitedPolicy) else 0)


def features(
    robot: Robot, observation: NDArray[np.float32], phase: Floats | None, base_action: Actions
) -> NDArray[np.float32]:
    """What the network sees, shape (n, m), about unit size: the scaled observation (n, k), and over a gaited base the
    sine and cosine of its phase (n,) and its action (n, 12) minus the home pose.
    """
    scaled = observation * observation_table(robot).scale
    if phase is None:
        return scaled
    clock = np.stack([np.sin(phase), np.cos(phase)], axis=-1).astype(np.float32)
    return np.concatenate([scaled, clock, base_action - _home(robot)], axis=-1)


def compose(robot: Robot, base_action: Actions, correction: NDArray[np.float32], authority: Actions) -> Actions:
    """The base's action (n, 12) plus authority (12,) times the correction in [-1, 1], within the joint limits, rad."""
    one = np.float32(1.0)
    return within_limits(robot, base_action + authority * np.clip(correction, -one, one))


def _home(robot: Robot) -> Actions:
    return robot.home_pose.astype(np.float32)


class ResidualPolicy(Policy):
    """base + authority · network(features); with a zero correction its base, bit for bit. Its robot is its base's."""

    correction: NDArray[np.float32]
    """The latest correction, in shares of the authority, -1 … 1, shape (n, 12); zero before the first action."""
    base_action: Actions
    """The base's latest action, rad, shape (n, 12); the home pose before the first."""

    def __init__(self, base: Policy, network: Network, authority: Actions | None = None, name: str = "residual"):
        robot = base.robot
        if network.sizes[0] != feature_count(base) or network.sizes[-1] != robot.num_joints:
            raise ValueError(
                f"a network over {base.name} needs {feature_count(base)} inputs and {robot.num_joints} outputs, "
                f"not {network.sizes[0]} and {network.sizes[-1]}"
            )
        self.base = base
        self.network = network
        self.authority = authority if authority is not None else authority_of(robot)
        self.name = name
        super().__init__(robot=robot, control_period=base.control_period)
        self._allocate(1)

    @property
    def phase(self) -> Floats | None:
        """The base's phase, rad, shape (n,); None over a base without a clock."""
        return self.base.phase if isinstance(self.base, GaitedPolicy) else None

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Start `num_envs` robots anew, base included."""
        super().reset(num_envs, seed)
        self.base.reset(num_envs, seed)

    def _allocate(self, num_envs: int) -> None:
        self.correction = np.zeros((num_envs, self.robot.num_joints), np.float32)
        self.base_action = np.tile(_home(self.robot), (num_envs, 1))

    def _restart(self, mask: NDArray[np.bool_]) -> None:
        self.base.reset_where(mask)
        self.correction = np.where(mask[:, None], np.float32(0.0), self.correction)
        self.base_action = np.where(mask[:, None], _home(self.robot), self.base_action)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self.base_action = self.base.act(observation)
        correction = self.network(features(self.robot, observation, self.phase, self.base_action))
        self.correction = np.clip(correction, np.float32(-1.0), np.float32(1.0))
        return compose(self.robot, self.base_action, self.correction, self.authority)
