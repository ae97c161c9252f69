"""The executor on a Ray cluster: the same bits as in one process, whatever becomes of its workers."""

import contextlib
import os
import random
import signal
import subprocess
import threading
import time

import numpy as np
import pytest

import policies
from evaluate.__main__ import main
from evaluate.rollouts import cluster
from evaluate.rollouts.experiment import LabelledPolicy, Task, sequential
from evaluate.rollouts.hardware import IDEAL
from quad_env import SCENARIOS
from quad_env.seeding import episode_seeds

pytest.importorskip("ray")


def tasks(count, steps):
    """Chunks of four episodes of the trot on pushes."""
    seeds = episode_seeds("search", 4, 4 * count).reshape(count, 4)
    trot, push = LabelledPolicy("trot", policies.make("trot")), SCENARIOS["push"]
    return [Task(trot, push, np.arange(4 * i, 4 * i + 4), seeds[i], steps, None, IDEAL) for i in range(count)]


def workers():
    """Processes of the embedded cluster that are running a task."""
    listed = subprocess.run(["ps", "-eo", "pid,args"], capture_output=True, text=True, check=True).stdout
    return [int(line.split()[0]) for line in listed.splitlines() if "ray::_run_task" in line]


@pytest.mark.skipif(os.name != "posix", reason="kills processes")
def test_tasks_give_the_bits_of_one_process_though_workers_are_killed():
    every, over, killed = tasks(12, 400), threading.Event(), []

    def kill():
        choose = random.Random(0)
        while not over.is_set() and len(killed) < 3:
            time.sleep(0.3)
            if running := workers():
                chosen = choose.choice(running)
                with contextlib.suppress(ProcessLookupError):  # it ended since it was listed
                    os.kill(chosen, signal.SIGKILL)
                    killed.append(chosen)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        apart = dict(cluster.ray_cluster(2)(every, lambda *_: None))
    finally:
        over.set()
        killer.join()
    alone = dict(sequential(1)(every, lambda *_: None))
    assert killed
    assert set(apart) == set(alone) == set(range(len(every)))
    for place, chunk in alone.items():
        ours, theirs = (each.cell.measures.velocity_error for each in (chunk, apart[place]))
        assert ours.tobytes() == theirs.tobytes()
        assert chunk.cell.measures.outcome.tolist() == apart[place].cell.measures.outcome.tolist()
    assert not workers()


POLICIES = """
import numpy as np
import policies

class Walk(policies.Trot):
    pass

class Fails:
    def __init__(self):
        self.calls = 0

    def __call__(self, observation):
        self.calls += 1
        if self.calls > 30:
            raise RuntimeError("no more")
        return np.array([0.0, 0.5, -1.0] * 4)
"""


def test_a_users_policies_are_evaluated_as_here_and_progress_is_reported(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("evaluate.rollouts.rollout.STEPS", 150)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(POLICIES, encoding="utf-8")
    run = ["--policies", "mine.py:Walk", "mine.py:Fails", "--scenarios", "flat", "--episodes", "2", "--no-film"]
    shares = []

    @contextlib.contextmanager
    def progress(_cells):
        yield lambda policy, scenario, share: shares.append(share)

    monkeypatch.setattr("evaluate.commands.execution.show_progress", progress)
    assert main([*run, "--engine", "ray", "--threads", "2", "--out", "apart"]) == 0
    assert {0.0 < share < 1.0 for share in shares} == {True, False}
    assert shares.count(1.0) == 2
    assert main([*run, "--threads", "1", "--out", "here"]) == 0
    assert (tmp_path / "apart/episodes.parquet").read_bytes() == (tmp_path / "here/episodes.parquet").read_bytes()
    assert "mine.py:Fails failed in 2 of 2 episodes; in the first it raised RuntimeError" in capsys.readouterr().out


def test_without_ray_one_line_says_what_to_install(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(cluster, "find_spec", lambda _: None)
    arguments = ["--policies", "stand", "--scenarios", "flat", "--episodes", "1", "--out", str(tmp_path)]
    assert main([*arguments, "--engine", "ray"]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("error: --engine ray wants Ray: pip install -e")
