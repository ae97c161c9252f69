"""Rollout loop: a policy controls n robots for one episode each, and observers receive every step.

Each robot runs exactly one episode. If fallen robots were restarted, short episodes would get too much weight.
"""

from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evaluate.hardware import IDEAL, HardwareConfig
from evaluate.measures.episodes import OBSERVED, OBSERVED_SIGNAL, POLICY_SIGNALS, Episodes, empty_signal, shapes, weight
from evaluate.rollouts.observers import FallRecorder, Observer, Step
from policies.base import Actions, Policy
from quad_env.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from quad_env.envs.vector_env import SimpleQuadVectorEnv

STEPS = 1000
"""Number of control steps of an episode up to the time limit."""
REPORT_PERIOD = 25
"""Number of control steps of a rollout between two calls of the progress function."""

Progress = Callable[[float], None]
"""Function that receives the finished fraction of a rollout, 0 … 1, and shows it to the user.

It receives the value 1 exactly once, at the end of the rollout.
"""


def roll_out(
    policy: Policy,
    scenario: str | Scenario,
    seeds: NDArray[np.int64],
    *observers: Observer,
    steps: int = STEPS,
    nthread: int = 1,
    command: ArrayLike | None = None,
    terminate_on_fall: bool = True,
    hardware: HardwareConfig = IDEAL,
) -> None:
    """Run one episode for each seed in parallel, until all episodes end or an observer ends the rollout.

    ValueError is raised if the policy was made for another robot or control period.

    Args:
        policy: Policy that controls all robots.
        scenario: Scenario or its name.
        seeds: Seeds of the episodes, (n,).
        *observers: Functions that receive the start and every control step; see `Observer`.
        steps: Maximum number of control steps.
        nthread: Number of threads with which the robots are simulated.
        command: Constant command for all robots, (3,), or for each robot, (n, 3): forward and lateral velocity, m/s,
            and yaw rate, rad/s. If it is None, the commands of the scenario are used.
        terminate_on_fall: True if a robot is frozen when it falls. The control steps before the fall do not depend on
            this argument.
        hardware: Names of robot, servo gains, motor model, sensor model, state estimator and simulator.
    """
    env = make_env(
        policy,
        scenario,
        len(seeds),
        steps=steps,
        nthread=nthread,
        terminate_on_fall=terminate_on_fall,
        hardware=hardware,
    )
    with closing(_iterate_steps(policy, env, seeds, command)) as episode:
        for step in episode:
            stop_requested = [observer(step) for observer in observers]
            if any(stop_requested):
                return


def iterate_episode(
    policy: Policy,
    scenario: str | Scenario,
    seed: int,
    *,
    steps: int,
    command: ArrayLike | None = None,
    hardware: HardwareConfig = IDEAL,
) -> Generator[Step]:
    """Iterate over the control steps of one episode; a robot that has fallen keeps moving.

    Each control step is simulated when the caller requests it.

    Args:
        policy: Policy that controls the robot.
        scenario: Scenario or its name.
        seed: Seed of the episode.
        steps: Maximum number of control steps.
        command: Constant command: forward and lateral velocity, m/s, and yaw rate, rad/s, (3,). If it is None, the
            commands of the scenario are used.
        hardware: Names of robot, servo gains, motor model, sensor model, state estimator and simulator.

    Yields:
        The start of the episode and every control step.
    """
    env = make_env(policy, scenario, 1, steps=steps, nthread=1, terminate_on_fall=False, hardware=hardware)
    yield from _iterate_steps(policy, env, np.array([seed]), command)


def _iterate_steps(
    policy: Policy, env: "SimpleQuadVectorEnv", seeds: NDArray[np.int64], command: ArrayLike | None
) -> Generator[Step]:
    """Yield the start and all control steps of n episodes, and close the environment at the end.

    Args:
        policy: Policy that controls all robots.
        env: Environment with one robot for each seed.
        seeds: Seeds of the episodes, (n,).
        command: Constant command for all robots, (3,), or for each robot, (n, 3): forward and lateral velocity, m/s,
            and yaw rate, rad/s. If it is None, the commands of the scenario are used.

    Yields:
        The start of the episodes and every control step.
    """
    with closing(env):
        policy.check_compatible(env.robot, env.dt)
        step = reset_episodes(env, seeds, command)
        policy.reset(num_envs=len(seeds), seed=0)
        yield step
        is_finished = False
        while not is_finished:
            step, is_finished = advance(step, policy.act(step.observation))
            yield step


def make_env(
    policy: Policy,
    scenario: str | Scenario,
    count: int,
    *,
    steps: int | None,
    nthread: int,
    terminate_on_fall: bool = True,
    hardware: HardwareConfig = IDEAL,
) -> "SimpleQuadVectorEnv":
    """Make an environment with the observations of the policy and the readings that observers record.

    Args:
        policy: Policy that will control the robots.
        scenario: Scenario or its name.
        count: Number of robots.
        steps: Maximum number of control steps of an episode; None for no limit.
        nthread: Number of threads with which the robots are simulated.
        terminate_on_fall: True if a robot is frozen when it falls.
        hardware: Names of robot, servo gains, motor model, sensor model, state estimator and simulator.

    Returns:
        An environment that does not reset a robot when its episode ends.
    """
    from quad_env.envs.vector_env import SimpleQuadVectorEnv

    return SimpleQuadVectorEnv(
        count,
        scenario=scenario,
        nthread=nthread,
        autoreset_mode="DISABLED",
        max_episode_steps=steps,
        terminate_on_fall=terminate_on_fall,
        readings=True,
        height_scan=policy.height_scan,
        observations=policy.observations,
        **hardware.env_kwargs(policy.robot),
    )


def reset_episodes(env: "SimpleQuadVectorEnv", seeds: NDArray[np.int64], command: ArrayLike | None) -> Step:
    """Reset the environment: start an episode for each seed.

    Args:
        env: Environment with one robot for each seed.
        seeds: Seeds of the episodes, (n,).
        command: Constant command for all robots, (3,), or for each robot, (n, 3): forward and lateral velocity, m/s,
            and yaw rate, rad/s. If it is None, the commands of the scenario are used.

    Returns:
        State of the robots at the start, as control step 0.
    """
    options = None if command is None else {"command": command}
    observation, infos = env.reset(seed=seeds.tolist(), options=options)
    return Step(0, env, infos["action"].astype(np.float32), observation, infos)


def advance(step: Step, action: Actions) -> tuple[Step, bool]:
    """Simulate one control step of all robots.

    Args:
        step: Previous control step, which contains the environment.
        action: Joint targets, (n, 12), rad.

    Returns:
        The next control step, and True if the episodes of all robots have ended.
    """
    observation, _, terminated, truncated, infos = step.env.step(action)
    return Step(step.number + 1, step.env, action, observation, infos), bool((terminated | truncated).all())


class ScenarioEpisodes(NamedTuple):
    """Episodes to simulate on one scenario."""

    scenario: str | Scenario
    """Scenario or its name."""
    seeds: NDArray[np.int64]
    """Seeds of the n episodes, (n,)."""
    hardware: HardwareConfig = IDEAL
    """Names of robot, servo gains, motor model, sensor model, state estimator and simulator."""


def run(
    policy: Policy,
    scenario: str | Scenario,
    seeds: NDArray[np.int64],
    *,
    nthread: int = 1,
    steps: int = STEPS,
    progress: Progress = lambda _: None,
    hardware: HardwareConfig = IDEAL,
) -> Episodes:
    """Run one episode of a policy for each seed, and record the signals of all control steps.

    Args:
        policy: Policy that controls all robots.
        scenario: Scenario or its name.
        seeds: Seeds of the episodes, (n,).
        nthread: Number of threads with which the robots are simulated.
        steps: Maximum number of control steps of an episode.
        progress: Function that receives the finished fraction, 0 … 1.
        hardware: Names of robot, servo gains, motor model, sensor model, state estimator and simulator.

    Returns:
        The recorded signals of all episodes.
    """
    batch = ScenarioEpisodes(scenario, seeds, hardware)
    (episodes,) = run_scenarios(policy, [batch], nthread=nthread, steps=steps, progress=progress)
    return episodes


def run_scenarios(
    policy: Policy,
    batches: Sequence[ScenarioEpisodes],
    *,
    nthread: int = 1,
    steps: int = STEPS,
    progress: Progress = lambda _: None,
    observe_falls: Callable[[NDArray[np.bool_]], bool] = lambda _: False,
) -> list[Episodes]:
    """Run the episodes of a policy on several scenarios together, and record the signals of all control steps.

    In each control step, one call of the policy gives the actions of all robots, ordered by scenario. A call for each
    scenario would be slower, because the time of a call depends little on the number of robots.

    Args:
        policy: Policy that controls all robots.
        batches: Episodes on each scenario.
        nthread: Number of threads with which the robots are simulated.
        steps: Maximum number of control steps of an episode.
        progress: Function that receives the finished fraction, 0 … 1.
        observe_falls: Function that is called at the start and after each control step. It receives True for robots
            that have fallen or have a diverged simulation, (m,). It returns True to end the episodes.

    Returns:
        The recorded signals of the episodes on each scenario.
    """
    with ExitStack() as stack:
        running = []
        first_row = 0
        for batch in batches:
            running.append(_RunningBatch(policy, batch, first_row, nthread=nthread, steps=steps))
            stack.enter_context(closing(running[-1].env))
            policy.check_compatible(running[-1].env.robot, running[-1].env.dt)
            first_row += len(batch.seeds)
        for each in running:
            each.reset()
        policy.reset(num_envs=first_row, seed=0)
        for each in running:
            each.recorder(each.step)
        for number in range(steps):
            if number % REPORT_PERIOD == 0:
                progress(number / steps)
            active = [each for each in running if not each.has_ended]
            if observe_falls(np.concatenate([each.has_fallen for each in running])) or not active:
                break
            actions = policy.act(np.concatenate([each.step.observation for each in running]))
            for each in active:
                each.advance(actions)
    progress(1.0)
    return [each.recorder.episodes() for each in running]


class _RunningBatch:
    """Running episodes on one scenario, with the recorder of their signals.

    Args:
        policy: Policy that controls the robots of all scenarios.
        batch: Scenario and seeds of the n episodes.
        first_row: Index of the first robot among the robots of all scenarios.
        nthread: Number of threads with which the robots are simulated.
        steps: Maximum number of control steps of an episode.
    """

    def __init__(self, policy: Policy, batch: ScenarioEpisodes, first_row: int, *, nthread: int, steps: int) -> None:
        scenario, seeds, hardware = batch
        self.env = make_env(policy, scenario, len(seeds), steps=steps, nthread=nthread, hardware=hardware)
        self._seeds = seeds
        self._rows = slice(first_row, first_row + len(seeds))
        self.recorder = EpisodeRecorder(policy, seeds, steps, self._rows)
        self.has_ended = False
        """True if the episodes of all robots have ended."""

    def reset(self) -> None:
        """Start an episode for each seed."""
        self.step = reset_episodes(self.env, self._seeds, None)

    def advance(self, actions: Actions) -> None:
        """Simulate one control step with the `actions` of the robots of all scenarios, (m, 12), rad, and record it."""
        self.step, self.has_ended = advance(self.step, actions[self._rows])
        self.recorder(self.step)

    @property
    def has_fallen(self) -> NDArray[np.bool_]:
        """True for robots that have fallen, or that have a diverged simulation, (n,)."""
        return np.asarray((self.step.infos["fall"] > 0) | self.step.infos["diverged"])


class EpisodeRecorder:
    """Observer of a rollout that records the signals of n episodes, one row for each control step.

    Args:
        policy: Policy that controls the robots.
        seeds: Seeds of the episodes, (n,).
        steps: Maximum number of control steps of an episode.
        rows: Range of the n robots among the robots of the policy.
    """

    def __init__(self, policy: Policy, seeds: NDArray[np.int64], steps: int, rows: slice = slice(None)) -> None:
        self._policy = policy
        self._rows = rows
        self._seeds = seeds
        self._steps = steps
        self.falls = FallRecorder(len(seeds), steps)
        """Recorder of the falls of the n robots."""
        self._failure = np.full(len(seeds), None, dtype=object)
        self._failure_step = np.full(len(seeds), steps, np.int64)

    def __call__(self, step: Step) -> None:
        """Record the signals of a control step; if the step is the start, allocate the arrays instead."""
        if step.number == 0:
            self._allocate(step)
            return
        self._record_failure(step)
        self.falls(step)
        values = step.infos | {OBSERVED_SIGNAL: step.observation[:, self._observed_ids]}
        for name, signal in self._signals.items():
            is_of_policy = name in POLICY_SIGNALS
            signal[step.number - 1] = getattr(self._policy, name)[self._rows] if is_of_policy else values[name]

    def _allocate(self, start: Step) -> None:
        """Allocate an array for each signal that the environment and the policy provide."""
        self._env = start.env
        robot = start.env.robot
        absent = [name for name in POLICY_SIGNALS if getattr(self._policy, name, None) is None]
        if start.env.observes_true_state:
            absent.append(OBSERVED_SIGNAL)
        slices = start.env.observation_table.slices
        self._observed_ids = np.concatenate([np.arange(slices[name].start, slices[name].stop) for name in OBSERVED])
        self._signals = {
            name: empty_signal(robot, name, self._steps, len(self._seeds))
            for name in shapes(robot)
            if name not in absent
        }

    def _record_failure(self, step: Step) -> None:
        """Record the errors that the policy reports in a control `step`, for robots that have not fallen."""
        if (failure := getattr(self._policy, "failure", None)) is None:
            return
        self._failure = np.where(self.falls.fell, self._failure, failure[self._rows])
        has_failed = [reason is not None for reason in self._failure]
        np.minimum(self._failure_step, step.number - 1, out=self._failure_step, where=has_failed)

    def episodes(self) -> Episodes:
        """Return the recorded episodes; signals are zero in control steps that were not simulated.

        Returns:
            The recorded signals.

        Raises:
            ValueError: The scenario has kicks (short random forces on the trunk) or random command intervals, for which
                no measure is defined.
        """
        env = self._env
        falls = self.falls
        meter = env.simulation.meter
        assert meter is not None, "an environment without readings"
        push_steps = env.pushes.steps
        if not isinstance(push_steps, int) or env.scenario.commands.random_intervals:
            raise ValueError(f"scenario {env.scenario.name}: kicks and random command intervals are for training only")
        return Episodes(
            robot=env.robot,
            seeds=self._seeds,
            **dict.fromkeys((*POLICY_SIGNALS, OBSERVED_SIGNAL)) | self._signals,  # type: ignore[arg-type]
            push_step=env.pushes.first_step.copy(),
            push_impulse=env.pushes.force * (push_steps * env.dt),
            push_steps=push_steps,
            fall_step=falls.step,
            fall_reason=falls.reason,
            divergence_step=falls.divergence_step,
            weight=weight(env.robot, env.scenario),
            torque_limit=tuple(meter.torque_limit.tolist()),
            speed_limit=tuple(meter.speed_limit.tolist()),
            dt=env.dt,
            command_steps=env.scenario.commands.steps(env.dt),
            failure=self._failure,
            failure_step=self._failure_step,
            scenario=env.scenario,
        )
