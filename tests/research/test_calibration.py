"""Intervals cover as often as they say and tests claim no more than they may; the checks of that see planted faults."""

import numpy as np
import pytest

from evaluate.analysis.comparison import compare
from evaluate.statistics import breaking_point, significance
from evaluate.statistics import intervals as statistics
from evaluate.statistics.significance import relabelling_test
from quad_env.scenarios import axes
from research.__main__ import main
from research.statistics import checks, exact_size
from research.statistics.synthetic import episodes, mean_error

FALLS = (0.1, 0.3, 0.5, 0.7, 0.9)
COUNT = 64
COVERAGE = [check.name for check in checks.coverage_checks(COUNT, 0.5)]
PUSHES = [axes.AXES["push"].level(number) for number in (1, 2, 3)]
LEVEL = ["sign flips, exchangeable pairs", "McNemar, ties by lot", "relabelling, disjoint episodes"]


@pytest.fixture(autouse=True)
def fewer_resamples(monkeypatch) -> None:
    """A tenth of the resamples: ends of intervals are a little noisier then, coverage and levels are the same."""
    for module, name, count in (
        (statistics, "RESAMPLES", 999),
        (statistics, "FEWER_RESAMPLES", 399),
        (significance, "FLIPS", 999),
        (significance, "MORE_FLIPS", 1999),
        (significance, "NUISANCE_RATES", 63),
    ):
        monkeypatch.setattr(module, name, count)
    significance._relabellings.cache_clear()


def share(rules, name: str, sets: int, falls=FALLS) -> float:
    """Of yes, over data sets of all those fall probabilities."""
    rows = [check for p in falls for check in rules(COUNT, p) if check.name == name]
    return float(np.mean([checks.share_of_yes(check, sets // len(falls), seed=2) for check in rows]))


@pytest.mark.parametrize("name", COVERAGE)
def test_intervals_cover_the_truth_and_90_percent_intervals_would_be_seen(name, monkeypatch) -> None:
    low, high = checks.COVERS
    assert low <= share(checks.coverage_checks, name, 700) <= high
    monkeypatch.setattr(statistics, "CONFIDENCE", 0.9)
    assert share(checks.coverage_checks, name, 700) < low


def test_bca_for_a_paired_difference_would_be_seen(monkeypatch) -> None:
    """With few falls among few episodes it estimates a skewness that is hardly there, and covers 90 %."""
    name = "bootstrap, paired difference of errors"
    assert share(checks.coverage_checks, name, 1500, falls=(0.1,)) > 0.92
    monkeypatch.setattr(checks, "difference_interval", statistics.bootstrap_interval)
    assert share(checks.coverage_checks, name, 1500, falls=(0.1,)) < 0.92


BREAKING = {check.name: check for check in checks.breaking_checks(COUNT)}


@pytest.mark.parametrize("name", BREAKING)
def test_breaking_point_intervals_cover_the_truth_whatever_the_shape(name) -> None:
    low, high = BREAKING[name].bounds
    assert low <= checks.share_of_yes(BREAKING[name], 60, seed=2) <= high


def test_a_60_percent_breaking_point_would_be_seen(monkeypatch) -> None:
    name = "breaking point, one half at a level"
    monkeypatch.setattr(breaking_point, "CONFIDENCE", 0.6)
    assert checks.share_of_yes(BREAKING[name], 300, seed=2) < checks.AT_LEAST[0]


def test_a_curve_with_a_shape_would_be_seen(monkeypatch) -> None:
    """Intervals of a logistic fit through the levels, as wide as they come: the flat stretch is not in its family."""
    from scipy.optimize import curve_fit
    from scipy.special import expit

    def logistic(severities, failed):
        def curve(x, middle, steepness):
            return expit(steepness * (x - middle))

        (middle, _), covariance = curve_fit(curve, np.log(severities), failed.mean(axis=1), (4.0, 4.0))
        reach = 1.96 * np.sqrt(covariance[0, 0])
        ends = (float(np.exp(middle - reach)), float(np.exp(middle + reach)))
        return breaking_point.BreakingPoint("crossed", float(np.exp(middle)), ends)

    name = "breaking point, an edge"
    edge = checks.Axis((35.0, 40.0, 65.0, 100.0), checks.AXES[", an edge"].kinds)
    monkeypatch.setitem(checks.AXES, ", an edge", edge)
    monkeypatch.setattr(checks, "breaking_point", logistic)
    (check,) = (check for check in checks.breaking_checks(COUNT) if check.name == name)
    assert checks.share_of_yes(check, 60, seed=2) < checks.AT_LEAST[0]


@pytest.mark.parametrize("name", LEVEL)
def test_tests_hold_their_level(name) -> None:
    low, high = checks.HOLDS_LEVEL
    assert low <= share(checks.null_checks, name, 2000) <= high


def test_exact_mcnemar_is_conservative_by_as_much_as_its_jumps() -> None:
    exact = np.mean([exact_size.attainable_mcnemar(COUNT, exact_size.discordance(p)) for p in FALLS])
    assert exact < 0.035
    assert share(checks.null_checks, "McNemar, exchangeable pairs", 2000) == pytest.approx(exact, abs=0.01)


def test_attainable_size_by_hand() -> None:
    # All of 6 pairs disagree: only 0 and 6 are significant, 2/2⁶. With 5 nothing is.
    assert exact_size.attainable_mcnemar(6, 1.0) == pytest.approx(2 / 2**6)
    assert exact_size.attainable_mcnemar(5, 1.0) == 0.0


def test_barnard_stays_below_its_level() -> None:
    assert 0.02 < share(checks.null_checks, "Barnard, disjoint episodes", 1000, falls=(0.3, 0.5)) <= 0.06


def test_an_unpaired_test_or_interval_of_pairs_would_be_seen() -> None:
    claims, held = [], []
    for seed in range(300):
        a, b = episodes(np.random.default_rng([4, seed]), (0.4, 0.4), COUNT, shared=0.9).error
        claims.append(relabelling_test(a, b) < exact_size.SIGNIFICANT)
        a, b = episodes(np.random.default_rng([4, seed]), (0.5, 0.4), COUNT, shared=0.9).error
        reach = 1.96 * np.sqrt((a.var() + b.var()) / COUNT)
        held.append(abs((a - b).mean() - mean_error(0.5) + mean_error(0.4)) <= reach)
    assert np.mean(claims) < checks.HOLDS_LEVEL[0]
    assert np.mean(held) > checks.COVERS[1]


def test_a_family_without_differences_makes_one_false_claim_in_twenty(made_up_cell) -> None:
    """Three comparisons of errors a battery: corrected, 5 % of the batteries claim anything; by themselves, 14 %."""
    claims, uncorrected = [], []
    for seed in range(200):
        generator = np.random.default_rng([5, seed])
        never = np.zeros(20, bool)
        cells = [
            made_up_cell(policy, never, generator.gamma(4.0, 0.1, 20), scenario)
            for scenario in PUSHES
            for policy in ("trot", "a")
        ]
        family = [c for c in compare(cells) if c.metric == "velocity_error"]
        claims.append(any(c.significant for c in family))
        uncorrected.append(any(c.p_value < 0.05 for c in family))
    assert np.mean(claims) == pytest.approx(0.05, abs=0.03)
    assert np.mean(uncorrected) > 0.1


def test_made_up_errors_have_the_mean_they_claim() -> None:
    for p in FALLS:
        made = episodes(np.random.default_rng(6), (p,), 200_000)
        assert made.fell.mean() == pytest.approx(p, abs=0.004)
        assert made.error.mean() == pytest.approx(mean_error(p), rel=0.01)


def test_the_command_prints_a_row_a_check(capsys) -> None:
    arguments = ["--sets", "20", "--episodes", "16", "--fall-probabilities", "0.4", "--only", "McNemar"]
    assert main(["calibration", *arguments]) == 0
    printed = capsys.readouterr()
    assert [line.split("  ")[0] for line in printed.out.splitlines()[2:-1]] == [
        "McNemar, exchangeable pairs",
        "McNemar, ties by lot",
    ]
    assert len(printed.err.splitlines()) == 2


@pytest.mark.parametrize(
    "arguments",
    [
        ["--only", "nothing", "--episodes", "8"],
        ["--sets", "1"],
        ["--fall-probabilities", "1.2"],
    ],
)
def test_mistakes_are_one_line(arguments, capsys) -> None:
    assert main(["calibration", *arguments]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
