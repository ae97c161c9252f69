"""Left and right as one: a learner that is shown each sample together with its mirror image."""

from collections.abc import Iterator
from typing import Any

import torch
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.type_aliases import RolloutBufferSamples

from policies.mirror import Mirror


class MirroredRolloutBuffer(RolloutBuffer):
    """A rollout whose minibatches are half samples, half their mirror images.

    An epoch is as long as without images and thus of every other sample, the next one of the others. Advantage, return
    and old probability of an image are those of its sample, as in rsl_rl. The image in the same minibatch keeps the
    learner from leaning to one side between two epochs, which would count as a change of policy.

    Args:
        mirrors: of observations and of actions.
    """

    def __init__(self, *args: Any, mirrors: tuple[Mirror, Mirror], **kwargs: Any) -> None:
        self._mirrors = mirrors
        super().__init__(*args, **kwargs)

    def reset(self) -> None:
        """Forget the rollout."""
        super().reset()
        self._halves: Iterator[RolloutBufferSamples] = iter(())

    def get(self, batch_size: int | None = None) -> Iterator[RolloutBufferSamples]:  # type: ignore[override]
        """Minibatches of an epoch."""
        size = self.buffer_size * self.n_envs
        batch_size = batch_size or size
        for _ in range(size // batch_size):
            half = next(self._halves, None)
            if half is None:
                self._halves = super().get(batch_size // 2)
                half = next(self._halves)
            yield self._with_images(half)

    def _with_images(self, samples: RolloutBufferSamples) -> RolloutBufferSamples:
        *moved, values, log_prob, advantages, returns = samples
        images = (torch.from_numpy(mirror(rows.numpy())) for rows, mirror in zip(moved, self._mirrors, strict=True))
        observations, actions = (torch.cat(pair) for pair in zip(moved, images, strict=True))
        same = (each.repeat(2) for each in (values, log_prob, advantages, returns))
        return RolloutBufferSamples(observations, actions, *same)
