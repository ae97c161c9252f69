"""A base policy corrected, within bounds, by a small network; training and running use the same two functions."""

import numpy as np
from numpy.typing import NDArray

from policies.base import LOWER, UPPER, Actions, Floats, GaitedPolicy, Policy
from policies.network import Network
from quad_env import OBSERVATION_SIZE
from quad_env.observations import SCALE
from quad_env.robot import HOME_POSE, NUM_JOINTS

_HOME: Actions = HOME_POSE.astype(np.float32)

DEFAULT_AUTHORITY: Actions = np.array([0.15, 0.3, 0.3] * 4, dtype=np.float32)
"""Largest correction of each joint, rad: more would be learning from scratch in disguise."""
DEFAULT_AUTHORITY.flags.writeable = False


def feature_count(base: Policy) -> int:
    """Width of the features over a base."""
    return OBSERVATION_SIZE + (2 + NUM_JOINTS if isinstance(base, GaitedPolicy) else 0)


def features(observation: NDArray[np.float32], phase: Floats | None, base_action: Actions) -> NDArray[np.float32]:
    """What the network sees, shape (n, m), about unit size: the scaled observation (n, k), and over a gaited base the
    sine and cosine of its phase (n,) and its action (n, 12) minus the home pose.
    """
    scaled = observation * SCALE
    if phase is None:
        return scaled
    clock = np.stack([np.sin(phase), np.cos(phase)], axis=-1).astype(np.float32)
    return np.concatenate([scaled, clock, base_action - _HOME], axis=-1)


def compose(base_action: Actions, correction: NDArray[np.float32], authority: Actions) -> Actions:
    """The base's action (n, 12) plus authority (12,) times the correction in [-1, 1], within the joint limits, rad."""
    one = np.float32(1.0)
    action: Actions = np.clip(base_action + authority * np.clip(correction, -one, one), LOWER, UPPER)
    return action


class ResidualPolicy(Policy):
    """base + authority · network(features); with a zero correction its base, bit for bit."""

    def __init__(self, base: Policy, network: Network, authority: Actions = DEFAULT_AUTHORITY, name: str = "residual"):
        if network.sizes[0] != feature_count(base) or network.sizes[-1] != NUM_JOINTS:
            raise ValueError(
                f"a network over {base.name} needs {feature_count(base)} inputs and {NUM_JOINTS} outputs, "
                f"not {network.sizes[0]} and {network.sizes[-1]}"
            )
        self.base = base
        self.network = network
        self.authority = authority
        self.name = name
        super().__init__()

    @property
    def phase(self) -> Floats | None:
        """The base's phase, rad, shape (n,); None over a base without a clock."""
        return self.base.phase if isinstance(self.base, GaitedPolicy) else None

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Start `num_envs` robots anew, base included."""
        super().reset(num_envs, seed)
        self.base.reset(num_envs, seed)

    def _restart(self, mask: NDArray[np.bool_]) -> None:
        self.base.reset_where(mask)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        base_action = self.base.act(observation)
        correction = self.network(features(observation, self.phase, base_action))
        return compose(base_action, correction, self.authority)
