"""Intervals have their coverage and tests their error rate; the checks of both detect planted faults."""

import numpy as np
import pytest

from evaluate.statistics import breaking_point, sequential, significance
from evaluate.statistics import intervals as statistics
from research.__main__ import main
from research.statistics import checks, settled
from research.statistics.synthetic import make_episodes, mean_error

FALLS = (0.1, 0.3, 0.5, 0.7, 0.9)
COUNT = 64
COVERAGE = [check.name for check in checks.coverage_checks(COUNT, 0.5)]
BREAKING = {check.name: check for check in checks.breaking_checks(COUNT)}
LEVEL = ["sign flips, exchangeable pairs", "McNemar, ties by lot"]


@pytest.fixture(autouse=True)
def fewer_resamples(monkeypatch) -> None:
    """Use a tenth of the resamples: ends of intervals are noisier, and coverage and levels are equal."""
    for module, name, count in (
        (statistics, "RESAMPLES", 999),
        (significance, "FLIPS", 999),
        (significance, "MORE_FLIPS", 1999),
    ):
        monkeypatch.setattr(module, name, count)


def share(rules, name: str, sets: int, falls=FALLS) -> float:
    """Return the rejection rate over data sets of all fall probabilities."""
    rows = [check for p in falls for check in rules(COUNT, p) if check.name == name]
    return float(np.mean([checks.rejection_rate(check, sets // len(falls), seed=2) for check in rows]))


@pytest.mark.parametrize("name", COVERAGE)
def test_intervals_cover_the_truth_and_80_percent_intervals_would_be_seen(name, monkeypatch) -> None:
    low, high = checks.COVERAGE_BOUNDS
    assert low <= share(checks.coverage_checks, name, 700) <= high
    monkeypatch.setattr(statistics, "CONFIDENCE", 0.8)
    assert share(checks.coverage_checks, name, 150) < low


def test_breaking_point_intervals_cover_the_truth_whatever_the_shape_and_one_of_60_percent_would_be_seen(
    monkeypatch,
) -> None:
    for name, check in BREAKING.items():
        low, high = check.bounds
        assert low <= checks.rejection_rate(check, 30, seed=2) <= high, name
    monkeypatch.setattr(breaking_point, "CONFIDENCE", 0.6)
    assert (
        checks.rejection_rate(BREAKING["breaking point, one half at a level"], 200, seed=2)
        < checks.MIN_COVERAGE_BOUNDS[0]
    )


@pytest.mark.parametrize("name", LEVEL)
def test_tests_hold_their_level(name) -> None:
    low, high = checks.TYPE_I_ERROR_BOUNDS
    assert low <= share(checks.null_checks, name, 1000) <= high


def test_exact_mcnemar_stays_below_its_level() -> None:
    assert 0.01 < share(checks.null_checks, "McNemar, exchangeable pairs", 1000) < 0.045


def test_made_up_errors_have_the_mean_they_claim() -> None:
    for p in FALLS:
        made = make_episodes(np.random.default_rng(6), (p,), 200_000)
        assert made.fell.mean() == pytest.approx(p, abs=0.004)
        assert made.error.mean() == pytest.approx(mean_error(p), rel=0.01)


ALIKE, APART = settled.Battery((0, 0), 4), settled.Battery((0, 5), 51)


def test_runs_until_settled_hold_their_level_and_looks_at_5_percent_each_would_be_seen(monkeypatch) -> None:
    assert settled.simulate_runs(ALIKE, 300, seed=2)["wrong"] <= 0.05
    assert settled.simulate_runs(settled.Battery((0,) * 6, 12), 60, seed=2)["wrong"] <= 0.05
    monkeypatch.setattr(
        sequential, "nominal_levels", lambda most, policies, _=None: dict.fromkeys(sequential.looks(most), 0.05)
    )
    assert settled.simulate_runs(ALIKE, 300, seed=2)["wrong"] > 0.075


def test_runs_until_settled_end_early_and_stale_pairs_would_be_seen(monkeypatch) -> None:
    found = settled.simulate_runs(APART, 60, seed=2)
    assert (found["wrong"], found["found"]) == (0.0, 1.0)
    assert found["episodes"] < 42.0
    compare = sequential.compare_adjacent_policies

    def one_episode_late(values, most):
        return compare({name: np.roll(each, int(name)) for name, each in values.items()}, most)

    monkeypatch.setattr(sequential, "compare_adjacent_policies", one_episode_late)
    assert settled.simulate_runs(APART, 60, seed=2)["episodes"] > 42.0


def test_the_command_prints_a_row_a_check(capsys) -> None:
    arguments = ["--sets", "20", "--episodes", "16", "--fall-probabilities", "0.4", "--only", "McNemar"]
    assert main(["calibration", *arguments]) == 0
    rows = capsys.readouterr().out.splitlines()[2:-1]
    assert [row.split("  ")[0] for row in rows] == ["McNemar, exchangeable pairs", "McNemar, ties by lot"]


def test_the_table_of_runs_until_settled_goes_into_a_page(tmp_path, capsys) -> None:
    page = tmp_path / "numbers.md"
    page.write_text("before\n<!-- settled -->\n<!-- /settled -->\nafter\n", encoding="utf-8")
    words = ["--only", "settled: 2 policies 5 points apart, 51", "--runs", "4", "--page", str(page)]
    assert main(["calibration", *words]) == 0
    table = capsys.readouterr().out
    assert table.splitlines()[-1].startswith("| settled: 2 policies 5 points apart, 51 scenarios | 0.0 | 100.0 |")
    assert page.read_text(encoding="utf-8") == f"before\n<!-- settled -->\n{table}<!-- /settled -->\nafter\n"
