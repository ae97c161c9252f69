"""Every option of `python -m train search …` reaches the robots and files of the search.

Each search runs once, all its options other than usual; one that is not given, or is given as usual, fails.
"""

import contextlib
import json
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import policies
from evaluate.rollouts.workers import WorkerLost
from quad_env.seeding import episode_seeds
from tests.batches import Batch, begun
from tests.effects import check_other_than_usual
from tests.quad_env.robots.alike import alike
from train.__main__ import main
from train.search import evolution, fall_prediction, feedback, gait, recovery, trot

FULL = 1000
"""Control steps of an episode of 10 s."""


@dataclass(frozen=True)
class Run:
    """A search that came to its end."""

    options: Any
    batches: list[Batch]
    folder: Path

    @property
    def shapes(self) -> list[tuple[str, int, int | None]]:
        """Scenario, number of robots and control steps of each batch."""
        return [(each.env.scenario.name, len(each.seeds), each.env.max_episode_steps) for each in self.batches]

    def seeds(self, first: int, count: int) -> list[int]:
        """Of the batches from that one on, so many, each seed once."""
        found = [seed for each in self.batches[first : first + count] for seed in each.seeds]
        return list(dict.fromkeys(found))


def searched(kind: Any, words: str, folder: Path) -> Run:
    """The outcome of the search with these words; every option must be among them, and other than usual."""
    given = words.replace("FOLDER", str(folder)).split()
    options = check_other_than_usual(
        kind.Options, given, {field.name for field in fields(kind.Options)} - {"engine", "address"}
    )
    name = kind.__name__.rpartition(".")[2].replace("_", "-")
    with begun() as batches:
        assert main(["search", name, *given]) == 0
    assert {each.threads for each in batches} == {1}
    return Run(options, batches, folder)


def drawn(seed: int, count: int, purpose: Any = "search") -> list[int]:
    return list(episode_seeds(purpose, seed, count).tolist())


def test_search_of_the_trot(tmp_path: Path) -> None:
    alike(tmp_path)
    words = "--generations 2 --candidates 5 --episodes 8 --steps 110 --check-episodes 4"
    run = searched(trot, f"{words} --seed 3 --threads 1 --robot FOLDER/alike.xml --out FOLDER/found.json", tmp_path)
    assert {each.env.robot.name for each in run.batches} == {"alike"}
    generation = [(name, 5 * 8, 110) for name in ("flat", "push", "rough")]
    fit, check = [("flat", 4, FULL)] * 3, [(name, 4, FULL) for name in ("flat", "push", "rough") for _ in range(2)]
    assert run.shapes == [*generation * 2, *fit, *check]
    assert run.seeds(0, 6) == drawn(3, 16)
    assert run.seeds(6, 3) == drawn(2_000_003, 12)
    assert run.seeds(9, 6) == drawn(1_000_003, 4)
    assert json.loads((tmp_path / "found.json").read_text())
    account = (tmp_path / "TROT.md").read_text()
    assert f"python -m train search trot --seed 3 --robot {tmp_path / 'alike.xml'}`" in account
    assert "2 generations of 5 candidates, 8 episodes of 1.1 s" in account


def test_search_of_a_policy_with_feedback(tmp_path: Path) -> None:
    in_force = policies.make("trot_integral").parameters
    ranges = feedback.SUBJECTS["trot_integral"].ranges
    fixed = next(name for name in asdict(in_force) if name not in ranges)
    begin = replace(in_force, **{fixed: 0.9 * getattr(in_force, fixed)})
    (tmp_path / "start.json").write_text(json.dumps(asdict(begin)))
    words = "--policy trot_integral --generations 2 --candidates 5 --exercises flat=1.5 push=42 --episodes 2"
    words += " --steps 110 --spread 0.02 --check-episodes 3 --start FOLDER/start.json --out FOLDER/found.json"
    run = searched(feedback, f"{words} --seed 3 --threads 1", tmp_path)
    generation = [("flat=1.5", 5 * 2, 110), ("push=42", 5 * 2, 110)]
    assert run.shapes[:4] == generation * 2
    assert {shape[::2] for shape in run.shapes[4:]} == {("flat=1.5", FULL), ("push=42", FULL)}
    assert run.seeds(0, 4) == drawn(3, 4)
    assert run.seeds(4, len(run.batches)) == drawn(3, 3, "validation")
    assert {"found.json", "TROT_INTEGRAL.md"} <= {path.name for path in tmp_path.iterdir()}
    first, _ = [json.loads(line) for line in (tmp_path / "found.trials.jsonl").read_text().splitlines()]
    assert first["mean"][fixed] == getattr(begin, fixed) != getattr(in_force, fixed)
    low, high = ranges["duty"]
    tried = [(each["duty"] - begin.duty) / (high - low) for each in first["tried"]]
    assert np.abs(tried).max() < 4 * 0.02


def test_search_of_a_gait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gait, "MAP_EPISODES", 8)
    spreads, true_evolve = [], gait.evolve
    monkeypatch.setattr(
        gait, "evolve", lambda *given, **how: spreads.append(how["spread"]) or true_evolve(*given, **how)
    )
    words = "--gait walk --generations 2 --candidates 5 --episodes 9 --steps 260 --spread 0.02 --out FOLDER/found.json"
    run = searched(gait, f"{words} --seed 3 --threads 1", tmp_path)
    assert run.shapes == [("flat", 5 * 9, 260)] * 2 + [("flat", 8, 520)] * 3
    assert run.seeds(0, 2) == drawn(3, 18)
    assert run.seeds(2, 1) == drawn(1_000_003, 8)
    assert spreads == [0.02]
    assert set(json.loads((tmp_path / "found.json").read_text())) >= {"walk", "trot"}


def test_search_of_the_recovery(tmp_path: Path) -> None:
    words = "--generations 2 --candidates 5 --starts 3 --step 0.03 --out FOLDER/found.json --seed 3 --threads 1"
    run = searched(recovery, words, tmp_path)
    assert [len(each.seeds) for each in run.batches] == [5 * 3] * 2
    assert [run.seeds(number, 1) for number in (0, 1)] == [drawn(40_000 + number, 3) for number in (0, 1)]
    assert json.loads((tmp_path / "found.json").read_text())


def test_fit_of_the_fall_predictor(tmp_path: Path) -> None:
    words = "--policies stand crouch --hours 0.006 --seed 3 --out FOLDER/found.json"
    given = words.replace("FOLDER", str(tmp_path)).split()
    with begun() as batches:
        assert main(["search", "fall-prediction", *given]) == 0
    assert [each.seeds for each in batches] == [tuple(drawn(350, 2))] * 2
    assert json.loads((tmp_path / "found.json").read_text())["velocity_deviation"] > 0.0
    assert {field.name for field in fields(fall_prediction.Options)} == {"policies", "trust", "hours", "seed", "out"}


def test_a_cluster_is_asked_for_by_its_address_and_for_as_many_workers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = []

    @contextlib.contextmanager
    def none(*given: Any) -> Any:
        asked.append(given)
        raise WorkerLost("none is here")
        yield

    monkeypatch.setattr(evolution, "cluster", none)
    words = "--engine ray --address here:1 --threads 3"
    for name, more in {"trot": "", "feedback": "", "gait": "--gait walk", "recovery": ""}.items():
        assert main(["search", name, *words.split(), *more.split(), "--out", str(tmp_path / "found.json")]) == 2
        assert "none is here" in capsys.readouterr().err
    assert asked == [(3, "here:1")] * 4
