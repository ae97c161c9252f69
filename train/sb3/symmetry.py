"""Left and right as one: a learner that is shown half of its samples in the mirror."""

from typing import Any

from numpy.typing import NDArray
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.type_aliases import RolloutBufferSamples
from stable_baselines3.common.vec_env import VecNormalize

from policies.mirror import Mirror


class MirroredRolloutBuffer(RolloutBuffer):
    """A rollout whose minibatches are mirrored in their first half, at no cost in samples.

    The shuffle of each epoch decides which samples those are, so that over the epochs every sample is seen both ways,
    and nothing more is drawn. Advantage, return and the old probability of a sample are those of its mirror image:
    the robot that moved was as likely the one as the other.

    Args:
        mirrors: of observations and of actions.
    """

    def __init__(self, *args: Any, mirrors: tuple[Mirror, Mirror], **kwargs: Any) -> None:
        self._mirrors = mirrors
        super().__init__(*args, **kwargs)

    def _get_samples(self, batch_inds: NDArray[Any], env: VecNormalize | None = None) -> RolloutBufferSamples:
        samples = super()._get_samples(batch_inds, env)
        half = len(batch_inds) // 2
        for tensor, mirror in zip((samples.observations, samples.actions), self._mirrors, strict=True):
            rows = tensor.numpy()
            rows[:half] = mirror(rows[:half])
        return samples
