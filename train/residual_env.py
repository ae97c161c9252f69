"""A base policy and a learner's correction as a Gymnasium vector environment: features in, corrections out.

Any learner that takes a `VectorEnv` with same-step autoreset can train on it:

    robots = gym.make_vec("quad_env:SimpleQuad-v0", num_envs=256, autoreset_mode="DISABLED")
    env = ResidualVectorEnv(robots, policies.make("trot"))
"""

import copy
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from policies.base import Policy
from policies.history import Inputs
from policies.residual import PRESENT, Features, authority_of, compose

FloatArray = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
Infos = dict[str, Any]
Step = tuple[FloatArray, NDArray[np.float64], BoolArray, BoolArray, Infos]


class ResidualVectorEnv(VectorWrapper):  # takes no parameters in Gymnasium 1.2
    """Robots that follow `base` plus the learner's correction.

    Observation: `policies.residual.Features`, shape (n, m). Action: the correction in shares of the authority, -1 … 1,
    shape (n, 12), held for `hold` control steps while the base acts at every one: noise that lasts moves a robot,
    noise that changes every 10 ms only shakes it.

    A finished robot restarts in the same step: its row shows the new episode, and `infos["final_obs"]`,
    `infos["final_info"]` the end of the old one, with the base's clock still running.

    Args:
        env: robots with `autoreset_mode` DISABLED; they are restarted here, once their last features have been taken.
        base: the policy that is corrected; made for the robots and their control period.
        authority: largest correction of each joint, rad, shape (12,); None for the usual one.
        hold: control steps of one step of the learner.
        inputs: observations of the learner in addition to the present one and the base.
    """

    def __init__(
        self,
        env: VectorEnv[FloatArray, FloatArray, NDArray[Any]],
        base: Policy,
        authority: FloatArray | None = None,
        hold: int = 1,
        inputs: Inputs = PRESENT,
    ) -> None:
        super().__init__(env)
        if (mode := env.metadata.get("autoreset_mode")) is not AutoresetMode.DISABLED:
            raise ValueError(f'the robots must be made with autoreset_mode="DISABLED", not {mode}: they restart here')
        robots: Any = env.unwrapped
        base.check_fits(robots.robot, robots.dt)
        self.base = base
        self.authority = authority if authority is not None else authority_of(base.robot)
        self._hold = hold
        self._features = Features(base, inputs)
        self._fresh = copy.deepcopy(base)
        """Of the robots that begin an episode, which the base then takes over: all are asked for an action on the last
        observation of their old episode, and these on the first one of their new, without the others' clocks running
        twice."""
        self._fresh_features = Features(self._fresh, inputs)
        self.single_observation_space = Box(-np.inf, np.inf, (self._features.width,), np.float32)
        self.single_action_space = Box(-1.0, 1.0, (base.robot.num_joints,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self.action_space = batch_space(self.single_action_space, env.num_envs)
        self.metadata = env.metadata | {"autoreset_mode": AutoresetMode.SAME_STEP}

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[FloatArray, Infos]:
        """Start new episodes of all robots; `seed` and `options` as the robots take them, but for "reset_mask"."""
        if options and "reset_mask" in options:
            raise ValueError("finished robots restart by themselves: leave options['reset_mask'] out")
        observation, infos = self.env.reset(seed=seed, options=options)
        self.base.reset(self.num_envs)
        self._features.reset(self.num_envs)
        self._tick(observation)
        return self._seen, infos

    def step(self, actions: FloatArray) -> Step:
        """Move the robots by `hold` control steps; rewards are summed. Raises ValueError for actions of another shape.

        A robot that finishes within them stays where it is until their end.
        """
        correction = np.asarray(actions, np.float32)
        if correction.shape != self.action_space.shape:
            raise ValueError(f"corrections have shape {self.action_space.shape}, not {correction.shape}")
        observation, rewards, terminated, truncated, infos = self._move(correction)
        for _ in range(self._hold - 1):
            self._tick(observation)
            observation, more, terminated, truncated, infos = self._move(correction)
            rewards += more
        if (finished := terminated | truncated).any():
            infos = self._restart(observation, finished, infos)
        else:
            self._tick(observation)
        return self._seen, rewards, terminated, truncated, infos

    def _move(self, correction: FloatArray) -> Step:
        """One control step of the robots, their joints corrected."""
        return self.env.step(compose(self.base.robot, self._base_action, correction, self.authority))

    def _restart(self, final: FloatArray, finished: BoolArray, infos: Infos) -> Infos:
        """Restart the finished robots; the infos with the end of their episodes."""
        observation, fresh = self.env.reset(options={"reset_mask": finished})
        self._tick(final)
        ends = {
            "final_obs": np.where(finished[:, None], self._seen, np.float32(0.0)),
            "final_info": {key: finished.copy() if key.startswith("_") else value for key, value in infos.items()},
        }
        self._begin(finished, observation[finished])
        masks = {f"_{key}": finished.copy() for key in ends}
        return _merged(finished, fresh, infos) | ends | masks

    def _begin(self, robots: BoolArray, observation: FloatArray) -> None:
        """Start the base of those robots, (n,), with the first observations of their new episodes, (k, m)."""
        self._fresh.reset(len(observation))
        self._fresh_features.reset(len(observation))
        action = self._fresh.act(observation)
        seen = self._fresh_features.see(observation, action)
        self.base.take_over(robots, self._fresh)
        self._features.take_over(robots, self._fresh_features)
        self._base_action, self._seen = self._base_action.copy(), self._seen.copy()
        self._base_action[robots], self._seen[robots] = action, seen

    def _tick(self, observation: FloatArray) -> None:
        """Ask the base for its actions on these observations."""
        self._base_action = self.base.act(observation)
        self._seen = self._features.see(observation, self._base_action)


def _merged(mask: BoolArray, fresh: Infos, infos: Infos) -> Infos:
    """Infos with the rows where the mask is true taken from `fresh`, as far as that has them."""
    return {
        key: np.where(mask.reshape(-1, *(1,) * (value.ndim - 1)), fresh[key], value) if key in fresh else value
        for key, value in infos.items()
    }
