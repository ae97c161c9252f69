"""Every command of `python -m evaluate`: its --help, and an effect of each of its options.

`EFFECTS` has an entry for each option, or `ELSEWHERE` names its test; an option without either fails. Options are given
in one call, each with another value than its default; mutually exclusive options are given in separate calls.
"""

import json
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from evaluate.__main__ import COMMANDS, main
from evaluate.cells import evaluation_seeds
from evaluate.commands import options as default
from evaluate.rollouts.battery import resolve
from quad_env.cli.program import options_class
from tests.batches import Batch
from tests.effects import Called, Effect, Reading, check_all, check_other_than_usual
from tests.evaluate.commands import test_axes, test_command, test_pages, test_plot, test_replay, test_table
from tests.evaluate.records import test_extension, test_parts, test_resume, test_settled, test_time_limit
from tests.evaluate.rollouts import test_cluster
from tests.quad_env.robots.made import Made
from tests.seams import short_episodes

BRIEF = 130
"""Number of control steps of an episode."""
EVERY = pytest.mark.parametrize("name", COMMANDS)


def options_of(command: str) -> Any:
    return options_class(import_module(COMMANDS[command].module)) if command else default.EvaluateOptions


def once(read: Callable[[Batch], Any]) -> Reading:
    """Return a reading of the batches: each value once, in order."""
    return lambda made: list(dict.fromkeys(map(read, made.batches)))


SCENARIOS, COUNT = once(lambda each: each.env.scenario.name), once(lambda each: len(each.seeds))
HARDWARE = once(lambda each: (each.env.scenario.name, each.sensed, each.env.scenario.hardware))
SEEDS, THREADS = once(lambda each: each.seeds), once(lambda each: each.threads)


def drawn(seed: int, count: int) -> list[tuple[int, ...]]:
    return [tuple(evaluation_seeds(seed, count).tolist())]


def written(name: str) -> Reading:
    """Return a reading that is True if the command has written the file `name` with some content."""
    return lambda made: bool(made.done and (made.folder / name).stat().st_size)


def called(function: str, argument: str) -> Reading:
    """Return a reading of the argument `argument` in each call of the function."""
    return lambda made: made.of(function, argument)


def held(name: str, key: str) -> Reading:
    """Return a reading of an entry of a JSON file."""
    return lambda made: json.loads((made.folder / name).read_bytes())[key] if made.done else None


def baselines(name: str) -> Reading:
    return lambda made: {each["b"] for each in held(name, "comparisons")(made)}


def replayed(made: Called) -> list[tuple[str, str, int]]:
    """Return policy, scenario and index of the rows with the simulated seed and scenario."""
    rows = pq.read_table(made.folder / "a/episodes.parquet").to_pylist()
    first = made.batches[0]
    (policy,) = made.of("resolve", "name_or_path")
    wanted = first.seeds[0], first.env.scenario.name, policy
    found = [row for row in rows if (row["seed"], row["scenario"], row["policy"]) == wanted]
    return [(row["policy"], row["scenario"], row["episode"]) for row in found]


TRUSTED = Effect("--trust", called("resolve", "trust"), [True])
SHORT = "--policies stand --scenarios flat --episodes 5 --threads 1 --out FOLDER/new"
EFFECTS: dict[str, dict[str, Effect]] = {
    "": {
        "policies": Effect("--policies crouch stand", called("resolve", "name_or_path"), ["crouch", "stand"]),
        "trust": TRUSTED,
        "scenarios": Effect("--scenarios push=42 flat", SCENARIOS, ["push=42", "flat"]),
        "episodes": Effect("--episodes 3", COUNT, [2 * 3]),  # two policies share a batch
        "robot": Effect("--robot FOLDER/mine.xml", once(lambda each: each.env.robot.name), ["mine"]),
        "servo": Effect("--servo 40/1.5", once(lambda each: each.env.robot.servo), ["40 N·m/rad and 1.5 N·m·s/rad"]),
        "actuator": Effect("--actuator motor", once(lambda each: each.warms), [True]),
        "sensors": Effect("--sensors typical", once(lambda each: each.sensed), [True]),
        "estimator": Effect(
            "--estimator kalman", once(lambda each: type(each.env.estimator).__name__), ["KalmanFilter"]
        ),
        "seed": Effect("--seed 5", SEEDS, [2 * seeds for seeds in drawn(5, 3)]),
        "out": Effect("--out FOLDER/new", written("new/results.json"), True),
        "baseline": Effect("--baseline crouch", baselines("new/results.json"), {"crouch"}),
        "threads": Effect("--threads 1", THREADS, [1]),
        "at_once": Effect("--at-once 2", COUNT, [2, 1], given=SHORT),
        "quick": Effect(
            "--quick",
            SCENARIOS,
            [scenario.name for scenario in resolve(("quick",))],
            given=SHORT.replace("--scenarios flat ", "").replace("--episodes 5", "--episodes 1"),
        ),
        "hardware": Effect("--hardware", HARDWARE, [("flat+hardware", True, True)], given=SHORT),
    },
    "report": {
        "folder": Effect("FOLDER/a", written("a/results.json"), True),
        "baseline": Effect("--baseline crouch", baselines("a/results.json"), {"crouch"}),
    },
    "table": {},
    "plot": {},
    "merge": {},
    "replay": {
        "results": Effect("FOLDER/a", replayed, [("crouch", "push", 2)]),
        "episode": Effect("2", replayed, [("crouch", "push", 2)]),
        "policy": Effect("--policy crouch", replayed, [("crouch", "push", 2)]),
        "scenario": Effect("--scenario push", replayed, [("crouch", "push", 2)]),
        "trust": TRUSTED,
        "video": Effect("--video FOLDER/walk.png", written("walk.png"), True),
    },
    "compare": {
        "a": Effect("FOLDER/a", lambda made: Path(held("found.json", "a")(made)).name, "a"),
        "b": Effect("FOLDER/b", lambda made: Path(held("found.json", "b")(made)).name, "b"),
        "policies": Effect(
            "--policies crouch stand",
            lambda made: {(each["a"], each["b"]) for each in held("found.json", "comparisons")(made)},
            {("crouch", "stand")},
        ),
        "json": Effect("--json FOLDER/found.json", written("found.json"), True),
    },
    "axes": {
        "axes": Effect("dropout", lambda made: {name.split(":")[0] for name in SCENARIOS(made)}, {"dropout"}),
        "policies": Effect("--policies stand", called("resolve", "name_or_path"), ["stand"]),
        "trust": TRUSTED,
        "episodes": Effect("--episodes 2", COUNT, [2]),
        "seed": Effect("--seed 5", SEEDS, drawn(5, 2)),
        "robot": Effect("--robot FOLDER/mine.xml", once(lambda each: each.env.robot.name), ["mine"]),
        "hardware": Effect("--hardware", lambda made: {real for *_, real in HARDWARE(made)}, {True}),
        "out": Effect("--out FOLDER/new", written("new/results.json"), True),
        "threads": Effect("--threads 1", THREADS, [1]),
    },
}


PASSED_ON = test_axes.test_every_other_option_is_that_of_a_comparison
ELSEWHERE = {
    "": {
        "resume": test_resume.test_a_killed_run_goes_on_to_the_same_files,
        "add": test_extension.test_a_policy_is_added_and_only_its_episodes_are_simulated,
        "part": test_parts.test_parts_in_any_order_are_one_run,
        "ray": test_cluster.test_an_evaluation_has_the_bytes_of_local_workers_though_ray_workers_are_killed,
        "minutes": test_time_limit.test_it_ends_at_its_limit_after_whole_rounds_with_equal_episodes_of_every_policy,
        "full": test_time_limit.test_other_options_have_a_fixed_number_of_episodes_unless_they_name_minutes,
        "until": test_settled.test_a_run_adds_episodes_until_neighbours_are_distinguished_and_says_so,
        "simulator": "tests.evaluate.rollouts.test_simulator, where there is pydrake",
    },
    "report": {
        "success": test_command.test_a_report_by_another_rule_of_success_is_printed_and_leaves_the_files_alone,
        "pages": test_pages.test_each_page_is_made_once_and_the_report_links_it,
        "trust": test_pages.test_files_that_can_hide_code_are_loaded_for_pages_where_they_are_trusted,
    },
    "table": {
        "folder": test_table.test_csv_has_the_figures_of_the_report_for_every_scenario_and_policy,
        "format": test_table.test_markdown_has_units_in_its_heads_and_a_column_for_each_policy,
        "columns": test_table.test_one_text_column_is_a_table_and_two_are_a_wide_one,
        **dict.fromkeys(
            ("out", "policies", "scenarios"), test_table.test_policies_and_scenarios_select_columns_and_rows
        ),
    },
    "plot": {
        **dict.fromkeys(
            ("runs", "kind", "out", "columns"), test_plot.test_a_vector_figure_has_the_width_of_its_columns
        ),
        "policies": test_plot.test_policies_select_and_order_the_entries,
    },
    "merge": {
        **dict.fromkeys(("folders", "out"), test_parts.test_parts_in_any_order_are_one_run),
        "baseline": test_parts.test_the_baseline_of_the_merged_run_is_the_chosen_one,
        "any_processor": test_parts.test_other_processors_are_accepted_on_request_and_recorded,
    },
    "replay": {
        "page": test_pages.test_a_page_shows_the_episode_and_another_policy_on_the_same_seed,
        "against": test_pages.test_a_page_shows_the_episode_and_another_policy_on_the_same_seed,
        "failed": test_replay.test_failed_episodes_are_listed_with_the_row_that_replays_them,
    },
    "axes": {
        "resume": test_axes.test_it_goes_on_with_what_was_done,
        **dict.fromkeys(
            {field.name for field in fields(default.EvaluateOptions)} - EFFECTS["axes"].keys() - {"resume"}, PASSED_ON
        ),
    },
}
"""Options that have their own tests."""


def runs() -> Iterator[Any]:
    """Yield each command with the arguments of its calls."""
    for command, effects in EFFECTS.items():
        marks = [pytest.mark.rendering] if "video" in effects else []
        for given in dict.fromkeys(each.given for each in effects.values()):
            yield pytest.param(command, given, marks=marks, id=f"evaluate {command} {given}".strip())


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_every_option_has_an_effect_that_is_tested(command: str) -> None:
    options = {field.name for field in fields(options_of(command))}
    assert options == EFFECTS[command].keys() | ELSEWHERE.get(command, {}).keys()


@pytest.fixture(autouse=True)
def _brief_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    short_episodes(monkeypatch, BRIEF)


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the results folder of two policies on two scenarios."""
    folder = tmp_path_factory.mktemp("evaluated")
    words = "--policies stand crouch --scenarios flat push --episodes 3 --threads 1 --out"
    with pytest.MonkeyPatch.context() as patch:
        short_episodes(patch, BRIEF)
        assert main([*words.split(), str(folder)]) == 0
    return folder


@pytest.mark.parametrize(("command", "given"), [*runs()])
def test_options_reach_what_they_govern(
    command: str, given: str, evaluated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a", "b"):
        shutil.copytree(evaluated, tmp_path / name)
    (tmp_path / "a/results.json").unlink()
    Made().write(tmp_path, "mine.xml")
    effects = {name: each for name, each in EFFECTS[command].items() if each.given == given}
    text = " ".join([given, *(each.words for each in effects.values())]).replace("FOLDER", str(tmp_path))
    words = text.split()
    check_other_than_usual(options_of(command), words, effects.keys())
    made = Called(main, [*filter(None, [command]), *words], tmp_path)
    assert made.code in {0, 1}, capsys.readouterr().err
    check_all(effects, made)


@EVERY
def test_help_explains_every_option_with_its_default(capsys, name) -> None:
    with pytest.raises(SystemExit) as end:
        main([name, "--help"])
    assert not end.value.code
    printed = capsys.readouterr().out
    assert printed.startswith(f"usage: python -m evaluate {name} ")
    plain = re.sub("[│╭╮╰╯─]", " ", printed)
    for option in re.split(r"\n +(?=--[a-z])", plain)[1:]:
        words = " ".join(option.split())
        assert re.search(r"^--[a-z, -]+ .+ [a-z].+\(default: ", words), words


def test_a_folder_without_results_is_one_line(refused, tmp_path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "thesis.tex").write_text("", encoding="utf-8")
    for path in (str(tmp_path / name) for name in ("nowhere", "empty", "thesis.tex")):
        for words in (["report", path], ["replay", path, "0"], ["compare", path, path]):
            said = f"error: {path} is no folder with results of `python -m evaluate`: it has no manifest.json\n"
            assert refused(main, *words) == said
