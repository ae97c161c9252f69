"""Rollout: the one loop in which a policy and n robots step, one episode a robot, watched by observers.

One episode an environment, so that short ones are never over-counted.
"""

from collections.abc import Callable, Generator
from contextlib import closing
from typing import TYPE_CHECKING

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
"""Control steps of a full episode."""
REPORT_EVERY = 25
"""Control steps between two calls of the progress callback."""

Progress = Callable[[float], None]
"""Receives the share of the run that is done, 0 … 1; 1 exactly once, at the end."""


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
    """One episode of `policy` for each seed, all side by side; every observer receives each step.

    It ends after `steps` control steps, when no robot moves any more, or when an observer says so. A robot that has
    fallen stays frozen to the end; without `terminate_on_fall` it goes on. What comes before its fall is the same to
    the bit either way. `command`, (3,) or (n, 3), is held for the whole episode; without, the scenario draws commands.
    Raises ValueError for a policy that was made for another robot or another control period.
    """
    env = batch_of(
        policy,
        scenario,
        len(seeds),
        steps=steps,
        nthread=nthread,
        terminate_on_fall=terminate_on_fall,
        hardware=hardware,
    )
    with closing(_steps(policy, env, seeds, command)) as taken:
        for step in taken:
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
    """The start and the control steps of one episode, each simulated on demand: several policies' episodes can
    go side by side. A robot that has fallen goes on; otherwise as in `roll_out`."""
    env = batch_of(policy, scenario, 1, steps=steps, nthread=1, terminate_on_fall=False, hardware=hardware)
    yield from _steps(policy, env, np.array([seed]), command)


def _steps(
    policy: Policy, env: "SimpleQuadVectorEnv", seeds: NDArray[np.int64], command: ArrayLike | None
) -> Generator[Step]:
    """The start and the control steps of one episode for each seed; the environment is closed at the end."""
    with closing(env):
        policy.check_compatible(env.robot, env.dt)
        step, ended = reset_episodes(env, seeds, command), False
        policy.reset(num_envs=len(seeds), seed=0)
        yield step
        while not ended:
            step, ended = advance(step, policy.act(step.observation))
            yield step


def batch_of(
    policy: Policy,
    scenario: str | Scenario,
    count: int,
    *,
    steps: int | None,
    nthread: int,
    terminate_on_fall: bool = True,
    hardware: HardwareConfig = IDEAL,
) -> "SimpleQuadVectorEnv":
    """`count` robots whose readings observers get, for episodes of so many control steps, or without a time limit."""
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
    """Start of an episode for each seed; see `roll_out` for the command."""
    options = None if command is None else {"command": command}
    observation, infos = env.reset(seed=seeds.tolist(), options=options)
    return Step(0, env, infos["action"].astype(np.float32), observation, infos)


def advance(step: Step, action: Actions) -> tuple[Step, bool]:
    """The next control step, and whether no robot moves any more."""
    observation, _, terminated, truncated, infos = step.env.step(action)
    return Step(step.number + 1, step.env, action, observation, infos), bool((terminated | truncated).all())


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
    """The record of one episode of `policy` for each seed."""
    recorder = EpisodeRecorder(policy, seeds, steps)

    def report(step: Step) -> None:
        if step.number < steps and step.number % REPORT_EVERY == 0:
            progress(step.number / steps)

    roll_out(policy, scenario, seeds, recorder, report, steps=steps, nthread=nthread, hardware=hardware)
    progress(1.0)
    return recorder.episodes()


class EpisodeRecorder:
    """Observer that records episodes, for measures to be computed from: arrays with a row a control step."""

    def __init__(self, policy: Policy | None, seeds: NDArray[np.int64], steps: int) -> None:
        self._policy, self._seeds, self._steps = policy, seeds, steps
        self.falls = FallRecorder(len(seeds), steps)
        """By now."""
        self._failure = np.full(len(seeds), None, dtype=object)
        self._failure_step = np.full(len(seeds), steps, np.int64)

    def __call__(self, step: Step) -> None:
        """Record a control step."""
        if step.number == 0:
            self._env, robot = step.env, step.env.robot
            absent = [name for name in POLICY_SIGNALS if getattr(self._policy, name, None) is None]
            absent += [OBSERVED_SIGNAL] * step.env.observes_true_state
            table = step.env.observation_table.slices
            self._given = np.concatenate([np.arange(table[name].start, table[name].stop) for name in OBSERVED])
            names = [name for name in shapes(robot) if name not in absent]
            self._signals = {name: empty_signal(robot, name, self._steps, len(self._seeds)) for name in names}
            return
        if (failure := getattr(self._policy, "failure", None)) is not None:
            self._failure = np.where(self.falls.fell, self._failure, failure)
            failed = [reason is not None for reason in self._failure]
            np.minimum(self._failure_step, step.number - 1, out=self._failure_step, where=failed)
        self.falls(step)
        now = step.infos | {OBSERVED_SIGNAL: step.observation[:, self._given]}
        for name, signal in self._signals.items():
            signal[step.number - 1] = getattr(self._policy, name) if name in POLICY_SIGNALS else now[name]

    def episodes(self) -> Episodes:
        """The record; of steps that were not recorded, zeros."""
        env, falls, meter = self._env, self.falls, self._env.simulation.meter
        assert meter is not None, "an environment without readings"
        return Episodes(
            robot=env.robot,
            seeds=self._seeds,
            **dict.fromkeys((*POLICY_SIGNALS, OBSERVED_SIGNAL)) | self._signals,  # type: ignore[arg-type]
            push_step=env.pushes.first_step.copy(),
            push_impulse=env.pushes.force * (env.pushes.steps * env.dt),
            push_steps=env.pushes.steps,
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
