"""A run with --until settled adds episodes until adjacent policies are distinguished, also after interruptions."""

import json
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from evaluate.analysis.comparison import SIGNIFICANT
from evaluate.analysis.ranking import RANKING_WEIGHT
from evaluate.records import manifest, store
from evaluate.rollouts import rollout
from evaluate.statistics.sequential import correction
from quad_env.files.writing import write_atomically
from tests.evaluate.records.test_resume import a_page, assert_same, evaluate, full
from tests.seams import full_disk, replace_report, replace_simulation

RUN = ("stand", "trot", "--scenarios", "flat", "push:4", "--until", "settled", "--episodes", "16", "--seed", "2")
ONE = ("--threads", "1", "--out")


@pytest.fixture(scope="module", autouse=True)
def short():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rollout, "STEPS", 150)
        replace_report(patch, a_page)
        yield


@pytest.fixture(scope="module")
def settled(tmp_path_factory) -> tuple[Path, str]:
    """Return the folder of an uninterrupted run, and the text that it printed."""
    folder = tmp_path_factory.mktemp("settled")
    code, said = evaluate(*RUN, *ONE, folder)
    assert code == 0, said
    return folder, said


def results(folder: Path) -> dict:
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))


def test_a_run_adds_episodes_until_neighbours_are_distinguished_and_says_so(settled) -> None:
    folder, said = settled
    lines = [line for line in said.splitlines() if "neighbours" in line]
    assert [line.split(":")[0] for line in lines] == [
        "4 of at most 16 episodes, 0 of 1 neighbours distinguished",
        "8 of at most 16 episodes, 1 of 1 neighbours distinguished",
    ]
    assert lines[1].endswith(": trot > stand")
    made_with = manifest.read(folder)
    assert (made_with.episodes, made_with.limit, made_with.options["episodes"]) == (8, 16, 16)
    assert made_with.ended == "every two neighbours in the ranking are distinguished"
    assert (results(folder)["episodes"], results(folder)["complete"]) == (8, True)
    assert pq.read_table(folder / "episodes.parquet").num_rows == 2 * 2 * 8


def test_its_report_claims_what_the_look_did_with_a_p_value_corrected_for_all_looks(settled) -> None:
    (found,) = results(settled[0])["ranking"]["neighbours"]
    assert (found["better"], found["worse"], found["p_value"]) == ("trot", "stand", pytest.approx(2 / 2**8))
    assert found["p_value"] * correction(8, 16, 2) * 0.999 / RANKING_WEIGHT <= found["p_value_holm"] < SIGNIFICANT


def test_its_episodes_are_those_of_a_run_of_as_many(settled, tmp_path) -> None:
    fixed = [word for word in RUN if word not in ("--until", "settled")]
    fixed[fixed.index("16")] = "8"
    assert evaluate(*fixed, *ONE, tmp_path)[0] == 0
    mine, other = (pq.read_table(folder / "episodes.parquet") for folder in (settled[0], tmp_path))
    assert mine.equals(other)


def test_a_finished_one_is_finished(settled, tmp_path) -> None:
    shutil.copytree(settled[0], tmp_path, dirs_exist_ok=True)
    code, said = evaluate("--resume", "--out", tmp_path)
    assert (code, "nothing is left" in said) == (0, True)
    assert_same(tmp_path, settled[0])
    assert evaluate("report", tmp_path)[0] == 0
    assert_same(tmp_path, settled[0])


@pytest.mark.parametrize("kept", [2, 7])
def test_one_that_dies_goes_on_to_the_same_files(settled, tmp_path, monkeypatch, kept) -> None:
    left, write = iter(range(kept)), store.write_table
    monkeypatch.setattr(store, "write_table", lambda *words: write(*words) if next(left, None) is not None else full())
    assert evaluate(*RUN, *ONE, tmp_path)[0] == 2
    monkeypatch.undo()
    assert evaluate("report", tmp_path)[0] == 0
    found = results(tmp_path)
    assert (found["complete"], found["episodes"]) == (False, 4), "of the last look, or of the first"
    assert sum(len(policy["scenarios"]) for policy in found["policies"].values()) == min(kept, 4)
    assert evaluate("--resume", *ONE, tmp_path)[0] == 0
    assert_same(tmp_path, settled[0])


def test_one_that_dies_while_it_ends_goes_on_to_the_same_files(settled, tmp_path, monkeypatch) -> None:
    full_disk(monkeypatch, "results.json", "episodes.parquet", "report.html")
    assert evaluate(*RUN, *ONE, tmp_path)[0] == 2
    monkeypatch.undo()
    replace_simulation(monkeypatch, full)
    code, said = evaluate("--resume", "--out", tmp_path)
    assert (code, "nothing is left" in said) == (0, True)
    assert_same(tmp_path, settled[0])


def test_ctrl_c_leaves_the_last_look(settled, tmp_path, monkeypatch) -> None:
    left, run = iter(range(1)), rollout.run_scenarios  # the first look is one rollout of both policies and scenarios

    def interrupted(*words, **options):
        if next(left, None) is None:
            raise KeyboardInterrupt
        return run(*words, **options)

    replace_simulation(monkeypatch, interrupted)
    code, said = evaluate(*RUN, *ONE, tmp_path)
    assert (code, "go on with" in said) == (130, True), said
    assert (results(tmp_path)["complete"], results(tmp_path)["episodes"]) == (False, 4)
    replace_simulation(monkeypatch, run)
    assert evaluate("--resume", *ONE, tmp_path)[0] == 0
    assert_same(tmp_path, settled[0])


def test_a_changed_number_of_episodes_is_seen(settled, tmp_path) -> None:
    shutil.copytree(settled[0], tmp_path, dirs_exist_ok=True)
    text = (tmp_path / "manifest.json").read_text(encoding="utf-8")
    write_atomically(tmp_path / "manifest.json", text.replace('"episodes": 8', '"episodes": 4').encode())
    code, said = evaluate("report", tmp_path)
    assert (code, "has been changed" in said) == (2, True)


@pytest.mark.parametrize("words", ["trot --quick", "trot stand@flat --quick", "stand trot@steady --quick"])
def test_a_run_without_a_ranking_is_refused(tmp_path, no_simulation, words) -> None:
    code, said = evaluate(*words.split(), "--until", "settled", "--out", tmp_path)
    assert (code, said.count("\n"), "two policies or more" in said) == (2, 1, True), said


def test_the_most_episodes_are_96_by_default_and_no_other_option_is_needed_to_go_on(tmp_path) -> None:
    from evaluate.commands.options import EvaluateOptions, command, options_from_json

    assert (
        EvaluateOptions().max_episodes,
        EvaluateOptions(until="settled").max_episodes,
        EvaluateOptions(until="settled", episodes=40).max_episodes,
    ) == (48, 96, 40)
    kept = EvaluateOptions(until="settled").run_options()
    assert command(kept) == "python -m evaluate --episodes 96 --until settled"
    assert EvaluateOptions(**options_from_json(kept)).run_options() == kept
