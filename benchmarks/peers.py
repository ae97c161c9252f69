"""`python -m benchmarks.peers`: our batch against the usual wrappers of single environments, and Gymnasium's Ant-v5.

Within a table all take turns. The wrappers hold our own single environment, with the same seeds and actions as our
batch; Ant-v5 is in the same wrappers, with random actions.
"""

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.support import bare
from benchmarks.support.bars import check
from benchmarks.support.command import Common, Outcome, cell, command, table
from benchmarks.support.measure import Floats, Subject, cores, interleave, speed_ratio, spread
from quad_env import ENV_ID
from quad_env.cli.command_line import check_numbers
from quad_env.cli.launcher import launch

ANT = "Ant-v5"
OURS = "our batch"


@dataclass(frozen=True)
class Options(Common):
    """Steps a second of our batch and of its alternatives."""

    envs: int = 64
    """Environments in each wrapper (count)."""
    steps: int = 10
    """Control steps of each environment in a round (count)."""
    threads: int = cores()
    """Threads of our batch (count; default: this machine's cores); the wrappers take a process an environment."""


def measure(options: Options) -> Outcome:
    """Tables of our environment and of Ant-v5."""
    if options.quick:
        options = replace(options, rounds=1, envs=1, steps=2)
    check_numbers(options, {"steps": (1, 10**6)})
    seconds = _turns(ENV_ID, options)
    tables = [_compared(f"SimpleQuad-v0, {options.envs} environments", seconds)]
    figures: dict[str, Any] = {"ours": seconds}
    checks = tuple(
        check(bar, speed_ratio(seconds[OURS], seconds[name]).median)
        for bar, name in (("async", "AsyncVectorEnv"), ("subproc", "SubprocVecEnv"))
    )
    notes = []
    if missing := _ant_missing():
        notes.append(f"{ANT} is not measured: {missing}")
    else:
        figures["ant"] = _turns(ANT, options)
        tables.append(_compared(f"{ANT}, {options.envs} environments, a control step of 50 ms", figures["ant"]))
    return Outcome(figures, tuple(tables), checks if options.envs == 64 else (), tuple(notes))


def _turns(env_id: str, options: Options) -> dict[str, Floats]:
    """Seconds an environment step of our batch and of the four wrappers around `env_id`."""
    with contextlib.ExitStack() as stack:
        group = {name: stack.enter_context(opened) for name, opened in _wrappers(env_id, options)}
        return interleave(group, options.rounds, f"peers, {env_id}")


def _wrappers(env_id: str, options: Options) -> Iterator[tuple[str, Any]]:
    """Those that fork first, while this process has neither the batch's threads nor torch's."""
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

    def make() -> gym.Env[Any, Any]:
        return gym.make("quad_env:" + env_id if env_id == ENV_ID else env_id)

    makers = [make] * options.envs
    actions = _actions(env_id, options)
    yield "AsyncVectorEnv", _stepping(lambda: gym.vector.AsyncVectorEnv(makers), _reset_gymnasium, actions)
    yield "SyncVectorEnv", _stepping(lambda: gym.vector.SyncVectorEnv(makers), _reset_gymnasium, actions)
    yield "SubprocVecEnv", _stepping(lambda: SubprocVecEnv(makers), _reset_sb3, actions)
    yield "DummyVecEnv", _stepping(lambda: DummyVecEnv(makers), _reset_sb3, actions)
    ours = actions if env_id == ENV_ID else _actions(ENV_ID, options)
    yield OURS, _stepping(lambda: gym.make_vec(ENV_ID, options.envs, nthread=options.threads), _reset_gymnasium, ours)


def _actions(env_id: str, options: Options) -> Any:
    """Actions of all rounds, (rounds, steps, n, k): the trot's, or random ones for another robot."""
    steps = options.steps * (options.rounds + 1)
    if env_id == ENV_ID:
        rows = np.repeat(bare.walk(steps)[:, None], options.envs, axis=1)
    else:
        space = gym.make(env_id).action_space
        space.seed(0)
        rows = np.array([[space.sample() for _ in range(options.envs)] for _ in range(steps)])
    return rows.reshape(-1, options.steps, *rows.shape[1:])


@contextlib.contextmanager
def _stepping(make: Callable[[], Any], reset: Callable[[Any], None], actions: Any) -> Iterator[Subject]:
    """A subject that steps with the next round of these actions at every call."""
    env = make()
    rounds = iter(actions)
    try:
        reset(env)

        def steps() -> float:
            todo = next(rounds)
            begin = time.perf_counter()
            for action in todo:
                env.step(action)
            return (time.perf_counter() - begin) / float(todo.shape[0] * todo.shape[1])

        yield steps
    finally:
        env.close()


def _reset_gymnasium(env: Any) -> None:
    env.reset(seed=0)


def _reset_sb3(env: Any) -> None:
    env.seed(0)
    env.reset()


def _ant_missing() -> str | None:
    """Why there is no Ant-v5, or None."""
    try:
        gym.make(ANT).close()
    except (ImportError, gym.error.Error) as error:
        return f"{error} (pip install 'gymnasium[mujoco]')"
    return None


def _compared(title: str, seconds: dict[str, Floats]) -> Any:
    rows = table(title, "", "µs an environment step", "environment steps/s", f"{OURS} is faster by")
    for name, values in seconds.items():
        times = "" if name == OURS else cell(speed_ratio(seconds[OURS], values))
        rows.add_row(name, cell(spread(values).scaled(1e6), 1), f"{1 / spread(values).median:,.0f}", times)
    return rows


main = command(Options, measure, "benchmarks.peers", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
