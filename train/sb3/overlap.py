"""PPO whose update of one rollout is worked out while the robots make the next one.

The robots' physics and the update each fill a core, and both release the interpreter's lock. A rollout is made by the
policy of the update before the last, and knows it: PPO weighs every sample by how likely the policy that acted was to
act so. Nothing depends on which of the two is done first, so that a run stays the same to the bit.
"""

import copy
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, cast

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from train.sb3.standardised import Standardised


class OverlappedPPO(PPO):
    """SB3's PPO with its updates beside the rollouts; where `drains` says so they are done before the next rollout."""

    drains: Callable[[], bool] = staticmethod(lambda: True)
    """Whether nothing may be under way after this update, such as where a checkpoint is made."""

    def _setup_model(self) -> None:
        super()._setup_model()
        self._acting = copy.deepcopy(self.policy)
        self._filled = copy.deepcopy(self.rollout_buffer)
        self._due, self._update = False, Future[None]()
        self._worker = ThreadPoolExecutor(1, "update")
        self._update.set_result(None)

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """A rollout by the policy that acts, beside the update that is due; see SB3's."""
        callback.on_rollout_start()
        self._acting.load_state_dict(self.policy.state_dict())
        if self._due:
            learner = copy.copy(self)  # shares policy, optimiser and logger
            learner.rollout_buffer, self._due = self._filled, False
            self._update = self._worker.submit(self._learn, learner)
        learning, self.policy = self.policy, self._acting
        try:
            return super().collect_rollouts(env, cast(BaseCallback, _Begun(callback)), rollout_buffer, n_rollout_steps)
        finally:
            self.policy = learning

    def train(self) -> None:
        """Take in the update that was under way; make the next one due, or do it now where nothing may be under way."""
        self._update.result()
        if self.drains() or self.num_timesteps >= self._total_timesteps:
            self._learn(self)
            return
        self.rollout_buffer, self._filled, self._due = self._filled, self.rollout_buffer, True

    def _learn(self, learner: "OverlappedPPO") -> None:
        super(OverlappedPPO, learner).train()
        self._n_updates = learner._n_updates
        # Only now: the policy that acted had not taken these in either.
        if isinstance(extractor := learner.policy.features_extractor, Standardised):
            extractor.take_in(torch.from_numpy(learner.rollout_buffer.observations).flatten(0, -2))


class _Begun:
    """A callback whose beginning of the rollout has been told."""

    def __init__(self, callback: BaseCallback) -> None:
        self._callback = callback

    def on_rollout_start(self) -> None:
        """Nothing."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._callback, name)
