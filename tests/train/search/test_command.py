"""Every option of `python -m train search` reaches the robots and files of the search."""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from policies.trot.open_loop import TrotParameters
from quad_env.seeding import episode_seeds
from tests.batches import Batch, begun
from tests.quad_env.robots.alike import alike
from tests.seams import full_disk
from train.__main__ import main
from train.search import cmaes, trot
from train.search.trot import TrotSearchOptions

FULL = 1000
"""Number of control steps of an episode of 10 s."""


@dataclass(frozen=True)
class Run:
    """A completed search."""

    batches: list[Batch]

    @property
    def shapes(self) -> list[tuple[str, int, int | None]]:
        """Return scenario, number of robots and control steps of each batch."""
        return [(each.env.scenario.name, len(each.seeds), each.env.max_episode_steps) for each in self.batches]

    def seeds(self, first: int, count: int) -> list[int]:
        """Return the seeds of `count` batches from `first` on, without repetitions."""
        found = [seed for each in self.batches[first : first + count] for seed in each.seeds]
        return list(dict.fromkeys(found))


def searched(words: str, folder: Path) -> Run:
    """Return the result of the search with the given arguments; every option but --ray must be among them."""
    given = f"{words} --seed 3 --threads 1 --out FOLDER/found.json".replace("FOLDER", str(folder)).split()
    names = asdict(TrotSearchOptions()).keys() - {"subject", "ray"}  # tests/train/test_on_cluster.py
    assert {word[2:].replace("-", "_") for word in given if word.startswith("--")} == names
    with begun() as batches:
        assert main(["search", "trot", *given]) == 0
    assert {each.threads for each in batches} == {1}
    assert json.loads((folder / "found.json").read_text())
    return Run(batches)


def drawn(seed: int, count: int, purpose: Any = "search") -> list[int]:
    return list(episode_seeds(purpose, seed, count).tolist())


def test_search_of_the_trot(tmp_path: Path) -> None:
    alike(tmp_path)
    (tmp_path / "start.json").write_text(json.dumps(asdict(FOUND)), encoding="utf-8")
    words = "--robot FOLDER/alike.xml --generations 2 --candidates 5 --episodes 8 --steps 110 --check-episodes 4"
    run = searched(f"{words} --spread 0.1 --start FOLDER/start.json --exercises flat push rough+hardware", tmp_path)
    assert {each.env.robot.name for each in run.batches} == {"alike"}
    assert run.batches[1].env.scenario.severity == pytest.approx(35.0 * 0.1 * 0.4**0.5)  # scaled to the robot's size
    exercises = "flat", "push", "rough+hardware"
    generation = [(name, 5 * 8, 110) for name in exercises]
    fit, check = [("flat", 4, FULL)] * 3, [(name, 4, FULL) for name in exercises] * 2
    assert run.shapes == [*generation * 2, *fit, *check]
    assert run.seeds(0, 6) == drawn(3, 16)
    assert run.seeds(6, 3) == drawn(2_000_003, 12)
    assert run.seeds(9, 6) == drawn(3, 4, "validation")
    account = (tmp_path / "TROT.md").read_text()
    assert "| blend_time | fixed | 0.3 | 0.3 |" in account
    assert "python -m train search trot --seed 3 --generations 2 " in account
    assert f" --robot {tmp_path / 'alike.xml'}`" in account
    assert "2 generations of 5 candidates, 8 episodes of 1.1 s" in account


BAD = {
    "trot": {
        "--steps 100": "--steps must be from 101",
        "--out TROT.md": "--out must not be TROT.md",
        "--robot go9": "unknown robot",
        "--policy mpc_wbc": "--policy",
    },
    "feedback": {"--policy mpc_wbc": "`python -m train search feedback` is now `python -m research search`"},
    "jump": {"": "jump"},
}


@pytest.mark.parametrize(("subject", "words"), [(subject, words) for subject, each in BAD.items() for words in each])
def test_bad_input_is_one_line(subject: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["search", subject, *words.split()]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert BAD[subject][words] in line


class Kept:
    """Search with given generations and result, in a folder."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch, *generations: Any) -> None:
        def evolve(*_: Any) -> Any:
            for each in generations:
                if isinstance(each, BaseException):
                    raise each
                yield each, []

        patch.setattr(cmaes, "evolve", evolve)
        patch.setattr(trot, "fit_command_map", lambda found, *_: found)
        patch.setattr(trot, "compare_parameters", lambda *_: ([], None))
        self.code = main(["search", "trot", "--out", str(folder / "found.json")])
        self.files = {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()}


FOUND = replace(TrotParameters(), frequency=3.125)


def test_ctrl_c_keeps_what_was_found_so_far(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = Kept(tmp_path, monkeypatch, FOUND, KeyboardInterrupt())
    assert kept.code == 130
    assert json.loads(kept.files["found.trials.jsonl"])["mean"]["frequency"] == 3.125
    assert kept.files.keys() == {"found.trials.jsonl"}
    assert "has what was found in 1 generations" in capsys.readouterr().err


def test_a_search_that_is_stopped_at_once_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = Kept(tmp_path, monkeypatch, KeyboardInterrupt())
    assert (kept.code, kept.files) == (130, {})


def test_an_outcome_that_cannot_be_written_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    full_disk(monkeypatch, "found.json")
    assert Kept(tmp_path, monkeypatch, FOUND).code == 2
    printed = capsys.readouterr()
    assert "No space left" in printed.err
    assert json.JSONDecoder().raw_decode(printed.out[printed.out.index("{") :])[0]["frequency"] == 3.125
