"""Every option of `python -m evaluate` reaches what it governs: given as words, seen on the robots and in the files.

`EFFECTS` has an entry for each option; an option without one fails.
"""

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from evaluate.__main__ import _plan, main
from evaluate.commands import execution
from evaluate.commands.options import Options
from evaluate.rollouts.experiment import evaluation_seeds, sequential
from tests.effects import Called, Effect, robots

USUAL = "--policies stand --scenarios flat --episodes 1 --no-film --threads 1"
"""Short: an episode of a robot that stands takes little."""
BRIEF = 120
"""Control steps of an episode."""


class Made(Called):
    """What `python -m evaluate` with these words does, once it is asked for."""

    def __init__(self, words: str, folder: Path) -> None:
        given = words.replace("FOLDER", str(folder)).split()
        usual = [f"--{word}".split() for word in USUAL.removeprefix("--").split(" --")]
        kept = [each for each in usual if not {each[0], each[0].replace("--no-", "--")} & set(given)]
        if {"--quick", "--full"} & set(given):
            kept = [each for each in kept if each[0] != "--scenarios"]
        out = [] if "--out" in given else ["--out", str(folder / "out")]
        super().__init__(main, [word for each in kept for word in each] + given + out, folder)

    @property
    def out(self) -> Path:
        assert self.code == 0
        return self.folder / "out"

    @property
    def results(self) -> dict[str, Any]:
        return dict(json.loads((self.out / "results.json").read_bytes()))

    @property
    def rows(self) -> list[dict[str, Any]]:
        return list(pq.read_table(self.out / "episodes.parquet").to_pylist())


def seeds(made: Made) -> tuple[list[int], list[int]]:
    """Of the episodes that were simulated, and of those in the table."""
    return [seed for each in made.batches for seed in each.seeds], [row["seed"] for row in made.rows]


def both(seed: int, count: int) -> tuple[list[int], list[int]]:
    expected = evaluation_seeds(seed, count).tolist()
    return expected, expected


def planned(made: Made) -> tuple[bool, bool, bool]:
    """Whether there are to be many scenarios, a hard level of an axis among them, and the hardest."""
    names = [scenario.name for scenario in _plan(made.words).scenarios]
    return len(names) > 20, "push:4" in names, "push:6" in names


def files(made: Made) -> list[str]:
    """Below the test's own folder, those of results."""
    assert made.code == 0
    return [str(path.parent.relative_to(made.folder)) for path in made.folder.rglob("results.json")]


def traced(made: Made) -> tuple[int, bool, list[bool]]:
    """Traces, whether torques are in them, and whether robots are frozen after a fall."""
    found = list((made.out / "traces").glob("*.parquet"))
    columns = [name for path in found for name in pq.read_schema(path).names]
    return len(found), "joint_torque" in columns, [each.env.terminate_on_fall for each in made.batches]


def cluster_asked_for(made: Made) -> list[Any]:
    """Workers and address of the cluster that is asked to simulate."""
    asked: list[Any] = []

    def noted(*given: Any) -> Any:
        asked.append(given[:2])
        return sequential(1)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(execution, "ray_cluster", noted)
        again = Made("", made.folder)
        again.words[:] = [*made.words, "--out", str(made.folder / "apart")]
        assert again.code == 0
    return asked


EFFECTS = {
    "policies": Effect("--policies crouch stand", lambda made: [*made.results["policies"]], ["crouch", "stand"]),
    "trust": Effect("--trust", lambda made: made.of("report", "trust"), [True]),
    "scenarios": Effect("--scenarios push=42 rough", robots(lambda each: each.env.scenario.name), ["push=42", "rough"]),
    "quick": Effect("--quick", planned, (False, True, False)),
    "full": Effect("--full", planned, (True, True, True)),
    "episodes": Effect("--episodes 3", seeds, both(0, 3)),
    "robot": Effect("--robot go1", robots(lambda each: each.env.robot.name), ["go1"]),
    "actuator": Effect("--actuator motor", robots(lambda each: each.warms), [True]),
    "sensors": Effect("--sensors typical", robots(lambda each: each.sensed), [True]),
    "estimator": Effect(
        "--estimator kalman",
        robots(lambda each: type(each.env.estimator).__name__),
        ["KalmanFilter"],
        given="--sensors typical",
    ),
    "seed": Effect("--seed 5", seeds, both(5, 1)),
    "out": Effect("--out FOLDER/elsewhere", files, ["elsewhere"]),
    "gate": Effect("--gate FALLS", lambda made: made.code, 1),
    "baseline": Effect(
        "--baseline crouch",
        lambda made: {each["b"] for each in made.results["comparisons"]},
        {"crouch"},
        given="--policies stand crouch",
    ),
    "film": Effect("--film", lambda made: made.of("report", "film"), [True]),
    "trace": Effect("--trace full", traced, (1, True, [False])),
    "threads": Effect(
        "--threads 2", robots(lambda each: (len(each.seeds), each.threads)), [(2, 2)] * 2, "--episodes 4"
    ),
    "engine": Effect("--engine ray", cluster_asked_for, [(1, None)]),
    "address": Effect("--address here:1", cluster_asked_for, [(1, "here:1")], given="--engine ray"),
    "at_once": Effect("--at-once 3", robots(lambda each: len(each.seeds)), [3, 3], given="--episodes 6"),
}
OF_ITS_OWN = {"resume"}
"""Options with tests of their own: tests/evaluate/records/test_resume.py. What --trust loads: `test_own_policies`."""


def test_every_option_has_an_effect_that_is_tested() -> None:
    assert {field.name for field in fields(Options)} == EFFECTS.keys() | OF_ITS_OWN


@pytest.fixture(autouse=True)
def _brief_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("evaluate.rollouts.rollout.STEPS", BRIEF)


@pytest.mark.parametrize("option", EFFECTS)
def test_an_option_reaches_what_it_governs(option: str, tmp_path: Path) -> None:
    effect, made = EFFECTS[option], []
    for number, words in enumerate((effect.given, f"{effect.given} {effect.words}")):
        folder = tmp_path / str(number)
        folder.mkdir()
        made.append(Made(words, folder))
        made[-1].words[:] = ["stand falls > 50 %" if word == "FALLS" else word for word in made[-1].words]
    effect.check(*made)
