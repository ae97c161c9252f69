"""Several policies that share a batch, so that all candidates of a generation are simulated together."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Policy


class Panel(Policy):
    """Several policies as one, each on its own equal share of the rows.

    Args:
        members: the policies, in the order of their shares.
        blocks: equal parts that the rows come in, such as one a scenario, in each of which each member has its share.
    """

    name = "panel"

    def __init__(self, members: Sequence[Policy], blocks: int = 1) -> None:
        super().__init__(robot=members[0].robot, control_period=members[0].control_period)
        self._members, self._blocks = members, blocks

    def _allocate(self, num_envs: int) -> None:
        for member in self._members:
            member.reset(num_envs // len(self._members))

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        shares = np.arange(len(observation)).reshape(self._blocks, len(self._members), -1).swapaxes(0, 1)
        actions = np.empty((len(observation), self.robot.num_joints), np.float32)
        for member, share in zip(self._members, shares, strict=True):
            actions[share.ravel()] = member.act(observation[share.ravel()])
        return actions
