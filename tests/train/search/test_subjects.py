"""Every option of `python -m train search` reaches the robots and files of the search, whatever its subject.

Each subject is searched once, all its options other than usual.
"""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import policies
from policies.trot.feedback_parameters import searched_parameters
from quad_env.seeding import episode_seeds
from tests.batches import Batch, begun
from tests.quad_env.robots.alike import alike
from train.__main__ import main
from train.search import command, feedback
from train.search.command import SUBJECTS, effort_of
from train.search.subject import Options

FULL = 1000
"""Control steps of an episode of 10 s."""


@dataclass(frozen=True)
class Run:
    """A search that came to its end."""

    batches: list[Batch]

    @property
    def shapes(self) -> list[tuple[str, int, int | None]]:
        """Scenario, number of robots and control steps of each batch."""
        return [(each.env.scenario.name, len(each.seeds), each.env.max_episode_steps) for each in self.batches]

    def seeds(self, first: int, count: int) -> list[int]:
        """Of the batches from that one on, so many, each seed once."""
        found = [seed for each in self.batches[first : first + count] for seed in each.seeds]
        return list(dict.fromkeys(found))


def searched(subject: str, words: str, folder: Path) -> Run:
    """The outcome of the search with these words; every option of the subject must be among them."""
    given = f"{words} --seed 3 --threads 1 --out FOLDER/found.json".replace("FOLDER", str(folder)).split()
    names = {*asdict(SUBJECTS[subject].usual), *SUBJECTS[subject].options}
    assert {word[2:].replace("-", "_") for word in given if word.startswith("--")} == names | {"seed", "threads", "out"}
    with begun() as batches:
        assert main(["search", subject, *given]) == 0
    assert {each.threads for each in batches} == {1}
    assert json.loads((folder / "found.json").read_text())
    return Run(batches)


def drawn(seed: int, count: int, purpose: Any = "search") -> list[int]:
    return list(episode_seeds(purpose, seed, count).tolist())


def test_search_of_the_trot(tmp_path: Path) -> None:
    alike(tmp_path)
    words = "--robot FOLDER/alike.xml --generations 2 --candidates 5 --episodes 8 --steps 110 --check-episodes 4"
    run = searched("trot", f"{words} --spread 0.1", tmp_path)
    assert {each.env.robot.name for each in run.batches} == {"alike"}
    assert run.batches[1].env.scenario.severity == pytest.approx(35.0 * 0.1 * 0.4**0.5)  # as hard for its size
    generation = [(name, 5 * 8, 110) for name in ("flat", "push", "rough")]
    fit, check = [("flat", 4, FULL)] * 3, [(name, 4, FULL) for name in ("flat", "push", "rough") for _ in range(2)]
    assert run.shapes == [*generation * 2, *fit, *check]
    assert run.seeds(0, 6) == drawn(3, 16)
    assert run.seeds(6, 3) == drawn(2_000_003, 12)
    assert run.seeds(9, 6) == drawn(1_000_003, 4)
    account = (tmp_path / "TROT.md").read_text()
    assert f"python -m train search trot --robot {tmp_path / 'alike.xml'} --seed 3 --generations 2 " in account
    assert "2 generations of 5 candidates, 8 episodes of 1.1 s" in account


def test_search_of_a_policy_with_feedback(tmp_path: Path) -> None:
    in_force = policies.make("trot_integral").parameters
    ranges = feedback.POLICIES["trot_integral"].ranges
    fixed = next(name for name in asdict(in_force) if name not in ranges)
    begin = replace(in_force, **{fixed: 0.9 * getattr(in_force, fixed)})
    (tmp_path / "start.json").write_text(json.dumps(asdict(begin)))
    words = "--policy trot_integral --generations 2 --candidates 5 --exercises flat=1.5 push=42 --episodes 2"
    words += " --steps 110 --spread 0.02 --check-episodes 3 --start FOLDER/start.json"
    run = searched("feedback", words, tmp_path)
    generation = [("flat=1.5", 5 * 2, 110), ("push=42", 5 * 2, 110)]
    assert run.shapes[:4] == generation * 2
    assert {shape[::2] for shape in run.shapes[4:]} == {("flat=1.5", FULL), ("push=42", FULL)}
    assert run.seeds(0, 4) == drawn(3, 4)
    assert run.seeds(4, len(run.batches)) == drawn(3, 3, "validation")
    assert (tmp_path / "TROT_INTEGRAL.md").is_file()
    first, _ = [json.loads(line) for line in (tmp_path / "found.trials.jsonl").read_text().splitlines()]
    assert first["mean"][fixed] == getattr(begin, fixed) != getattr(in_force, fixed)
    low, high = ranges["duty"]
    tried = [(each["duty"] - begin.duty) / (high - low) for each in first["tried"]]
    assert np.abs(tried).max() < 4 * 0.02


@pytest.mark.parametrize("subject", SUBJECTS)
def test_the_usual_numbers_can_be_searched_with(subject: Any) -> None:
    usual = effort_of(Options(subject))
    assert usual == SUBJECTS[subject].usual
    (row,) = [line.split()[1:] for line in command.__doc__.splitlines() if line.split()[:1] == [subject]]
    assert list(map(float, row)) == list(asdict(usual).values())


BAD = {
    "trot": {
        "--steps 100": "--steps must be from 101",
        "--out TROT.md": "must be a file",
        "--out no-such-folder/trot.json": "no folder",
        "--robot go9": "unknown robot",
        "--policy mpc_wbc": "search trot has no --policy",
    },
    "feedback": {
        "--exercises gallop": "--exercises: unknown scenario 'gallop'",
        "--start no-such.json": "no-such.json",
    },
    "jump": {"": "jump"},
}


@pytest.mark.parametrize(("subject", "words"), [(subject, words) for subject, each in BAD.items() for words in each])
def test_bad_input_is_one_line(subject: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["search", subject, *words.split()]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert BAD[subject][words] in line


class Kept:
    """A search of a policy with feedback whose generations are given and whose outcome is better, in a folder."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch, *generations: Any) -> None:
        def evolve(*_: Any) -> Any:
            for each in generations:
                if isinstance(each, BaseException):
                    raise each
                yield each, []

        patch.setattr(command, "evolve", evolve)
        patch.setattr(feedback, "compared", lambda *_: ([], -np.ones(8)))
        self.code = main(["search", "feedback", "--out", str(folder / "found.json")])
        self.files = {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()}


BETTER = replace(searched_parameters(), frequency=3.125)


def test_ctrl_c_keeps_what_was_found_so_far(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = Kept(tmp_path, monkeypatch, BETTER, KeyboardInterrupt())
    assert kept.code == 130
    assert json.loads(kept.files["found.unjudged.json"])["frequency"] == 3.125
    assert kept.files.keys() == {"found.unjudged.json", "found.trials.jsonl"}
    assert "kept what was found after 1 generations" in capsys.readouterr().err


def test_a_search_that_is_stopped_at_once_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = Kept(tmp_path, monkeypatch, KeyboardInterrupt())
    assert (kept.code, kept.files) == (130, {})


def test_an_outcome_that_cannot_be_written_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(path: Path, content: bytes) -> None:
        if path.name == "found.json":
            raise OSError(28, "No space left on device")

    monkeypatch.setattr("train.search.files.write_atomically", full)
    assert Kept(tmp_path, monkeypatch, BETTER).code == 2
    printed = capsys.readouterr()
    assert "No space left" in printed.err
    assert json.JSONDecoder().raw_decode(printed.out)[0]["frequency"] == 3.125
