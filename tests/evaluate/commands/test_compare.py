"""Comparison of two results folders, paired by episodes of equal seeds."""

import dataclasses
import json
import re
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest

import quad_env
from evaluate.__main__ import main
from evaluate.measures.catalogue import EFFORT
from evaluate.records import manifest
from evaluate.records.episode_table import read_table
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.scenario import with_hardware_profile
from tests.evaluate.altered import column, other
from tests.seams import short_episodes, without_report


def compare(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    code = main(["compare", *map(str, arguments)])
    printed = capsys.readouterr()
    return code, printed.out + printed.err


def test_a_run_and_itself_are_the_same_to_the_bit(run, capsys) -> None:
    code, said = compare(capsys, run.folder, run.folder / "results.json")
    assert code == 0
    assert "6 of 6" in said
    assert "paired by episode" in said
    assert "differ in: nothing that is known" in said


def test_a_difference_is_b_minus_a_paired_by_episode(run, tmp_path, capsys) -> None:
    def worse(rows: pa.Table) -> pa.Table:
        trot = np.array(rows.column("policy").to_pylist()) == "trot"
        return column(rows, "velocity_error", rows.column("velocity_error").to_numpy() + 0.125 * trot)

    b = other(run, tmp_path / "b", worse, versions=manifest.versions() | {"mujoco": "9.9"}, cpu="an abacus")
    code, said = compare(capsys, run.folder, b, "--json", tmp_path / "found.json")
    assert code == 0
    assert "4 of 6" in said
    assert "mujoco was" in said
    assert "an abacus" in said
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    for match in found["comparisons"]:
        success, falls, velocity = match["contrasts"][:3]
        assert match["identical"] == (match["a"] != "trot")
        assert (success["metric"], success["difference"], success["p_value"]) == ("success_rate", 0.0, 1.0)
        assert (falls["metric"], falls["test"], falls["p_value"]) == ("fall_rate", "exact McNemar", 1.0)
        expected = 0.125 if match["a"] == "trot" else 0.0
        assert velocity["difference"] == pytest.approx(velocity["b"] - velocity["a"], abs=1e-12)
        assert velocity["difference"] == pytest.approx(expected)
        # All five agree: at most 3.8415 / 8.8415 of the episodes may differ (Wilson), within -2 … 2 m/s.
        others = 0.43448
        ends = [expected - others * (expected + 2.0), expected + others * (2.0 - expected)]
        if match["identical"]:
            assert all((each["difference"], each["ci"]) == (0.0, [None, None]) for each in match["contrasts"])
        else:
            assert velocity["ci"] == pytest.approx(ends, abs=1e-4)
        # Five differences of one sign: 2 of 2^5 sign flips give as large a sum.
        assert velocity["p_value"] == (pytest.approx(2 / 32) if expected else 1.0)


def test_another_definition_of_a_scenario_is_named_and_other_seeds_are_refused(run, tmp_path, capsys) -> None:
    softer = dataclasses.replace(quad_env.SCENARIOS["push"], pushes=quad_env.Pushes(impulse=5.0))
    _, said = compare(capsys, run.folder, other(run, tmp_path / "c", scenarios=(quad_env.SCENARIOS["flat"], softer)))
    assert "A and B differ in: the scenario push has changed" in said
    assert "6 of 6" in said
    b = other(run, tmp_path / "b", lambda rows: column(rows, "seed", np.arange(rows.num_rows)))
    code, said = compare(capsys, run.folder, b)
    assert (code, "no episodes of the same --seed, in common" in said) == (2, True)


def test_of_runs_of_one_seed_the_common_episodes_are_paired(run, tmp_path, capsys) -> None:
    """Three of five episodes are common to both runs: the episodes with equal seeds."""
    b = other(run, tmp_path / "b", lambda rows: rows.filter(pc.less(rows.column("episode"), 3)), episodes=3)
    code, said = compare(capsys, run.folder, b, "--json", tmp_path / "found.json")
    assert code == 0
    assert "paired by episode: 3 episodes of the same seeds, of A's 5 and B's 3" in said
    assert "6 of 6" in said
    rows = read_table(run.folder / "episodes.parquet").to_pylist()
    for match in json.loads((tmp_path / "found.json").read_text())["comparisons"]:
        assert (match["episodes"], match["common"]) == ([5, 3], 3)
        errors = [
            row["velocity_error"]
            for row in rows
            if (row["policy"], row["scenario"]) == (match["a"], match["scenario"]) and row["episode"] < 3
        ]
        velocity = next(each for each in match["contrasts"] if each["metric"] == "velocity_error")
        assert velocity["a"] == velocity["b"] == pytest.approx(np.mean(errors))


def test_what_an_unfinished_run_lacks_is_said(run, tmp_path, capsys) -> None:
    b = other(run, tmp_path / "b", lambda rows: rows.slice(5))
    code, said = compare(capsys, run.folder, b)
    assert code == 0
    assert "B is not finished, and left out of it are: document on flat" in said


def test_rows_without_their_seed_are_one_line(run, tmp_path, refused) -> None:
    b = other(run, tmp_path / "b", lambda rows: rows.drop_columns(["seed", "fell"]))
    assert "it lacks the columns fell, seed" in refused(main, "compare", run.folder, b)


def test_other_policies_are_ranked_with_those_of_the_first_run(run, tmp_path, capsys) -> None:
    def renamed(rows: pa.Table) -> pa.Table:
        policies = rows.column("policy").to_pylist()
        outcomes = ["succeeded" if policy == "trot" else "off_command" for policy in policies]
        return column(column(rows, "outcome", outcomes), "policy", [f"new {policy}" for policy in policies])

    b = other(run, tmp_path / "b", renamed, policies={f"new {policy}": "" for policy in ("document", "stand", "trot")})
    code, said = compare(capsys, run.folder, b, "--json", tmp_path / "found.json")
    assert code == 0
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert {each["policy"] for each in found["ranking"]["places"]} == {
        "document", "stand", "trot", "new document", "new stand", "new trot"
    }  # fmt: skip
    assert (found["ranking"]["places"][0]["policy"], found["comparisons"]) == ("new trot", [])
    assert "new trot" in said.splitlines()[0]


def test_a_policy_of_both_runs_stands_with_its_folder_unless_it_is_the_same_to_the_bit(run, tmp_path, capsys) -> None:
    """All episodes of trot fail in B.

    Its score falls by the amount that the ranking reports between adjacent policies.
    """

    def worse(rows: pa.Table) -> pa.Table:
        policies, outcomes = (rows.column(name).to_pylist() for name in ("policy", "outcome"))
        changed = ["fell" if policy == "trot" else old for policy, old in zip(policies, outcomes, strict=True)]
        return column(rows, "outcome", changed)

    b = other(run, tmp_path / "b", worse)
    said = compare(capsys, run.folder, b, "--json", tmp_path / "found.json")[1]
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    places = {each["policy"]: each for each in found["ranking"]["places"]}
    a_trot, b_trot = f"trot ({run.folder.name})", "trot (b)"
    assert {*places} == {"document", "stand", a_trot, b_trot}
    scores = {each["policy"]: each["score"] for each in run.results["scores"]}
    assert (places[a_trot]["success"], places[b_trot]["success"]) == (pytest.approx(scores["trot"]), 0.0)
    assert places[a_trot]["cost"] == pytest.approx(places[b_trot]["cost"])
    assert said.startswith(f"{a_trot} ")


def test_effort_is_compared_too_and_the_cost_is_that_of_all_episodes(run, tmp_path, capsys) -> None:
    def wasteful(rows: pa.Table) -> pa.Table:
        longer = column(rows, "energy", rows.column("energy").to_numpy() * np.arange(1, rows.num_rows + 1))
        return column(longer, "flight", rows.column("flight").to_numpy() + 0.25)

    b = other(run, tmp_path / "b", wasteful)
    code, said = compare(capsys, run.folder, b, "--policies", "trot", "trot", "--json", tmp_path / "found.json")
    assert (code, "cost of" in said, "steps" in said, "25.0" in said) == (0, True, True, True)
    rows = read_table(b / "episodes.parquet").to_pylist()
    for match in json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))["comparisons"]:
        found = {each["metric"]: each for each in match["contrasts"]}
        mine = [row for row in rows if (row["policy"], row["scenario"]) == ("trot", match["scenario"])]
        cost = sum(row["energy"] for row in mine) / sum(row["distance"] for row in mine) / (SIMPLE_QUAD.mass * 9.81)
        assert found["cost_of_transport"]["b"] == pytest.approx(cost)
        assert found["cost_of_transport"]["difference"] == pytest.approx(cost - found["cost_of_transport"]["a"])
        assert found["flight"]["difference"] == pytest.approx(0.25)
        assert set(EFFORT) <= set(found)


def test_the_answer_whether_the_ranking_survives(run, tmp_path, capsys) -> None:
    """Two of three policies always fail: trot is first in A and stand in B; a rank correlation needs three policies."""

    def swapped(rows: pa.Table) -> pa.Table:
        policies = rows.column("policy").to_pylist()
        outcomes = ["succeeded" if policy == "stand" else "off_command" for policy in policies]
        return column(rows, "outcome", outcomes)

    b = other(run, tmp_path / "b", swapped)
    code, said = compare(capsys, run.folder, b, "--json", tmp_path / "found.json")
    assert code == 0
    assert "does the ranking survive? no" in said
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert found["rank_correlation"]["policies"] == ["document", "stand", "trot"]
    assert found["rank_correlation"]["scores"][1] == [0.0, 1.0, 0.0]
    # One pair of three is tied in each run, and one is reversed.
    assert found["rank_correlation"]["correlation"] == pytest.approx(-0.5)
    assert {match["p_value_holm"] for match in found["comparisons"]} != {None}
    said = compare(capsys, run.folder, b, "--policies", "trot", "trot", "--json", tmp_path / "found.json")[1]
    assert "fewer than 3 policies" in said
    assert json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))["rank_correlation"] is None


def test_success_that_differs_after_correction_is_named(tmp_path, capsys, monkeypatch) -> None:
    """20 of 20 episodes succeed only in B: p is 2 / 2^20, significant after any correction."""
    short_episodes(monkeypatch, 150)
    without_report(monkeypatch)
    folder = tmp_path / "a"
    words = ["--policies", "document", "stand", "--scenarios", "flat", "--episodes", "20", "--out", str(folder)]
    assert main(words) == 0

    def changed(rows: pa.Table) -> pa.Table:
        outcomes = np.array(rows.column("outcome").to_pylist(), dtype=object)
        outcomes[np.array(rows.column("policy").to_pylist()) == "document"] = "succeeded"
        return column(rows, "outcome", outcomes.tolist())

    said = compare(capsys, folder, other(SimpleNamespace(folder=folder), tmp_path / "b", changed))[1]
    assert "success differs: document on flat, 100.0 points, p\u00a0<\u00a00.001" in said
    assert "success differs: stand" not in said


def test_a_success_that_only_its_own_interval_shows_is_called_undistinguished(run, tmp_path, capsys) -> None:
    """Five of five episodes succeed only in B: Tango's interval excludes 0, and p is 2 / 2^5 before correction."""

    def changed(rows: pa.Table) -> pa.Table:
        outcomes = np.array(rows.column("outcome").to_pylist(), dtype=object)
        outcomes[np.array(rows.column("policy").to_pylist()) == "document"] = "succeeded"
        return column(rows, "outcome", outcomes.tolist())

    said = compare(capsys, run.folder, other(run, tmp_path / "b", changed))[1].replace("\u00a0", " ")
    (line,) = re.findall(
        "^success cannot be distinguished, though its interval by itself excludes 0: (.*)$", said, re.M
    )
    assert re.fullmatch(r"document on flat \(p = [\d.]+\), document on push \(p = [\d.]+\)", line)
    assert "success differs" not in said


def test_runs_with_and_without_the_hardware_profile_are_matched(run, tmp_path, capsys) -> None:
    def renamed(rows: pa.Table) -> pa.Table:
        return column(rows, "scenario", [f"{name}+hardware" for name in rows.column("scenario").to_pylist()])

    b = other(
        run, tmp_path / "b", renamed, scenarios=tuple(map(with_hardware_profile, manifest.read(run.folder).scenarios))
    )
    code, said = compare(capsys, run.folder, b)
    assert code == 0
    assert "A and B differ in: the hardware profile, which one of them has" in said
    assert "paired by episode: 5 episodes of the same seeds" in said
    assert "ranking of B: " in said
    assert "ranking of B: " in compare(capsys, b, b)[1]
