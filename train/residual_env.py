"""A base policy and a learner's correction as a Gymnasium vector environment: features in, corrections out.

Any learner that takes a `VectorEnv` with same-step autoreset can train on it:

    robots = gym.make_vec("quad_env:SimpleQuad-v0", num_envs=256, autoreset_mode="DISABLED")
    env = ResidualVectorEnv(robots, policies.make("trot"))
"""

import copy
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from policies.base import Policy
from policies.history import Inputs
from policies.residual import NO_HISTORY, Features, apply_correction, authority_of

FloatArray = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
Infos = dict[str, Any]
Step = tuple[FloatArray, NDArray[np.float64], BoolArray, BoolArray, Infos]


class BaseGroup:
    """A base policy of some rows of an environment, with what the learner sees of it and what starts new episodes.

    Args:
        base: made for these robots and their control period.
        rows: theirs.
        inputs: as of `ResidualVectorEnv`.
    """

    def __init__(self, base: Policy, rows: slice, inputs: Inputs) -> None:
        self.base, self.rows = base, rows
        self._features = Features(base, inputs)
        self.width = self._features.width
        """Numbers of a row of `seen`."""
        self._reset_base = copy.deepcopy(base)
        """Of the robots that begin an episode, which the base then takes over: all are asked for an action on the last
        observation of their old episode, and these on the first one of their new, without the others' clocks running
        twice."""
        self._fresh_features = Features(self._reset_base, inputs)

    def reset(self) -> None:
        """Begin with fresh memory of all its robots."""
        count = self.rows.stop - self.rows.start
        self.base.reset(count)
        self._features.reset(count)

    def act(self, observation: FloatArray) -> None:
        """Answer observations of all robots of the environment, (n, m)."""
        own = observation[self.rows]
        self.action = self.base.act(own)
        self.features = self._features.update(own, self.action)

    def reset_rows(self, robots: BoolArray, observation: FloatArray) -> None:
        """Answer the first observations, (n, m), of the robots in the mask, (n,), which begin an episode."""
        if not (own := robots[self.rows]).any():
            return
        first, count = observation[self.rows][own], int(own.sum())
        self._reset_base.reset(count)
        self._fresh_features.reset(count)
        action = self._reset_base.act(first)
        seen = self._fresh_features.update(first, action)
        self.base.copy_state_from(own, self._reset_base)
        self._features.copy_state_from(own, self._fresh_features)
        self.action, self.features = self.action.copy(), self.features.copy()
        self.action[own], self.features[own] = action, seen


class ResidualVectorEnv(VectorWrapper):  # takes no parameters in Gymnasium 1.2
    """Robots that follow `base` plus the learner's correction.

    Observation: `policies.residual.Features`, shape (n, m). Action: the correction in shares of the authority, -1 … 1,
    shape (n, 12), held for `hold` control steps while the base acts at every one: noise that lasts moves a robot,
    noise that changes every 10 ms only shakes it.

    A finished robot restarts in the same step: its row shows the new episode, and `infos["final_obs"]`,
    `infos["final_info"]` the end of the old one, with the base's clock still running.

    Args:
        env: robots with `autoreset_mode` DISABLED; they are restarted here, once their last features have been taken.
        base: the policy that is corrected; made for the robots and their control period. Or several of one kind, such
            as for robots with and without a real robot's delays, each with the number of robots that are its own.
        authority: largest correction of each joint, rad, shape (12,); None for the usual one.
        hold: control steps of one step of the learner.
        inputs: observations of the learner in addition to the present one and the base.
    """

    def __init__(
        self,
        env: VectorEnv[FloatArray, FloatArray, NDArray[Any]],
        base: Policy | Sequence[tuple[Policy, int]],
        authority: FloatArray | None = None,
        hold: int = 1,
        inputs: Inputs = NO_HISTORY,
    ) -> None:
        super().__init__(env)
        if (mode := env.metadata.get("autoreset_mode")) is not AutoresetMode.DISABLED:
            raise ValueError(f'the robots must be made with autoreset_mode="DISABLED", not {mode}: they restart here')
        robots: Any = env.unwrapped
        each = [(base, env.num_envs)] if isinstance(base, Policy) else list(base)
        ends = list(itertools.accumulate(count for _, count in each))
        if not each or ends[-1] != env.num_envs:
            raise ValueError(f"{env.num_envs} robots need as many rows of bases, not {sum(count for _, count in each)}")
        for policy, _ in each:
            policy.check_compatible(robots.robot, robots.dt)
        self.bases = [
            BaseGroup(policy, slice(end - count, end), inputs) for (policy, count), end in zip(each, ends, strict=True)
        ]
        robot = each[0][0].robot
        self.authority = authority if authority is not None else authority_of(robot)
        self._hold = hold
        self.single_observation_space = Box(-np.inf, np.inf, (self.bases[0].width,), np.float32)
        self.single_action_space = Box(-1.0, 1.0, (robot.num_joints,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self.action_space = batch_space(self.single_action_space, env.num_envs)
        self.metadata = env.metadata | {"autoreset_mode": AutoresetMode.SAME_STEP}

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[FloatArray, Infos]:
        """Start new episodes of all robots; `seed` and `options` as the robots take them, but for "reset_mask"."""
        if options and "reset_mask" in options:
            raise ValueError("finished robots restart by themselves: leave options['reset_mask'] out")
        observation, infos = self.env.reset(seed=seed, options=options)
        for each in self.bases:
            each.reset()
        self._update_bases(observation)
        return self._features, infos

    def step(self, actions: FloatArray) -> Step:
        """Move the robots by `hold` control steps; rewards are summed. Raises ValueError for actions of another shape.

        A robot that finishes within them stays where it is until their end.
        """
        correction = np.asarray(actions, np.float32)
        if correction.shape != self.action_space.shape:
            raise ValueError(f"corrections have shape {self.action_space.shape}, not {correction.shape}")
        observation, rewards, terminated, truncated, infos = self._step_robots(correction)
        for _ in range(self._hold - 1):
            self._update_bases(observation)
            observation, more, terminated, truncated, infos = self._step_robots(correction)
            rewards += more
        self._update_bases(observation)
        if (finished := terminated | truncated).any():
            infos = self._restart_finished(finished, infos)
        return self._features, rewards, terminated, truncated, infos

    def _step_robots(self, correction: FloatArray) -> Step:
        """One control step of the robots, their joints corrected."""
        base_action = np.concatenate([each.action for each in self.bases])
        return self.env.step(apply_correction(self.bases[0].base.robot, base_action, correction, self.authority))

    def _restart_finished(self, finished: BoolArray, infos: Infos) -> Infos:
        """Restart the finished robots; the infos with the end of their episodes."""
        ends = {
            "final_obs": np.where(finished[:, None], self._features, np.float32(0.0)),
            "final_info": {key: finished.copy() if key.startswith("_") else value for key, value in infos.items()},
        }
        observation, fresh = self.env.reset(options={"reset_mask": finished})
        for each in self.bases:
            each.reset_rows(finished, observation)
        masks = {f"_{key}": finished.copy() for key in ends}
        return _merge_infos(finished, fresh, infos) | ends | masks

    def _update_bases(self, observation: FloatArray) -> None:
        """Ask the bases for their actions on these observations."""
        for each in self.bases:
            each.act(observation)

    @property
    def _features(self) -> FloatArray:
        return np.concatenate([each.features for each in self.bases])


def _merge_infos(mask: BoolArray, fresh: Infos, infos: Infos) -> Infos:
    """Infos with the rows where the mask is true taken from `fresh`, as far as that has them."""
    return {
        key: np.where(mask.reshape(-1, *(1,) * (value.ndim - 1)), fresh[key], value) if key in fresh else value
        for key, value in infos.items()
    }
