"""Every option of the commands of `python -m evaluate` reaches what it governs: seen on the robots and in the files.

`EFFECTS` has an entry for each option, or `ELSEWHERE` names the test of it; an option without either fails. The options
of a command are given all at once, each other than usual: those that stand together, with what they need.
"""

import json
import shutil
from collections.abc import Iterator
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from evaluate.__main__ import COMMANDS, main
from quad_env.seeding import episode_seeds
from tests.effects import Called, Effect, Reading, check_all, check_other_than_usual, robots
from tests.evaluate.commands import test_placed_levels

BRIEF = 130
"""Control steps of an episode."""


def drawn(seed: int, count: int, purpose: Any = "evaluation") -> tuple[int, ...]:
    return tuple(episode_seeds(purpose, seed, count).tolist())


def seeds(made: Called) -> list[tuple[int, ...]]:
    """Of each batch."""
    return [each.seeds for each in made.batches]


def some(read: Reading) -> Reading:
    """What batches have, each once."""
    return lambda made: set(robots(read)(made))


def names(made: Called) -> list[str]:
    """Of the scenarios, each once."""
    return list(dict.fromkeys(robots(lambda each: each.env.scenario.name)(made)))


def said(*words: str) -> Reading:
    """Whether each of the words is printed."""
    return lambda made: [word in made.said for word in words]


def written(name: str) -> Reading:
    """Whether there is such a file, with something in it."""
    return lambda made: bool(made.done and (made.folder / name).stat().st_size)


def called(function: str, argument: str) -> Reading:
    """That argument of the function, in each call."""
    return lambda made: made.of(function, argument)


def held(name: str, *keys: str) -> Reading:
    """What a JSON file holds below these keys."""

    def read(made: Called) -> Any:
        assert made.done
        found = json.loads((made.folder / name).read_bytes())
        for key in keys:
            found = found[key]
        return found if not isinstance(found, dict) else [*found]

    return read


def compared(made: Called) -> set[tuple[str, str]]:
    return {(each["a"], each["b"]) for each in held("new/found.json", "comparisons")(made)}


TRUSTED = Effect("--trust", called("resolve", "trust"), [True])
SEED = "--seed 5"
THREADS = "--threads 1", some(lambda each: each.threads), {1}
EFFECTS: dict[str, dict[str, Effect]] = {
    "report": {
        "folder": Effect("FOLDER/a", written("a/report.md"), True),
        "gate": Effect("--gate GATE", lambda made: made.code, 1),
        "baseline": Effect(
            "--baseline crouch", lambda made: {each["b"] for each in results(made)["comparisons"]}, {"crouch"}
        ),
        "film": Effect("--no-film", called("report", "film"), [False]),
        "trust": Effect("--trust", called("report", "trust"), [True]),
    },
    "replay": {
        "results": Effect("FOLDER/a", said("identical to the bit"), [True]),
        "episode": Effect("2", lambda made: [row["episode"] for row in replayed(made)], [2]),
        "policy": Effect("--policy crouch", lambda made: [row["policy"] for row in replayed(made)], ["crouch"]),
        "scenario": Effect("--scenario push", lambda made: [row["scenario"] for row in replayed(made)], ["push"]),
        "trust": TRUSTED,
        "video": Effect("--video FOLDER/walk.png", written("walk.png"), True),
    },
    "compare": {
        "a": Effect("FOLDER/a", lambda made: Path(held("new/found.json", "a")(made)).name, "a"),
        "b": Effect("FOLDER/b", lambda made: Path(held("new/found.json", "b")(made)).name, "b"),
        "policies": Effect("--policies crouch stand", compared, {("crouch", "stand")}),
        "json": Effect("--json FOLDER/new/found.json", written("new/found.json"), True),
    },
    "axes": {
        "axes": Effect("dropout", lambda made: {name.split(":")[0] for name in names(made)}, {"dropout"}),
        "policies": Effect("--policies stand", called("resolve", "name_or_path"), ["stand"]),
        "trust": TRUSTED,
        "episodes": Effect("--episodes 2", some(lambda each: len(each.seeds)), {2}),
        "seed": Effect(SEED, lambda made: set(seeds(made)), {drawn(5, 2)}),
        "robot": Effect("--robot go1", some(lambda each: each.env.robot.name), {"go1"}),
        "out": Effect("--out FOLDER/new", written("new/fall_rates.svg"), True),
        "threads": Effect(*THREADS),
    },
}
ELSEWHERE = {
    "axes": {
        "resume": test_placed_levels.test_a_stopped_run_goes_on_to_the_same_files,
        "sequential": test_placed_levels.test_each_policy_runs_levels_where_it_breaks,
        "budget": test_placed_levels.test_a_budget_ends_it,
    },
}
"""Options with a test of their own, which gives them."""


def results(made: Called) -> dict[str, Any]:
    assert made.code in {0, 1}
    return dict(json.loads((made.folder / "a/results.json").read_bytes()))


def replayed(made: Called) -> list[dict[str, Any]]:
    """Rows with the seed that was simulated, on the scenario that was."""
    rows = pq.read_table(made.folder / "a/episodes.parquet").to_pylist()
    first = made.batches[0]
    (policy,) = made.of("resolve", "name_or_path")
    wanted = first.seeds[0], first.env.scenario.name, policy
    return [row for row in rows if (row["seed"], row["scenario"], row["policy"]) == wanted]


def runs() -> Iterator[Any]:
    """Command and words that are given together."""
    for command, effects in EFFECTS.items():
        marks = [pytest.mark.rendering] if "video" in effects else []
        for given in dict.fromkeys(each.given for each in effects.values()):
            yield pytest.param(command, given, marks=marks, id=f"{command} {given}".strip())


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_has_an_effect_that_is_tested(command: str) -> None:
    options = {field.name for field in fields(import_module(COMMANDS[command].module).Options)}
    assert options == EFFECTS.get(command, {}).keys() | ELSEWHERE.get(command, {}).keys()


@pytest.fixture(autouse=True)
def _brief_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("evaluate.rollouts.rollout.STEPS", BRIEF)


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of two policies on two scenarios, with traces."""
    folder = tmp_path_factory.mktemp("evaluated")
    words = "--policies stand crouch --scenarios flat push --episodes 3 --trace compact --threads 1 --out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("evaluate.rollouts.rollout.STEPS", BRIEF)
        made = Called(main, [*words.split(), str(folder)], folder)
        assert made.code == 0
    return folder


@pytest.mark.parametrize(("command", "given"), [*runs()])
def test_options_reach_what_they_govern(
    command: str, given: str, evaluated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a", "b"):
        shutil.copytree(evaluated, tmp_path / name)
    (tmp_path / "a/report.md").unlink(missing_ok=True)
    effects = {name: each for name, each in EFFECTS[command].items() if each.given == given}
    text = " ".join([given, *(each.words for each in effects.values())]).replace("FOLDER", str(tmp_path))
    words = ["stand falls > 50 %" if word == "GATE" else word for word in text.split()]
    check_other_than_usual(import_module(COMMANDS[command].module).Options, words, effects.keys())
    made = Called(main, [command, *words], tmp_path)
    assert made.code in {0, 1}, capsys.readouterr().err
    check_all(effects, made)
