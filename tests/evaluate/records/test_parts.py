"""Parts of an evaluation: together they are one run, to the byte; anything else is refused in one line."""

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evaluate.cells import EpisodeChunk
from evaluate.commands.options import EvaluateOptions
from evaluate.commands.plan import check
from evaluate.records import manifest
from evaluate.records.parts import join_parts, read_part
from evaluate.records.shares import select_share
from evaluate.records.store import EPISODES, FILES, ChunkStore
from quad_env.cli.part import Part
from tests.evaluate.split import RUN, evaluate, refused, short_runs, write_altered, write_parts, write_slice

COUNT = 7


@pytest.fixture(autouse=True, scope="module")
def short() -> Iterator[None]:
    with short_runs():
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of one run without parts."""
    folder = tmp_path_factory.mktemp("whole")
    assert evaluate(*RUN, "--out", folder)[0] == 0
    return folder


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return the folders of all parts of that run."""
    return write_parts(tmp_path_factory.mktemp("parts"), COUNT)


def test_parts_in_any_order_are_one_run(whole: Path, parts: list[Path], tmp_path: Path) -> None:
    shuffled = [parts[index] for index in np.random.default_rng(0).permutation(COUNT)]
    code, error = evaluate("merge", *shuffled, "--out", tmp_path)
    assert code == 0, error
    assert {path.name for path in tmp_path.iterdir()} == {*FILES}
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (whole / name).read_bytes(), name


def test_the_baseline_of_the_merged_run_is_the_chosen_one(parts: list[Path], tmp_path: Path) -> None:
    assert evaluate("merge", *parts, "--baseline", "stand", "--out", tmp_path)[0] == 0
    results = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert {each["b"] for each in results["comparisons"]} == {"stand"}
    assert "--baseline: trott is not among" in refused("merge", *parts, "--baseline", "trott", "--out", tmp_path)


def test_a_merged_run_gets_further_episodes_and_a_part_does_not(parts: list[Path], tmp_path: Path) -> None:
    assert evaluate("merge", *parts, "--out", tmp_path)[0] == 0
    code, error = evaluate("--episodes", "6", "--out", tmp_path)
    assert code == 0, error
    assert manifest.read(tmp_path).episodes == 6
    for words in (("--episodes", "6"), ("--add", "crouch")):
        assert f"{words[0]}: {parts[0]} is part 1/{COUNT} of a run; valid: " in refused(*words, "--out", parts[0])


def test_more_parts_than_episodes_are_one_run_too(tmp_path: Path) -> None:
    words = ("--policies", "stand", "--scenarios", "flat", "--episodes", "1")
    folders = write_parts(tmp_path / "parts", 3, *words)
    assert sum((folder / EPISODES).is_file() for folder in folders) == 1
    assert evaluate(*RUN, *words, "--out", tmp_path / "whole")[0] == 0
    assert evaluate("merge", *folders, "--out", tmp_path / "all")[0] == 0
    assert (tmp_path / "all" / EPISODES).read_bytes() == (tmp_path / "whole" / EPISODES).read_bytes()


@pytest.mark.parametrize("count", [1, 2, 7, 40, 1000])
def test_shares_have_every_episode_once_and_equal_cost(count: int) -> None:
    costs = {"flat": 230, "push": 110, "rough": 1010, "stairs": 140}
    episodes = 24
    shares = [select_share(Part(number, count), costs, episodes) for number in range(1, count + 1)]
    for name in costs:
        assert np.concatenate([share.episode_indices(name) for share in shares]).tolist() == [*range(episodes)]
    totals = [sum(costs[name] * len(share.episode_indices(name)) for name in share.ranges) for share in shares]
    mean = sum(costs.values()) * episodes / count
    assert max(abs(total - mean) for total in totals) <= max(costs.values())


def first_half(out: Path, policies: tuple[str, ...], scenario: str) -> list[int]:
    """Return how many of 20 episodes on flat ground and on another scenario are in the first of two parts."""
    plan = check(EvaluateOptions(policies=policies, scenarios=("flat", scenario), episodes=20, out=out, part="1/2"))
    return [len(plan.manifest.episode_indices(name)) for name in ("flat", scenario)]


def test_a_slow_policy_and_uneven_ground_make_a_smaller_share(tmp_path: Path) -> None:
    assert first_half(tmp_path, ("trot",), "push") == [20, 0]
    on_flat, on_rough = first_half(tmp_path, ("trot",), "rough")
    assert (on_flat, 0 < on_rough < 10) == (20, True)
    on_flat, on_push = first_half(tmp_path, ("trot", "mpc_wbc@flat"), "push")
    assert (0 < on_flat < 20, on_push) == (True, 0)


def test_a_missing_part_is_named(parts: list[Path], tmp_path: Path) -> None:
    line = refused("merge", *parts[:2], *parts[3:6], "--out", tmp_path / "all")
    assert f"parts 3, 7 of {COUNT} missing" in line
    assert not (tmp_path / "all").exists()


def test_a_doubled_part_is_named(parts: list[Path], tmp_path: Path) -> None:
    again = Path(shutil.copytree(parts[3], tmp_path / "again"))
    line = refused("merge", *parts, again, "--out", tmp_path / "all")
    assert f"{parts[3]} and {again} hold both part 4/{COUNT}" in line


def test_parts_of_another_number_of_parts_are_named(parts: list[Path], whole: Path, tmp_path: Path) -> None:
    other = write_slice(whole, tmp_path / "other", Part(1, 8), 0, 1)
    line = refused("merge", other, *parts[1:], "--out", tmp_path / "all")
    assert f"{other} holds part 1/8" in line
    assert f"part 1 of {COUNT} missing" in line


def test_episodes_in_two_parts_and_in_none_are_named(whole: Path, tmp_path: Path) -> None:
    first = write_slice(whole, tmp_path / "first", Part(1, 2), 0, 3)
    second = write_slice(whole, tmp_path / "second", Part(2, 2), 2, 4)
    line = refused("merge", first, second, "--out", tmp_path / "all")
    for scenario in ("flat", "push:4"):
        assert f"{first} and {second} have both episode 2 of {scenario}" in line
        assert f"no part has episode 4 of {scenario}" in line


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (("--seed", "3"), "--seed was 2 and is 3"),
        (("--robot", "go1"), "robot was simple_quad and is go1"),
        (("--policies", "stand"), "--policies was stand trot@flat and is stand"),
    ],
)
def test_a_part_with_other_options_is_named(option, words, parts: list[Path], tmp_path: Path) -> None:
    other = tmp_path / "other"
    code, error = evaluate(*RUN, *option, "--part", f"3/{COUNT}", "--out", other)
    assert code == 0, error
    line = refused("merge", *parts[:2], other, *parts[3:], "--out", tmp_path / "all")
    assert f"{other} is of another run than {parts[0]}: " in line
    assert words in line
    assert str(parts[1]) not in line


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda old: replace(old, policies=dict(old.policies) | {"trot": "3-0"}), "the policy trot has changed"),
        (lambda old: replace(old, versions=dict(old.versions) | {"mujoco": "9.9"}), "mujoco was .* and is 9.9"),
        (lambda old: replace(old, code="f" * 64), "the code of quad_env, policies or evaluate has changed"),
        (lambda old: replace(old, cpu="an abacus"), "the processor was .* and is an abacus"),
    ],
)
def test_a_part_of_other_policies_or_versions_is_named(change, words, parts: list[Path], tmp_path: Path) -> None:
    other = write_altered(parts[0], tmp_path / "other", change)
    line = refused("merge", other, *parts[1:], "--out", tmp_path / "all")
    assert re.search(rf"{re.escape(str(other))} is of another run than {re.escape(str(parts[1]))}: .*{words}", line)


def test_other_processors_are_accepted_on_request_and_recorded(parts: list[Path], tmp_path: Path) -> None:
    other = write_altered(parts[6], tmp_path / "other", lambda old: replace(old, cpu="an abacus"))
    code, error = evaluate("merge", other, *parts[:6], "--any-processor", "--out", tmp_path / "all")
    assert code == 0, error
    assert manifest.read(tmp_path / "all").cpu == f"{manifest.read(parts[0]).cpu} or an abacus"
    newer = write_altered(parts[6], tmp_path / "newer", lambda old: replace(old, code="f" * 64))
    assert "the code of" in refused("merge", newer, *parts[:6], "--any-processor", "--out", tmp_path / "all")


def unfinished(part: Path, folder: Path) -> Path:
    """Write the folder of a part that was killed after its first policy."""
    stored = read_part(part)
    folder.mkdir()
    cell = join_parts([stored], stored.manifest).cells[0]
    ChunkStore(folder, stored.manifest).save(EpisodeChunk(stored.share.episode_indices(cell.scenario.name), cell))
    return folder


def test_an_unfinished_part_is_named_and_goes_on_to_the_same_bytes(parts: list[Path], tmp_path: Path) -> None:
    killed = unfinished(parts[0], tmp_path / "killed")
    line = refused("merge", killed, *parts[1:], "--out", tmp_path / "all")
    assert f"{killed} holds part 1/{COUNT}, which is not finished; go on: python -m evaluate --resume" in line
    assert "--part" in refused("--resume", "--part", f"2/{COUNT}", "--out", killed)
    code, error = evaluate("--resume", "--out", killed)
    assert code == 0, error
    assert {path.name for path in killed.iterdir()} == {EPISODES, manifest.NAME}
    for name in (EPISODES, manifest.NAME):
        assert (killed / name).read_bytes() == (parts[0] / name).read_bytes()
    assert "nothing is left to simulate" in evaluate("--resume", "--out", killed)[1]


@pytest.mark.parametrize("name", [EPISODES, manifest.NAME])
def test_a_half_written_file_is_named(name: str, parts: list[Path], tmp_path: Path) -> None:
    damaged = Path(shutil.copytree(parts[0], tmp_path / "damaged"))
    content = (damaged / name).read_bytes()
    (damaged / name).write_bytes(content[: len(content) // 2])
    assert f"{damaged / name} is " in refused("merge", damaged, *parts[1:], "--out", tmp_path / "all")


def test_a_folder_that_is_no_part_is_named(whole: Path, parts: list[Path], tmp_path: Path) -> None:
    words = ("merge", *parts, whole, "--out", tmp_path / "all")
    assert f"{whole} holds no part of a run" in refused(*words)
    assert f"{tmp_path} is no folder with results" in refused("merge", *parts, tmp_path, "--out", tmp_path / "all")
    assert "is the folder of a part" in refused("merge", *parts, "--out", parts[2])


@pytest.mark.parametrize("command", [("report",), ("replay",), ("compare",)])
def test_a_part_alone_has_no_results(command, whole: Path, parts: list[Path]) -> None:
    further = {"replay": ["0"], "compare": [whole]}.get(command[0], [])
    line = refused(*command, parts[0], *further)
    assert f"{parts[0]} holds only part 1/{COUNT} of a run; put all parts together: python -m evaluate merge" in line


@pytest.mark.parametrize("part", ["0/3", "4/3", "3", "a/b", "1/0", "-1/3", "1/1000000"])
def test_a_part_that_does_not_exist_is_refused(part: str, tmp_path: Path) -> None:
    assert f"--part: no part K/N, got {part}; valid: " in refused(*RUN, f"--part={part}", "--out", tmp_path / "out")


def test_a_run_of_variable_length_has_no_parts(tmp_path: Path) -> None:
    line = refused(*RUN, "--until", "settled", "--part", "1/2", "--out", tmp_path / "out")
    assert "--part and --until settled" in line
