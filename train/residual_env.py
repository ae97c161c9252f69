"""Gymnasium vector environment for residual learning: a learner corrects a base policy.

Any learner that accepts a `VectorEnv` with same-step autoreset can train on the environment:

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

from policies.base import Actions, Policy
from policies.history import Inputs
from policies.residual import NO_HISTORY, Features, apply_correction, authority_of

FloatArray = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
Infos = dict[str, Any]
Step = tuple[FloatArray, NDArray[np.float64], BoolArray, BoolArray, Infos]
"""Type of the result of a step of n robots.

The items are the observation, (n, m), with m numbers per robot; the reward, (n,); the masks of terminated and of
truncated episodes, each (n,); and the infos."""


TROT_OFFSETS = (0.0, 0.5, 0.5, 0.0)
"""Phase of each leg in the gait cycle of a trot, as a fraction of the cycle.

The order is front left, front right, hind left, hind right. Diagonal legs have the same phase."""
MAX_SCALED_CORRECTION = 100.0
"""Bound of the action space if corrections are not clipped, as a multiple of the authority (unit of the corrections).

Stable-Baselines3 needs a finite action space."""


class BaseGroup:
    """Group of k robots with a common base policy, for which the learner computes corrections.

    The group stores the latest action of the base policy and the latest features, which are the inputs of the network
    of the learner. `ResidualVectorEnv` makes one group for each base policy.

    Args:
        base: Base policy of the group, made for its robots and their control period.
        rows: Range of the indices that the robots of the group have in the environment.
        inputs: Past observations, averages and clock that the learner observes in addition to the current observation
            and the action of the base policy.
        hold: Number of control steps for which the learner holds each correction.
    """

    action: Actions
    """Latest action of the base policy for the robots of the group: joint targets, (k, 12), rad."""
    features: FloatArray
    """Latest inputs of the network of the learner for the robots of the group, (k, `width`)."""

    def __init__(self, base: Policy, rows: slice, inputs: Inputs, hold: int) -> None:
        self.base = base
        self.rows = rows
        self._feature_extractor = Features(base, inputs, hold)
        self.width = self._feature_extractor.width
        """Number of features, inputs of the network of the learner, of a robot."""
        self._reset_base = copy.deepcopy(base)
        """Copy of the base policy that computes the first action of restarted robots.

        Then the states of the restarted robots are copied from this policy to `base`. `base` itself has already acted
        for all robots in the same step. A second call of `base` would advance the clocks of the other robots twice."""
        self._reset_feature_extractor = Features(self._reset_base, inputs, hold)

    @property
    def clock_phase(self) -> NDArray[np.float64]:
        """Phase of the clock that the learner observes, see `Inputs.clock`, for each robot of the group, (k,), rad."""
        return self._feature_extractor.clock_phase

    def reset(self, clock_phase: NDArray[np.float64]) -> None:
        """Reset the base policy and the history of the features for all robots of the group.

        `clock_phase`, (k,), rad, is the phase of the clock that the learner observes, `Inputs.clock`, at the start of
        the episodes.
        """
        count = self.rows.stop - self.rows.start
        self.base.reset(count)
        self._feature_extractor.reset(count)
        self._feature_extractor.clock_offset[:] = clock_phase

    def act(self, observation: FloatArray) -> None:
        """Update `action` and `features` of the group from a new observation.

        `observation`, (n, m), has a row of m numbers for each of the n robots of the environment. The method selects
        the rows of the group.
        """
        group_observation = observation[self.rows]
        self.action = self.base.act(group_observation)
        self.features = self._feature_extractor.update(group_observation, self.action)

    def reset_rows(self, mask: BoolArray, observation: FloatArray, clock_phase: NDArray[np.float64]) -> None:
        """Reset the robots of the group that begin an episode, and compute their first action and features.

        Args:
            mask: True for robots that begin an episode. The mask covers all n robots of the environment, (n,).
            observation: Observation of all n robots of the environment, (n, m), with m numbers per robot.
            clock_phase: Phase of the clock that the learner observes, `Inputs.clock`, for each of the j restarted
                robots of the group, (j,), rad.
        """
        group_mask = mask[self.rows]
        if not group_mask.any():
            return
        first = observation[self.rows][group_mask]
        count = int(group_mask.sum())
        self._reset_base.reset(count)
        self._reset_feature_extractor.reset(count)
        self._reset_feature_extractor.clock_offset[:] = clock_phase
        action = self._reset_base.act(first)
        features = self._reset_feature_extractor.update(first, action)
        self.base.copy_state_from(group_mask, self._reset_base)
        self._feature_extractor.copy_state_from(group_mask, self._reset_feature_extractor)
        self.action = self.action.copy()
        self.features = self.features.copy()
        self.action[group_mask] = action
        self.features[group_mask] = features


class ResidualVectorEnv(
    VectorWrapper
):  # The base class has no type parameters, because Gymnasium 1.2 does not accept any.
    """Vector environment of n robots that execute the action of a base policy plus a correction by a learner.

    The observation, (n, m), has the m features of each robot, see `policies.residual.Features`. The action, (n, 12),
    has the corrections of the joint targets in units of `authority`, rad. If `bounded` is True, the corrections are
    clipped to the range -1 to 1, so that `authority` is the largest correction of a joint.

    Each correction is applied for `hold` control steps, while the base policy acts at every control step. Exploration
    noise that changes every 10 ms would only shake a robot. Noise that lasts longer moves the robot.

    A robot with a finished episode restarts in the same step. The robot's row of `obs` is then the first observation
    of the new episode. `infos["final_obs"]` and `infos["final_info"]` have the last observation and infos of the
    finished episode.

    Args:
        env: Robots with `autoreset_mode` DISABLED. `ResidualVectorEnv` restarts them, after it has computed their last
            features.
        base: Base policy, made for the robots and their control period. Or a sequence of variants of a base policy,
            each with its number of robots. For example, one variant knows the delays of a real robot, and one does not.
        authority: Unit of the correction of each joint, (12,), rad. None for the default of the robot, see
            `authority_of`.
        hold: Number of control steps in one step of the learner.
        inputs: Past observations, averages and clock that the learner observes in addition to the current observation
            and the action of the base policy.
        bounded: True to clip the corrections to [-1, 1]; otherwise `authority` is only the scale of the corrections.
        random_clock_phase: True to draw a random phase of the clock, `inputs.clock`, at the start of each episode.

    Raises:
        ValueError: `env` restarts its robots by itself: its `autoreset_mode` is not DISABLED.
    """

    def __init__(
        self,
        env: VectorEnv[FloatArray, FloatArray, NDArray[Any]],
        base: Policy | Sequence[tuple[Policy, int]],
        authority: FloatArray | None = None,
        hold: int = 1,
        inputs: Inputs = NO_HISTORY,
        bounded: bool = True,
        random_clock_phase: bool = False,
    ) -> None:
        super().__init__(env)
        if (mode := env.metadata.get("autoreset_mode")) is not AutoresetMode.DISABLED:
            raise ValueError(f'the robots must be made with autoreset_mode="DISABLED", not {mode}: they restart here')
        self.bases = _make_groups(env, base, inputs, hold)
        robot = self.bases[0].base.robot
        self.authority = authority if authority is not None else authority_of(robot)
        self._hold = hold
        self._has_clock = inputs.clock > 0.0
        self._bounded = bounded
        self._random_clock_phase = random_clock_phase
        self._phase_generator = np.random.default_rng(0)
        self._leg_offsets = 2.0 * np.pi * np.array(robot.in_leg_order(TROT_OFFSETS))
        """Phase of each leg in the gait minus the phase of the clock that the learner observes, (4,), rad."""
        limit = 1.0 if bounded else MAX_SCALED_CORRECTION
        self.single_observation_space = Box(-np.inf, np.inf, (self.bases[0].width,), np.float32)
        self.single_action_space = Box(-limit, limit, (robot.num_joints,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self.action_space = batch_space(self.single_action_space, env.num_envs)
        self.metadata = env.metadata | {"autoreset_mode": AutoresetMode.SAME_STEP}

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[FloatArray, Infos]:
        """Start a new episode of every robot.

        Args:
            seed: Seed, passed to `env.reset`.
            options: Options, passed to `env.reset`. A "reset_mask" is not allowed.

        Returns:
            Features (inputs of the network of the learner) of all robots, (n, m), with m features per robot; and infos.

        Raises:
            ValueError: `options` has a "reset_mask".
        """
        if options and "reset_mask" in options:
            raise ValueError("finished robots restart by themselves: leave options['reset_mask'] out")
        observation, infos = self.env.reset(seed=seed, options=options)
        self._phase_generator = np.random.default_rng(seed)
        for group in self.bases:
            group.reset(self._draw_phases(group.rows.stop - group.rows.start))
        self._update_bases(observation)
        return self._features, infos

    def step(self, actions: FloatArray) -> Step:
        """Simulate one step of the learner: `hold` control steps, in which all robots keep the same correction.

        The base policies act at every control step, and the correction is added to their joint targets. If the episode
        of a robot ends earlier, the robot is not simulated in the remaining control steps. After the last control step,
        all robots with a finished episode restart.

        Args:
            actions: Correction of each joint target, in units of `authority` of the joint, (n, 12).

        Returns:
            Features (inputs of the network of the learner), (n, m), with m features per robot; rewards, summed over the
            control steps, (n,); masks of terminated and of truncated episodes, each (n,); and infos.

        Raises:
            ValueError: `actions` does not have the shape of `action_space`.
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
        """Simulate one control step of all robots with the actions of the base policies plus `correction`, (n, 12)."""
        base_action = np.concatenate([group.action for group in self.bases])
        robot = self.bases[0].base.robot
        self._set_leg_phases()
        return self.env.step(apply_correction(robot, base_action, correction, self.authority, self._bounded))

    def _draw_phases(self, count: int) -> NDArray[np.float64]:
        """Return the start phase of the clock that the learner observes, for `count` robots, (count,), rad.

        The phase is random if `random_clock_phase` is True, else 0.
        """
        if not self._random_clock_phase:
            return np.zeros(count)
        return self._phase_generator.uniform(0.0, 2.0 * np.pi, count)

    def _set_leg_phases(self) -> None:
        """Set the gait phase of each leg in all simulations, from the clock that the learner observes, if there is one.

        The reward term `gait` compares the motion of the feet with these phases.
        """
        if not self._has_clock:
            return
        phases = np.concatenate([group.clock_phase for group in self.bases])[:, None] + self._leg_offsets
        robots: Any = self.env.unwrapped
        start = 0
        for batch in getattr(robots, "batches", (robots,)):
            batch.simulation.leg_phase = phases[start : start + batch.num_envs]
            start += batch.num_envs

    def _restart_finished(self, finished: BoolArray, infos: Infos) -> Infos:
        """Restart the robots for which the mask `finished`, (n,), is True.

        Returns the infos of the step, with the end of the finished episodes under "final_obs" and "final_info".
        """
        ends = {
            "final_obs": np.where(finished[:, None], self._features, np.float32(0.0)),
            "final_info": {key: finished.copy() if key.startswith("_") else value for key, value in infos.items()},
        }
        observation, reset_infos = self.env.reset(options={"reset_mask": finished})
        for group in self.bases:
            group.reset_rows(finished, observation, self._draw_phases(int(finished[group.rows].sum())))
        masks = {f"_{key}": finished.copy() for key in ends}
        return _merge_infos(finished, reset_infos, infos) | ends | masks

    def _update_bases(self, observation: FloatArray) -> None:
        """Update the base actions and features of all groups from `observation`, (n, m), m numbers per robot."""
        for group in self.bases:
            group.act(observation)

    @property
    def _features(self) -> FloatArray:
        """Latest features of all n robots, which are the observation of the learner, (n, m), m features per robot."""
        return np.concatenate([group.features for group in self.bases])


def _make_groups(
    env: VectorEnv[FloatArray, FloatArray, NDArray[Any]],
    base: Policy | Sequence[tuple[Policy, int]],
    inputs: Inputs,
    hold: int,
) -> list[BaseGroup]:
    """Make a `BaseGroup` for each base policy of an environment.

    Raises ValueError if a policy does not fit the robots, or the numbers of robots do not add up to all robots.
    """
    robots: Any = env.unwrapped
    bases = [(base, env.num_envs)] if isinstance(base, Policy) else list(base)
    ends = list(itertools.accumulate(count for _, count in bases))
    if not bases or ends[-1] != env.num_envs:
        raise ValueError(f"{env.num_envs} robots need as many rows of bases, not {sum(count for _, count in bases)}")
    for policy, _ in bases:
        policy.check_compatible(robots.robot, robots.dt)
    return [
        BaseGroup(policy, slice(end - count, end), inputs, hold)
        for (policy, count), end in zip(bases, ends, strict=True)
    ]


def _merge_infos(mask: BoolArray, reset_infos: Infos, infos: Infos) -> Infos:
    """Return a copy of the infos of a step in which restarted robots have the infos of their reset.

    `mask`, (n,), is True for the restarted robots. Only keys that occur in both dictionaries are replaced.
    """
    return {
        key: np.where(mask.reshape(-1, *(1,) * (value.ndim - 1)), reset_infos[key], value)
        if key in reset_infos
        else value
        for key, value in infos.items()
    }
