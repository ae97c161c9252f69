"""Makes the simulated robots of a training run, steps them together, and collects statistics of the training.

There is one batch of robots for each scenario of the training mixture.
"""

import dataclasses
from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from policies.base import Policy
from quad_env.columns import Array, to_components
from quad_env.config import TaskConfig
from quad_env.envs.combined_env import CombinedVectorEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.simulators import WARP
from quad_env.physics.state import rotation_matrix, to_heading
from quad_env.robots.robot import Robot
from quad_env.scenarios.allocation import allocate_robots
from quad_env.scenarios.disturbances import Kicks
from quad_env.scenarios.registry import scenario as find_scenario
from quad_env.scenarios.scenario import Scenario
from quad_env.seeding import episode_seeds
from quad_env.task.observations import observation_table
from quad_env.task.rewards import REWARD
from train.config import EFFORT_TERMS, TrainConfig
from train.curriculum import CommandIntervalTracker, at_difficulty, with_terrain_seed
from train.residual_env import BoolArray, FloatArray, Infos, Step

PUSH_SCALE = 500.0
"""Pushing force that the value network observes as the number 1, N."""
PRIVILEGED_TAIL_SIGNS = (1.0, -1.0, -1.0, 1.0, -1.0)
"""Signs of the last five values of `infos["privileged"]` in a left-right mirror image of the robot.

The values are the velocity (forward, lateral, yaw rate) and the pushing force (forward, lateral)."""
COMMAND_ON_PROBABILITY = (0.9, 0.25, 0.5)
"""Probabilities that a random command has a forward velocity, a lateral velocity, and a yaw rate other than zero."""
COMMAND_KEEP_PROBABILITY = 0.5
"""Probability that a component of a random command (forward, lateral, yaw rate) is copied from the last command."""
NO_TRUNCATION = np.iinfo(np.int64).max
"""Length limit of a first episode that must not be truncated early, control steps; no episode is as long."""


class MultiScenarioVectorEnv(CombinedVectorEnv):
    """Combines the vector environments of several scenarios into one, and collects statistics of the training.

    The first episodes can be truncated at random lengths, so that the robots are out of phase with each other. Finished
    robots are not restarted automatically. The return and the length (control steps) of each episode are in
    `infos["episode"]`, as in Gymnasium's RecordEpisodeStatistics.

    Args:
        batches: Vector environments, one for each scenario, made with `AutoresetMode.DISABLED`.
        first_episode_steps: Function that takes the seeds of the robots and returns the numbers of control steps after
            which their first episodes are truncated, (n,). None: first episodes have their full length.
        threads: Number of threads. Each thread steps the robots of one scenario at a time. Results do not depend on
            this number.
        has_privileged_observation: True if `infos["privileged"]` has the observation of the true state, for a policy
            that does not observe all of it.
    """

    def __init__(
        self,
        batches: Sequence[SimpleQuadVectorEnv],
        first_episode_steps: Callable[[Sequence[int] | None], NDArray[np.int64]] | None = None,
        threads: int = 1,
        has_privileged_observation: bool = False,
    ) -> None:
        super().__init__(batches, threads)
        n = self.num_envs
        self.metadata |= {"autoreset_mode": AutoresetMode.DISABLED}
        self._first_episode_steps = first_episode_steps or (lambda _: np.full(n, NO_TRUNCATION))
        self._first_truncation = np.full(n, NO_TRUNCATION)
        self._elapsed = np.zeros(n, np.int64)
        self._returns = np.zeros(n)
        self._fell = np.zeros(n, np.bool_)
        self._intervals = CommandIntervalTracker(n, self.dt)
        self._scenario_one_hot = np.repeat(
            np.eye(len(batches), dtype=np.float32), [batch.num_envs for batch in batches], axis=0
        )
        self._scale = observation_table(self.robot).scale
        self._has_privileged_observation = has_privileged_observation
        observed = len(self._scale) if has_privileged_observation else 0
        self.privileged_width = len(batches) + observed + 3 + 2
        """Number of values per robot in `infos["privileged"]`, the observation that only the value network receives.

        The values are the one-hot scenario, the scaled observation of the true state if the argument
        `has_privileged_observation` is True, the true velocity (3 values) and the pushing force (2 values)."""
        self._sums = defaultdict[str, float](float)
        self._interval_counts = np.zeros((2, len(batches)), np.int64)

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, Infos]:
        """Start the first episodes of all robots, or the next episodes of the robots in a "reset_mask".

        Args:
            seed: An integer; robot i then has the seed `seed + i`. Or a sequence with the seed of each robot.
            options: May have a "reset_mask": True for robots that start their next episode, (n,).

        Returns:
            Observation of all n robots, (n, m), with m numbers per robot; and infos.
        """
        seeds = range(seed, seed + self.num_envs) if isinstance(seed, int) else seed
        mask = (options or {}).get("reset_mask")
        chosen = np.ones(self.num_envs, np.bool_) if mask is None else mask
        observation, infos = super().reset(seed=seed, options=options)
        if mask is not None:
            self._count_episodes(mask)
        self._first_truncation[chosen] = NO_TRUNCATION if mask is not None else self._first_episode_steps(seeds)
        self._elapsed[chosen] = 0
        self._returns[chosen] = 0
        if mask is not None:
            self._count_intervals(*self._intervals.finish(chosen & ~self._fell))
        self._intervals.reset(chosen)
        infos["privileged"] = self._privileged(infos)
        return observation, infos

    def step(self, actions: FloatArray) -> Step:
        """Simulate one control step of all robots with joint targets `actions`, (n, 12), rad.

        Returns the observation, (n, m), with m numbers per robot; the rewards, (n,); the masks of terminated and of
        truncated episodes, each (n,); and the infos.
        """
        observation, rewards, terminated, truncated, infos = super().step(actions)
        self._elapsed += 1
        self._returns += rewards
        self._count_step(infos, rewards, terminated & ~self._fell)
        self._fell = terminated
        truncated |= self._elapsed >= self._first_truncation
        infos["episode"] = {"r": self._returns.copy(), "l": self._elapsed.copy()}
        infos["_episode"] = terminated | truncated
        infos["privileged"] = self._privileged(infos)
        return observation, rewards, terminated, truncated, infos

    def pop_statistics(self) -> dict[str, float]:
        """Return the statistics of all robots since the last call of this method, and clear them.

        Returns:
            Name of the statistic -> value. `velocity_error` (m/s), `yaw_rate_error` (rad/s) and `reward/TERM` are means
            over the control steps. `reward_rate` is the mean reward per second. `episodes` is the number of finished
            episodes. `return` is the mean return of the finished episodes, and `falls` the fraction of the finished
            episodes with a fall; both are NaN if no episode finished. `intervals` is the number of command intervals
            that ended. `tracked` is the fraction of these intervals in which the command was tracked; NaN if no
            interval ended.
        """
        sums, self._sums = self._sums, defaultdict(float)
        steps = max(sums.pop("steps", 0.0), 1.0)
        episodes = sums.pop("episodes", 0.0)
        intervals = sums.pop("intervals", 0.0)
        return {
            "episodes": episodes,
            "return": sums.pop("return", 0.0) / (episodes or float("nan")),
            "falls": sums.pop("falls", 0.0) / (episodes or float("nan")),
            "intervals": intervals,
            "tracked": sums.pop("tracked", 0.0) / (intervals or float("nan")),
            "reward_rate": sums.pop("reward", 0.0) / steps / self.dt,
            **{name: total / steps for name, total in sums.items()},
        }

    def finish_intervals(self) -> None:
        """End the command intervals of all robots and count them, before all robots start new episodes."""
        self._count_intervals(*self._intervals.finish(~self._fell))

    def pop_interval_counts(self) -> NDArray[np.int64]:
        """Return the numbers of ended (row 0) and of tracked (row 1) command intervals of each of b scenarios, (2, b).

        A command interval is the time during which the velocity command of a robot is constant. The method counts the
        intervals since its last call.
        """
        counts, self._interval_counts = self._interval_counts, np.zeros((2, len(self.batches)), np.int64)
        return counts

    def replace_batch(self, number: int, batch: SimpleQuadVectorEnv) -> None:
        """Replace the vector environment of a scenario, for example after a change of its difficulty.

        All robots must start new episodes afterwards.

        Args:
            number: Index of the environment in `batches`.
            batch: New vector environment, with the same number of robots.
        """
        self.batches[number].close()
        self.batches = (*self.batches[:number], batch, *self.batches[number + 1 :])

    def _combine_infos(self, infos: Sequence[Infos]) -> Infos:
        """Return the infos that every scenario has, for all robots; the readings of simulated sensors are left out."""
        shared = [key for key in infos[0] if all(key in batch_infos for batch_infos in infos)]
        return {key: np.concatenate([batch_infos[key] for batch_infos in infos]) for key in shared}

    def _privileged(self, infos: Infos) -> FloatArray:
        """Return the observations that only the value network receives, (n, `privileged_width`).

        The columns are the one-hot scenario, the scaled observation of the true state if required, the true velocity in
        the heading frame (forward, lateral, yaw rate; m/s and rad/s), and the push in the heading frame (forward,
        lateral) in units of `PUSH_SCALE`.
        """
        pushes = np.concatenate([_push(batch) for batch in self.batches], axis=1) / PUSH_SCALE
        columns = [self._scenario_one_hot, infos["heading_velocity"], pushes.T]
        if self._has_privileged_observation:
            columns.insert(1, self.true_observation() * self._scale)
        return np.concatenate(columns, axis=1, dtype=np.float32)

    def _count_step(self, infos: Infos, rewards: NDArray[np.float64], fell: BoolArray) -> None:
        """Add a control step of all robots, and the command intervals that end in it, to the statistics.

        `rewards`, (n,), are the rewards of the step; `fell`, (n,), is True for robots that fell in the step.
        """
        ended, tracked = self._intervals.step(infos["command"], infos["heading_velocity"], fell)
        self._count_intervals(ended, tracked)
        self._sums["reward"] += float(rewards.sum())
        error = infos["command"] - infos["heading_velocity"]
        self._sums["steps"] += len(error)
        self._sums["velocity_error"] += float(np.hypot(error[:, 0], error[:, 1]).sum())
        self._sums["yaw_rate_error"] += float(np.abs(error[:, 2]).sum())
        for key in infos:
            if key.startswith(REWARD):
                self._sums[f"reward/{key.removeprefix(REWARD)}"] += float(infos[key].sum())

    def _count_intervals(self, ended: BoolArray, tracked: BoolArray) -> None:
        """Add the command intervals of the robots in the mask `ended`, (n,), to the statistics.

        `tracked`, (n,), is True for robots that tracked the command of their interval.
        """
        self._sums["intervals"] += int(ended.sum())
        self._sums["tracked"] += int((ended & tracked).sum())
        starts = [part.start for part in self._parts]
        counts = np.stack((ended, ended & tracked)).astype(np.int64)
        self._interval_counts += np.add.reduceat(counts, starts, axis=1)

    def _count_episodes(self, finished: BoolArray) -> None:
        """Add the episodes of the robots for which the mask `finished`, (n,), is True to the statistics."""
        self._sums["episodes"] += int(finished.sum())
        self._sums["return"] += float(self._returns[finished].sum())
        self._sums["falls"] += int((finished & self._fell).sum())


def _push(batch: SimpleQuadVectorEnv) -> Array:
    """Return the pushing force on the trunk of each of n robots in the last step.

    The rows are the forward and the lateral component in the heading frame, (2, n), N.
    """
    if batch.scenario.pushes is None and batch.scenario.kicks is None:
        return np.zeros((2, batch.num_envs))
    rotation = rotation_matrix(to_components(batch.simulation.quaternion))
    return np.stack(to_heading(rotation, to_components(batch.simulation.push)))


def training_seeds(config: TrainConfig, segment: int = 0) -> list[int]:
    """Return the seeds of the episodes that all robots start at the beginning of a segment (part) of a training run.

    Args:
        config: Settings of the training run.
        segment: Index of the segment, see `segment_steps`. Every segment has different seeds.

    Returns:
        One seed for each robot.
    """
    count = config.ppo.envs
    return list(map(int, episode_seeds("training", config.seed, count * (segment + 1))[-count:]))


def segment_steps(config: TrainConfig) -> int:
    """Return the length of a segment of a training run in learner steps, summed over all robots.

    All robots start new episodes at the start of a segment. So a run can be resumed at this time, although the states
    of the robots are not saved. A segment consists of whole rollouts and is about as long as the longest episode.
    """
    ppo = config.ppo
    rollouts = max(round(config.max_episode_steps / (ppo.hold * ppo.rollout_steps)), 1)
    return rollouts * ppo.rollout_steps * ppo.envs


def make_robots(config: TrainConfig) -> MultiScenarioVectorEnv:
    """Make the simulated robots of a training run, distributed over the scenarios of the mixture.

    The first episodes are truncated after random numbers of steps, so that the robots are out of phase. These numbers
    follow from the seeds of the robots.
    """

    def sample_first_lengths(seeds: Sequence[int] | None) -> NDArray[np.int64]:
        return np.random.default_rng(seeds).integers(1, config.max_episode_steps, config.ppo.envs, endpoint=True)

    effort = effort_weight_scale(config, 0)
    count = len(robots_per_scenario(config))
    batches = [make_batch(config, number, config.curriculum, effort) for number in range(count)]
    threads = config.threads if uses_batch_threads(config) else 1
    return MultiScenarioVectorEnv(batches, sample_first_lengths, threads, bool(config.inputs.terms))


def robots_per_scenario(config: TrainConfig) -> dict[str, int]:
    """Return the number of robots that train on each scenario, scenario name -> number; see `distribute_robots`."""
    return distribute_robots(config.mixture, config.ppo.envs, config.hardware.robot_model)


def distribute_robots(mixture: Sequence[tuple[str, float]], count: int, robot: Robot) -> dict[str, int]:
    """Distribute robots over the scenarios of a mixture, in proportion to the shares of the scenarios.

    `allocate_robots` rounds the shares to whole robots. Scenarios with zero robots are left out. Scenarios with the
    robot's hardware profile (motors, delays and sensors of the real robot) come last.

    Args:
        mixture: Name and share of each scenario. A share is a relative weight.
        count: Number of robots.
        robot: Robot to which the scenarios are scaled.

    Returns:
        Name of each scenario -> number of robots on it. The sum of the numbers is `count`.
    """
    counts = allocate_robots([share for _, share in mixture], count)
    groups = [(name, robots) for (name, _), robots in zip(mixture, counts, strict=True)]
    ordered = sorted(groups, key=lambda group: find_scenario(group[0], robot).hardware)
    return {name: robots for name, robots in ordered if robots}


def make_base(config: TrainConfig, hardware_profile: bool = False) -> Policy:
    """Make a new instance of the base policy, which the trained network corrects.

    Args:
        config: Settings of the training run.
        hardware_profile: True to make the policy for scenarios with the robot's hardware profile, which are the motors,
            delays and sensors of the real robot. The servo gains of the policy do not depend on this argument.

    Returns:
        The base policy, with the servo gains of the run. A pose, the base of an end-to-end policy, has the
        gains of the robot.
    """
    make = partial(config.hardware.policy, config.base, height_scan=config.height_scan)
    robot = config.hardware.robot_model
    base = make(robot=robot.with_servo() if config.policy == "end-to-end" else robot)
    return make(on_hardware_profile=True, robot=base.robot) if hardware_profile else base


def make_bases(config: TrainConfig) -> list[tuple[Policy, int]]:
    """Make the base policies of a training run, each with its number of robots.

    The first policy is for scenarios without the robot's hardware profile, and the second for scenarios with it. The
    profile has the motors, delays and sensors of the real robot. A policy for zero robots is left out.
    """
    counts = [0, 0]
    for name, count in robots_per_scenario(config).items():
        counts[_uses_hardware_profile(config, name)] += count
    return [
        (make_base(config, bool(hardware_profile)), count) for hardware_profile, count in enumerate(counts) if count
    ]


def _uses_hardware_profile(config: TrainConfig, name: str) -> bool:
    """Return True if the scenario called `name` simulates the motors, delays and sensors of the real robot."""
    return find_scenario(name, config.hardware.robot_model).hardware


def uses_batch_threads(config: TrainConfig) -> bool:
    """Return True if different threads step the robots of different scenarios at the same time.

    There must be at least as many scenarios as threads. Otherwise the scenarios are stepped in turn, and all threads
    share the robots of one scenario.
    """
    return len(robots_per_scenario(config)) >= config.threads


def effort_weight_scale(config: TrainConfig, steps: int) -> float:
    """Return the factor on the weights of the reward terms of effort, `EFFORT_TERMS`, at a step of a training run.

    Args:
        config: Settings of the training run.
        steps: Learner steps since the start of the run, summed over all robots.

    Returns:
        The factor, which rises linearly from 0 to 1, see `TrainConfig.effort_ramp`.
    """
    ramp = config.effort_ramp * config.steps
    return min(steps / ramp, 1.0) if ramp else 1.0


def with_training_options(scenario: Scenario, config: TrainConfig) -> Scenario:
    """Return a scenario with the kicks and the random velocity commands of a training run, if the run has them.

    Args:
        scenario: Scenario of the training.
        config: Settings of the training run. A kick is a short horizontal force on the trunk.

    Returns:
        The scenario, unchanged if the options `commands` and `kicks` have their default values.
    """
    if config.commands == "random":
        commands = dataclasses.replace(
            scenario.commands,
            random_intervals=True,
            on_probability=COMMAND_ON_PROBABILITY,
            keep_probability=COMMAND_KEEP_PROBABILITY,
        )
        scenario = dataclasses.replace(scenario, commands=commands)
    return dataclasses.replace(scenario, kicks=Kicks(speed=config.kicks)) if config.kicks else scenario


def make_batch(config: TrainConfig, number: int, share: float, effort: float = 1.0) -> SimpleQuadVectorEnv:
    """Make the vector environment of the robots that train on one scenario.

    Args:
        config: Settings of the training run.
        number: Index of the scenario in `robots_per_scenario`.
        share: Difficulty of the scenario, from 0 to 1, see `at_difficulty`.
        effort: Factor on the weights of the reward terms of effort, from 0 to 1, see `effort_weight_scale`.

    Returns:
        The vector environment.
    """
    name, count = list(robots_per_scenario(config).items())[number]
    robot = config.hardware.robot_model
    base = make_base(config)
    scenario = with_terrain_seed(at_difficulty(find_scenario(name, robot), share, robot), "training", config.seed)
    scenario = with_training_options(scenario, config)
    effort_weights = {term: effort * getattr(config.rewards, term) for term in EFFORT_TERMS}
    task = TaskConfig(
        timestep=config.timestep,
        solver_iterations=config.solver_iterations if config.device == "cpu" else None,
        physics=config.physics,
        reward_weights=dataclasses.replace(config.rewards, **effort_weights),
    )
    env_kwargs = config.hardware.env_kwargs(base.robot)
    if config.device == "cuda":
        env_kwargs["simulator"] = WARP
    return SimpleQuadVectorEnv(
        count,
        scenario,
        1 if uses_batch_threads(config) else config.threads,
        AutoresetMode.DISABLED,
        max_episode_steps=config.max_episode_steps,
        config=task,
        height_scan=base.height_scan,
        rewards=dict(config.extension_rewards),
        **env_kwargs,
    )
