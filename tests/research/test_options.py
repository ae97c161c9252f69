"""Every option of the studies of `python -m research` reaches what it governs; values without a use are one line."""

import json
import shutil
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from evaluate.__main__ import main as evaluate
from policies.gaits.parameters import OFFSETS
from quad_env.seeding import episode_seeds
from research.__main__ import COMMANDS, main
from research.studies import estimation, prediction, safety
from tests.effects import Called, Effect, Reading, check_all, check_other_than_usual, robots

BRIEF = 130
"""Control steps of an episode."""
GROUNDS = ["flat", "push", "rough"]


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


def checks(what: str) -> Reading:
    """Of each check that is repeated."""
    return lambda made: [getattr(each, what) for each in made.of("share_of_yes", "check")]


def held(name: str, *keys: str) -> Reading:
    """What a JSON file holds below these keys."""

    def read(made: Called) -> Any:
        assert made.done
        found = json.loads((made.folder / name).read_bytes())
        for key in keys:
            found = found[key]
        return found if not isinstance(found, dict) else [*found]

    return read


def picture(made: Called) -> tuple[int, int]:
    """Columns and rows of tiles."""
    assert made.code == 0
    with Image.open(made.folder / "new/strip.png") as image:
        return image.width // 240, image.height // 200


TRUSTED = Effect("--trust", called("resolve", "trust"), [True])
SEED = "--seed 5"
THREADS = "--threads 1", some(lambda each: each.threads), {1}
WALKS = "--policies stand --scenarios flat --episodes 2 --threads 1"
GAITS = "--gaits walk stand --robots 3 --seconds 3.1"
EFFECTS: dict[str, dict[str, Effect]] = {
    "rescore": {
        "results": Effect("FOLDER/a", written("a/rescored.json"), True),
        "rules": Effect("--rules tilt-70", held("a/rescored.json", "rules"), ["tilt-70"]),
        "success": Effect("--success survival", held("a/rescored.json", "success", "rules"), ["survival"]),
    },
    "gaits": {
        "gaits": Effect("--gaits pace stand", said("pace", "stand", "walk"), [True, True, False]),
        "robots": Effect("--robots 3", some(lambda each: len(each.seeds)), {3}),
        "seconds": Effect("--seconds 3.1", robots(lambda each: each.env.max_episode_steps), [310, 310, 600, 600]),
        "seed": Effect(SEED, seeds, [drawn(5, 3)] * 2 + [drawn(6, 3)] * 2),
        "threads": Effect(*THREADS),
        "changes": Effect("--no-changes", lambda made: len(made.batches), 2, given=GAITS),
    },
    "gait-diagram": {
        "gait": Effect(
            "--gait pace",
            lambda made: [each.offsets[0, 0].round(3).tolist() for each in made.of("draw", "strides")],
            [np.round(OFFSETS["pace"], 3).tolist()],
        ),
        "then": Effect("--then stand", called("draw", "title"), ["pace → stand"]),
        "out": Effect("--out FOLDER/new/gait.png", written("new/gait.png"), True),
        "command": Effect("--command 0.2 0.1 -0.1", some(lambda each: each.command), {(0.2, 0.1, -0.1)}),
        "start": Effect("--start 1.5", some(lambda each: each.env.max_episode_steps), {150 + 130}),
        "length": Effect("--length 1.3", lambda made: [len(each.phase) for each in made.of("draw", "strides")], [130]),
        "seed": Effect(SEED, seeds, [drawn(5, 1)]),
    },
    "recovery": {
        "robots": Effect("--robots 2", robots(lambda each: len(each.seeds)), [2]),
        "seed": Effect(SEED, seeds, [drawn(5, 2, "search")]),
        "seeds": Effect("--seeds search", robots(lambda each: each.purpose), ["search"]),
    },
    "jump": {
        "robots": Effect("--robots 2", robots(lambda each: len(each.seeds)), [2]),
        "seed": Effect(SEED, seeds, [drawn(5, 2)]),
    },
    "safety": {
        "policy": Effect("--policy trot_feedback", called("resolve", "name_or_path"), ["trot_feedback"]),
        "trust": TRUSTED,
        "episodes": Effect("--episodes 2", lambda made: {len(each) for each in seeds(made)[:-1]}, {2}),
        "hours": Effect("--hours 0.0015", lambda made: {len(each) for each in seeds(made)[-1:]}, {4}),
        "seed": Effect(
            SEED,
            lambda made: list(dict.fromkeys(seeds(made)))[::8],
            [drawn(5000, 2, "validation"), drawn(5500, 4, "validation")],
        ),
        "seeds": Effect("--seeds validation", some(lambda each: each.purpose), {"validation"}),
    },
    "ground": {
        "policies": Effect("--policies stand crouch", called("resolve", "name_or_path"), ["stand", "crouch"]),
        "scenarios": Effect("--scenarios rough:2", names, ["rough:2"]),
        "episodes": Effect("--episodes 2", some(lambda each: len(each.seeds)), {2}),
        "seed": Effect(SEED, lambda made: set(seeds(made)), {drawn(5, 2)}),
        "other": Effect("--other 4", robots(lambda each: each.env.scenario.terrain.seed), [0, 4, 0, 4]),
        "threads": Effect(*THREADS),
    },
    "estimation": {
        "policy": Effect("--policy crouch", lambda made: walkers(made).count("crouch"), 6),
        "policies": Effect("--policies stand", lambda made: walkers(made)[-3:], ["stand"] * 3),
        "scenarios": Effect("--scenarios rough:2", lambda made: names(made)[-1:], ["rough:2"]),
        "sensors": Effect("--sensors ideal", lambda made: [each.sensors for each in made.batches].count("ideal"), 8),
        "episodes": Effect("--episodes 3", some(lambda each: len(each.seeds)), {3}),
        "seed": Effect(SEED, lambda made: set(seeds(made)), {drawn(5, 3, "search")}),
        "seeds": Effect("--seeds search", some(lambda each: each.purpose), {"search"}),
        "ground": Effect("--ground 4", some(lambda each: getattr(each.env.scenario.terrain, "seed", 4)), {4}),
        "threads": Effect("--threads 2", some(lambda each: each.threads), {2}),
        "page": Effect(
            "--page FOLDER/page.md", lambda made: [word in page(made) for word in ("NEES", "truth")], [True] * 2
        ),
        "tables": Effect("--tables success", lambda made: len(made.batches), 3, given=WALKS),
    },
    "straight-walking": {
        "robot": Effect("--robot simple_quad", some(lambda each: each.env.robot.name), {"simple_quad"}),
        "policies": Effect("--policies crouch stand", called("resolve", "name_or_path"), ["crouch", "stand"]),
        "speeds": Effect("--speeds 0.5", names, [f"{name} at 0.50 m/s" for name in GROUNDS]),
        "episodes": Effect("--episodes 3", some(lambda each: len(each.seeds)), {3}),
        "seed": Effect(SEED, lambda made: set(seeds(made)), {drawn(5, 3)}),
        "table": Effect("--table FOLDER/new/walks.csv", written("new/walks.csv"), True),
        "page": Effect("--page FOLDER/page.md", lambda made: page(made).count("0.50 m/s |"), 3),
        "threads": Effect(*THREADS),
    },
    "prediction": {
        "policy": Effect("--policy mpc", lambda made: "`mpc`" in page(made), True),
        "episodes": Effect("--episodes 2", robots(lambda each: len(each.seeds)), [2, 1]),
        "seed": Effect(SEED, seeds, [drawn(5, 2, "validation"), drawn(5, 1, "validation")]),
        "ground": Effect("--ground 4", lambda made: made.batches[0].env.scenario.terrain.seed, 4),
        "start": Effect("--start 110", called("draw", "start"), [110]),
        "out": Effect("--out FOLDER/new/plan.png", written("new/plan.png"), True),
        "page": Effect("--page FOLDER/page.md", lambda made: "| rough | 0.40 |" in page(made), True),
    },
    "pictures": {
        "policies": Effect("--policies stand crouch", called("resolve", "name_or_path"), ["stand", "crouch"]),
        "trust": TRUSTED,
        "scenarios": Effect("--scenarios push slope", names, ["push", "slope"]),
        "out": Effect("--out FOLDER/new/strip.png", written("new/strip.png"), True),
        "robots": Effect("--robots go1", some(lambda each: each.env.robot.name), {"go1"}),
        "command": Effect("--command 0.4 0.0 -0.2", some(lambda each: each.command[2] < 0.0), {True}),
        "start": Effect("--start 0.2", some(lambda each: each.env.max_episode_steps), {21 + 2 * 3}),
        "every": Effect("--every 0.03", some(lambda each: each.env.max_episode_steps), {21 + 2 * 3}),
        "frames": Effect("--frames 3", picture, (3, 4)),
        "seed": Effect(SEED, lambda made: set(seeds(made)), {(5,)}),
        "camera": Effect("--camera side", called("Camera.__init__", "camera"), ["side"]),
    },
    "calibration": {
        "sets": Effect("--sets 20", called("share_of_yes", "sets"), [20]),
        "episodes": Effect(
            "--episodes 16", lambda made: [each.count for each in made.of("share_of_yes", "check")], [16]
        ),
        "fall_probabilities": Effect(
            "--fall-probabilities 0.37",
            checks("fall_probability"),
            [0.37],
        ),
        "only": Effect(
            "--only lot",
            checks("name"),
            ["McNemar, ties by lot"],
        ),
        "seed": Effect(SEED, called("share_of_yes", "seed"), [5]),
    },
}


def walkers(made: Called) -> list[str]:
    """Names of the policies in the order in which they are loaded."""
    assert made.done
    return [each["name_or_path"] for each in made.calls["resolve"]]


def page(made: Called) -> str:
    assert made.code == 0
    return (made.folder / "page.md").read_text("utf-8")


def runs() -> Iterator[Any]:
    """Command and words that are given together."""
    for command, effects in EFFECTS.items():
        marks = [pytest.mark.rendering] if "camera" in effects else []
        for given in dict.fromkeys(each.given for each in effects.values()):
            yield pytest.param(command, given, marks=marks, id=f"{command} {given}".strip())


@pytest.fixture(autouse=True)
def _brief_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    for place in ("evaluate.rollouts.rollout", safety.__name__, estimation.__name__):
        monkeypatch.setattr(f"{place}.STEPS", BRIEF)
    monkeypatch.setattr(prediction, "GROUNDS", ("rough",))
    monkeypatch.setattr(prediction.walk, "__defaults__", (None, 2 * BRIEF))


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of two policies on two scenarios, with traces."""
    folder = tmp_path_factory.mktemp("evaluated")
    words = "--policies stand crouch --scenarios flat push --episodes 3 --trace compact --no-film --threads 1 --out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("evaluate.rollouts.rollout.STEPS", BRIEF)
        assert evaluate([*words.split(), str(folder)]) == 0
    return folder


@pytest.mark.parametrize(("command", "given"), [*runs()])
def test_options_reach_what_they_govern(
    command: str, given: str, evaluated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(evaluated, tmp_path / "a")
    (tmp_path / "page.md").write_text(
        "".join(f"<!-- {name} -->\n<!-- /{name} -->\n" for name in ("results", "success", "prediction")), "utf-8"
    )
    effects = {name: each for name, each in EFFECTS[command].items() if each.given == given}
    words = " ".join([given, *(each.words for each in effects.values())]).replace("FOLDER", str(tmp_path)).split()
    check_other_than_usual(import_module(COMMANDS[command].module).Options, words, effects.keys())
    made = Called(main, [command, *words], tmp_path)
    assert made.code in {0, 1}, capsys.readouterr().err
    check_all(effects, made)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["jump", "--robots", "100000000000"], "--robots must be from 1 to 65536, not 100000000000"),
        (["jump", "--seed", "-1"], "--seed must be from 0 to"),
        (["recovery", "--robots", "100000000000"], "--robots must be from 1 to 1000000"),
        (["safety", "--episodes", "0"], "--episodes must be from 1 to"),
        (["safety", "--hours", "nan"], "--hours must be from 0.001 to 1000.0, not nan"),
        (["safety", "--policy", "gallop"], "no policy 'gallop': name one of"),
        (["calibration", "--seed", "-1"], "--seed must be from 0 to"),
        (["calibration", "--sets", "100000000000"], "--sets must be from 2 to"),
        (["calibration", "--episodes"], "--episodes and --fall-probabilities must each have at least one value"),
        (["calibration", "--fall-probabilities", "0.5", "nan"], "--fall-probabilities must be from 0.001 to 0.999"),
        (["gait-diagram", "--command", "nan", "0", "0"], "--command must be from -10.0 to 10.0, not (nan, 0.0, 0.0)"),
        (["gait-diagram", "--out", "file/gait.png"], "--out: cannot write to the folder file ("),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_values_that_nothing_can_be_done_with_are_one_line(capsys, tmp_path, monkeypatch, words, said) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert main(words) == 2
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert printed.err.startswith(f"error: {said}")
