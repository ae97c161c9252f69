"""Workers: the same outcome as in one process, and nothing left running however the evaluation ends."""

import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import fields
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnProcess
from pathlib import Path

import numpy as np
import pytest

import policies
from evaluate.__main__ import main
from evaluate.measures.metrics import Measures
from evaluate.rollouts import workers
from evaluate.rollouts.experiment import Chunk, LabelledPolicy, Task, evaluation_seeds, sequential
from evaluate.rollouts.hardware import IDEAL
from quad_env import SCENARIOS
from tests.waiting import until

STEPS = 110


class Deadly(type(policies.make("stand"))):
    """Kills the process that it is asked to act in."""

    def act(self, observation):
        os.kill(os.getpid(), signal.SIGKILL)


class Failing(type(policies.make("stand"))):
    """Has a bug."""

    def act(self, observation):
        raise ZeroDivisionError("a bug")


def tasks(*labelled: LabelledPolicy, scenario: str = "push") -> list[Task]:
    seeds = evaluation_seeds(0, 6)
    chunks = (np.arange(4), np.arange(4, 6))
    return [
        Task(policy, SCENARIOS[scenario], numbers, seeds[numbers], STEPS, None, IDEAL)
        for policy in labelled
        for numbers in chunks
    ]


def labelled(*names: str) -> list[LabelledPolicy]:
    return [LabelledPolicy(name, policies.resolve(name)) for name in names]


@pytest.fixture(autouse=True)
def always(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers even for so little."""
    monkeypatch.setattr(workers, "FEWEST_STEPS", 0)


def test_workers_give_the_same_bits_as_one_process_and_tell_how_far_they_are() -> None:
    every = tasks(*labelled("trot", "residual", "document"))
    told: list[tuple[int, float]] = []
    apart = dict(workers.process_pool(2)(every, lambda place, share: told.append((place, share))))
    alone = dict(sequential(1)(every, lambda *_: None))
    assert set(apart) == set(alone) == set(range(len(every)))
    for place, chunk in alone.items():
        other = apart[place]
        np.testing.assert_array_equal(other.numbers, chunk.numbers)
        np.testing.assert_array_equal(other.cell.fall_reason, chunk.cell.fall_reason)
        for field in fields(Measures):
            ours, theirs = getattr(chunk.cell.measures, field.name), getattr(other.cell.measures, field.name)
            assert ours.tolist() == theirs.tolist() if ours.dtype == object else ours.tobytes() == theirs.tobytes(), (
                field
            )
    assert {place for place, _ in told} == set(alone)
    assert all(0.0 <= share < 1.0 for _, share in told)


def test_they_are_processes_of_their_own() -> None:
    with pytest.raises(workers.WorkerLost, match="was killed"):
        list(workers.process_pool(2)(tasks(LabelledPolicy("deadly", Deadly())), lambda *_: None))


def test_an_error_in_a_worker_is_raised_here() -> None:
    with pytest.raises(ZeroDivisionError, match="a bug"):
        list(workers.process_pool(2)(tasks(LabelledPolicy("failing", Failing())), lambda *_: None))


def test_little_work_is_done_here(monkeypatch) -> None:
    monkeypatch.setattr(workers, "FEWEST_STEPS", 6 * STEPS + 1)
    monkeypatch.setattr(workers, "_workers", None)
    assert len(list(workers.process_pool(2)(tasks(*labelled("stand")), lambda *_: None))) == 2


def test_a_lost_worker_is_one_line(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr("evaluate.rollouts.rollout.STEPS", STEPS)
    run = ["--policies", "stand", "trot", "--scenarios", "flat", "push", "--episodes", "4", "--no-film"]
    resolve = policies.resolve
    monkeypatch.setattr("policies.resolve", lambda name, **how: Deadly() if name == "trot" else resolve(name, **how))
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
    with pytest.raises(workers.WorkerLost, match="cannot be started \\(Resource temporarily unavailable"):
        list(workers.process_pool(2)(tasks(*labelled("stand")), lambda *_: None))
    assert not runs(*begun)


class Stuck(type(policies.make("stand"))):
    """Never returns."""

    def act(self, observation):
        threading.Event().wait()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_a_worker_that_never_returns_ends_with_the_others(monkeypatch) -> None:
    monkeypatch.setattr(workers, "ENDING_TIME", 0.5)
    both = [*tasks(LabelledPolicy("stuck", Stuck()))[:1], *tasks(LabelledPolicy("failing", Failing()))[:1]]
    before = children(os.getpid())
    with pytest.raises(ZeroDivisionError):
        list(workers.process_pool(2)(both, lambda *_: None))
    assert not any(map(runs, children(os.getpid()) - before - {resource_tracker._resource_tracker._pid}))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_an_outcome_that_there_is_no_memory_for_ends_the_run_in_one_line(tmp_path, monkeypatch, capsys) -> None:
    """Whoever takes the outcomes from the workers has no thread of its own whose end could go unnoticed."""
    monkeypatch.setattr("evaluate.rollouts.rollout.STEPS", STEPS)
    run = ["--policies", "stand", "--scenarios", "flat", "push", "--episodes", "4", "--no-film", "--threads", "2"]
    received = workers._Worker.received
    before = children(os.getpid())

    def short(worker):
        if isinstance(news := received(worker), Chunk) and (tmp_path / "cut" / "parts").exists():
            raise MemoryError
        return news

    with monkeypatch.context() as patch:
        patch.setattr(workers._Worker, "received", short)
        assert main([*run, "--out", str(tmp_path / "cut")]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("error: out of memory: ")
    assert error.endswith(f"; go on: python -m evaluate --resume --out {tmp_path / 'cut'}")
    assert not any(map(runs, children(os.getpid()) - before - {resource_tracker._resource_tracker._pid}))
    assert main(["--resume", "--out", str(tmp_path / "cut")]) == 0
    assert main([*run, "--out", str(tmp_path / "whole")]) == 0
    for name in ("episodes.parquet", "results.json"):
        assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


class Unsendable(Exception):
    """Whose text cannot be had either."""

    def __reduce__(self):
        raise TypeError("no pickle")

    def __str__(self):
        raise TypeError("no text")


class Odd(type(policies.make("stand"))):
    """Raises what no other process can be sent."""

    def act(self, observation):
        raise Unsendable


def test_an_error_that_cannot_be_sent_is_named() -> None:
    with pytest.raises(RuntimeError, match="Unsendable, whose text cannot be had"):
        list(workers.process_pool(2)(tasks(LabelledPolicy("odd", Odd())), lambda *_: None))


def test_who_waits_for_workers_may_stop_them() -> None:
    asked = iter([None, None, KeyboardInterrupt()])

    def check() -> None:
        if (error := next(asked)) is not None:
            raise error

    with pytest.raises(KeyboardInterrupt):
        list(workers.process_pool(2, check)(tasks(LabelledPolicy("stuck", Stuck())), lambda *_: None))


def test_the_environment_is_as_it_was_after_workers_began(monkeypatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    list(workers.process_pool(2)(tasks(*labelled("stand")), lambda *_: None))
    assert os.environ["OPENBLAS_NUM_THREADS"] == "3"


def children(process: int) -> set[int]:
    """Processes whose parent it is."""
    found = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            if int(stat.read_text(encoding="utf-8").rpartition(")")[2].split()[1]) == process:
                found.add(int(stat.parent.name))
        except OSError:
            continue
    return found


def runs(process: int) -> bool:
    """Whether it is there, and no zombie that waits to be looked after."""
    try:
        return Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_workers_leave_when_the_evaluation_is_killed(repository, tmp_path, running) -> None:
    command = [sys.executable, "-m", "evaluate", "--policies", "trot", "stand", "--scenarios", "flat", "push"]
    command += ["--episodes", "256", "--threads", "2", "--out", str(tmp_path)]
    with running(command, cwd=repository, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while len(workforce := children(process.pid)) < 3:  # two workers and Python's resource tracker
            assert process.poll() is None
            time.sleep(0.01)
        time.sleep(0.5)
    until(lambda: not any(map(runs, workforce)), "orphans are left")
