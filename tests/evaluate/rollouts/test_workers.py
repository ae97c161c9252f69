"""Worker processes give the results of one process, and end with the evaluation in every case."""

import os
import signal
import subprocess
import sys
import threading
import time
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnProcess
from pathlib import Path

import numpy as np
import pytest

import policies
from evaluate.__main__ import main
from evaluate.cells import LabelledPolicy, Task, evaluation_seeds
from evaluate.hardware import IDEAL
from evaluate.measures.metrics import MEASURE_NAMES
from evaluate.rollouts import workers
from evaluate.rollouts.run import sequential
from quad_env import SCENARIOS
from tests.seams import short_episodes
from tests.waiting import until

STEPS = 110


class Deadly(type(policies.make("stand"))):
    """Policy that kills its process in `act`."""

    def act(self, observation):
        os.kill(os.getpid(), signal.SIGKILL)


class Failing(type(policies.make("stand"))):
    """Policy that raises in `act`."""

    def act(self, observation):
        raise ZeroDivisionError("a bug")


def tasks(*labelled: LabelledPolicy, scenario: str = "push") -> list[Task]:
    seeds = evaluation_seeds(0, 6)
    chunks = (np.arange(4), np.arange(4, 6))
    return [
        Task(policy, SCENARIOS[scenario], numbers, seeds[numbers], STEPS, IDEAL)
        for policy in labelled
        for numbers in chunks
    ]


def labelled(*names: str) -> list[LabelledPolicy]:
    return [LabelledPolicy(name, policies.resolve(name)) for name in names]


@pytest.fixture(autouse=True)
def always(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use workers for any number of episodes."""
    monkeypatch.setattr(workers, "MIN_PARALLEL_STEPS", 0)


def test_workers_give_the_same_bits_as_one_process_and_tell_how_far_they_are() -> None:
    every = tasks(*labelled("residual", "document"))
    told: list[tuple[int, float]] = []
    apart = dict(workers.process_pool(2)(every, lambda place, share: told.append((place, share))))
    alone = dict(sequential(1)(every, lambda *_: None))
    assert set(apart) == set(alone) == set(range(len(every)))
    for place, chunk in alone.items():
        other = apart[place]
        np.testing.assert_array_equal(other.episode_indices, chunk.episode_indices)
        np.testing.assert_array_equal(other.cell.fall_reason, chunk.cell.fall_reason)
        for name in MEASURE_NAMES:
            ours, theirs = getattr(chunk.cell.measures, name), getattr(other.cell.measures, name)
            assert ours.tolist() == theirs.tolist() if ours.dtype == object else ours.tobytes() == theirs.tobytes(), (
                name
            )
    assert {place for place, _ in told} == set(alone)
    assert all(0.0 <= share < 1.0 for _, share in told)


def test_a_lost_worker_is_one_line(tmp_path, monkeypatch, capsys) -> None:
    short_episodes(monkeypatch, STEPS)
    run = ["--policies", "stand", "trot", "--scenarios", "flat", "push", "--episodes", "4"]
    resolve = policies.resolve
    monkeypatch.setattr(policies, "resolve", lambda name, **how: Deadly() if name == "trot" else resolve(name, **how))
    assert main([*run, "--threads", "2", "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("error: a worker process was killed")
    assert error.endswith(f"--resume --out {tmp_path}" if (tmp_path / "parts").exists() else "nothing was done yet")


def test_a_worker_that_cannot_be_begun_is_said_so_and_the_others_end(monkeypatch) -> None:
    start, begun = SpawnProcess.start, []

    def full(process):
        if begun:
            raise BlockingIOError(11, "Resource temporarily unavailable")
        start(process)
        begun.append(process.pid)

    monkeypatch.setattr(SpawnProcess, "start", full)
    with pytest.raises(workers.WorkerDiedError, match="cannot be started \\(Resource temporarily unavailable"):
        list(workers.process_pool(2)(tasks(*labelled("stand")), lambda *_: None))
    assert not runs(*begun)


class Stuck(type(policies.make("stand"))):
    """Policy that never returns from `act`."""

    def act(self, observation):
        threading.Event().wait()


def children(process: int) -> set[int]:
    """Return the process ids of the children of a process."""
    texts = [path.read_text(encoding="utf-8") for path in Path(f"/proc/{process}/task").glob("*/children")]
    return {int(number) for text in texts for number in text.split()}


def runs(process: int) -> bool:
    """Return True if a process exists and is not a zombie."""
    try:
        return Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
@pytest.mark.parametrize("stopped", [ZeroDivisionError, KeyboardInterrupt])
def test_a_worker_that_never_returns_ends_with_an_error_and_with_ctrl_c(monkeypatch, stopped) -> None:
    """An error of another worker is raised with its type; Ctrl-C comes from the check."""
    monkeypatch.setattr(workers, "SHUTDOWN_TIMEOUT", 0.5)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    both = [*tasks(LabelledPolicy("stuck", Stuck()))[:1], *tasks(LabelledPolicy("failing", Failing()))[:1]]
    asked = iter([None, None])

    def check() -> None:
        if stopped is KeyboardInterrupt and next(asked, "enough"):
            raise KeyboardInterrupt

    before = children(os.getpid())
    with pytest.raises(stopped):
        list(workers.process_pool(2, check)(both[:1] * 2 if stopped is KeyboardInterrupt else both, lambda *_: None))
    assert not any(map(runs, children(os.getpid()) - before - {resource_tracker._resource_tracker._pid}))
    assert os.environ["OPENBLAS_NUM_THREADS"] == "3"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_workers_leave_when_the_evaluation_is_killed(repository, tmp_path, running) -> None:
    command = [sys.executable, "-m", "evaluate", "--policies", "trot", "stand", "--scenarios", "flat", "push"]
    command += ["--episodes", "256", "--threads", "2", "--out", str(tmp_path)]
    with running(command, cwd=repository, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while len(workforce := children(process.pid)) < 3:  # two workers and the resource tracker of Python
            assert process.poll() is None
            time.sleep(0.01)
        time.sleep(0.5)
    until(lambda: not any(map(runs, workforce)), "orphans are left")
