"""A task runs where the files that it names are not, with the results and messages of the sending process."""

from pathlib import Path

import numpy as np
import pytest

import policies
from evaluate.cells import LabelledPolicy, Task
from evaluate.hardware import HardwareConfig
from evaluate.rollouts import cluster_tasks
from evaluate.rollouts.run import GroupResult, sequential
from evaluate.rollouts.task_files import FileName, mark_file, pack, unpack
from quad_env import SCENARIOS
from quad_env.cli.command_line import UsageError
from quad_env.robots.registry import get_robot
from quad_env.seeding import episode_seeds

STEPS = 110
FAILS = """
from poses import POSE

class Fails:
    calls = 0

    def __call__(self, observation):
        self.calls += 1
        if self.calls > 30:
            raise RuntimeError(f"no more in {__file__}")
        return POSE
"""
READS = """
from pathlib import Path

POSE = [float(word) for word in Path(__file__).with_name("pose.txt").read_text().split()]

def stand(observation):
    return POSE
"""


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a user, which is the current folder."""
    folder = tmp_path / "home"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def task(name: str, hardware: HardwareConfig) -> Task:
    labelled = LabelledPolicy(name, hardware.policy(name))
    return Task(labelled, SCENARIOS["flat"], np.arange(2), episode_seeds("search", 4, 2), STEPS, hardware)


def elsewhere(sent: Task, home: Path, monkeypatch: pytest.MonkeyPatch) -> GroupResult:
    """Run a task after its folder has vanished."""
    packed = pack(cluster_tasks._work([sent], (0,)))
    contents = {name: Path(name).read_bytes() for name in packed.files}
    monkeypatch.chdir(home.parent)
    home.rename(home.with_name("vanished"))
    unpacked = unpack(packed.body, contents, home.parent / "copies")
    return cluster_tasks._with_names(cluster_tasks._simulate(unpacked, lambda _: None), [sent])


def test_a_users_policy_and_robot_run_where_their_files_are_not(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (home / "mine.py").write_text(FAILS, encoding="utf-8")
    (home / "poses.py").write_text("POSE = [0.0, 0.5, -1.0] * 4\n", encoding="utf-8")
    (home / "dog.xml").write_bytes(policies.make("stand").robot.mjcf.read_bytes())
    sent = task("mine.py:Fails", HardwareConfig(robot="dog.xml"))
    here = dict(sequential(1)([sent], lambda *_: None))[0].cell
    result = elsewhere(sent, home, monkeypatch)
    assert result.error is None
    there = result.chunks[0].cell
    assert f"no more in {home / 'mine.py'}" in here.failure[0]
    assert there.failure.tolist() == here.failure.tolist()
    assert there.measures.velocity_error.tobytes() == here.measures.velocity_error.tobytes()
    assert there.policy == "mine.py:Fails"


def test_a_policy_that_reads_other_files_is_refused_elsewhere(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (home / "reads.py").write_text(READS, encoding="utf-8")
    (home / "pose.txt").write_text("0.0 0.5 -1.0 " * 4, encoding="utf-8")
    with pytest.raises(UsageError, match=r"reads.py:stand cannot be loaded on another machine .*pose.txt"):
        elsewhere(task("reads.py:stand", HardwareConfig()), home, monkeypatch)


def test_meshes_of_a_robot_travel_with_its_model(home: Path) -> None:
    model = policies.make("stand").robot.mjcf.read_text(encoding="utf-8")
    (home / "parts").mkdir()
    cube = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    (home / "parts/cube.obj").write_text(cube, encoding="utf-8")
    assets = '<asset><mesh name="cube" file="parts/cube.obj"/></asset><worldbody>'
    (home / "dog.xml").write_text(model.replace("<worldbody>", assets, 1), encoding="utf-8")
    (home / "dog.toml").write_text('mjcf = "dog.xml"\n', encoding="utf-8")
    assert get_robot("dog.toml").name == "dog"
    named = mark_file("dog.toml")
    assert isinstance(named, FileName)
    assert {Path(name).name for name in pack(named).files} == {"dog.toml", "dog.xml", "cube.obj"}


def test_names_of_policies_and_robots_and_files_of_this_project_do_not_travel() -> None:
    assert not isinstance(mark_file("go1"), FileName)
    stand = policies.make("stand")
    packed = pack(stand)
    assert packed.files == ()
    assert unpack(packed.body, {}, Path("unused")).value.robot.mjcf == stand.robot.mjcf
