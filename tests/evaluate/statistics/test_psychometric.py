"""The curve's fit against a general optimiser, and its behaviour where there is little to fit."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import beta, binom, norm

from evaluate.statistics.psychometric import fall_probability, fit, median_hardness

LEVELS = np.linspace(-1.0, 1.0, 6)
EPISODES = 128


def curve(m: float, steepness: float, floor: float = 0.0, lapse: float = 0.0) -> np.ndarray:
    return np.array([[m, np.log(steepness), floor, lapse]])


def minus_log_posterior(parameters, hardness, rates) -> float:
    """As the module's docstring states it, by scipy's distributions."""
    m, log_steepness, floor, lapse = parameters
    probability = floor + (1 - floor - lapse) * expit(np.exp(log_steepness) * (hardness - m))
    likelihood = binom.logpmf(np.round(rates * EPISODES), EPISODES, probability.clip(1e-12, 1 - 1e-12)).sum()
    priors = (
        norm.logpdf(m, 0, 2) + norm.logpdf(log_steepness, np.log(5), 1.5) + beta.logpdf([floor, lapse], 1, 10).sum()
    )
    return -likelihood - priors


@pytest.mark.parametrize(
    "true",
    [curve(0.0, 3.0), curve(-0.3, 8.0, 0.1), curve(0.3, 2.0, 0.0, 0.15), curve(0.1, 6.0, 0.25), curve(0.05, 60.0)],
)
def test_fit_is_the_highest_posterior(true) -> None:
    rates = np.random.default_rng(1).binomial(EPISODES, fall_probability(true, LEVELS)) / EPISODES
    found = fit(LEVELS, rates, EPISODES)[0]
    starts = [(m, np.log(s), 0.02, 0.02) for m in (-0.5, 0.0, 0.5) for s in (2.0, 5.0, 20.0)]
    bounds = [(-5.0, 5.0), (-5.0, 8.0), (0.0, 0.4), (0.0, 0.4)]
    best = min(
        minimize(minus_log_posterior, start, (LEVELS, rates[0]), bounds=bounds, tol=1e-12).fun for start in starts
    )
    assert minus_log_posterior(found, LEVELS, rates[0]) == pytest.approx(best, abs=1e-3)


def test_many_fits_at_once_are_those_of_each_alone() -> None:
    rates = np.random.default_rng(2).binomial(EPISODES, fall_probability(curve(0.0, 4.0), LEVELS), (5, 6)) / EPISODES
    together = median_hardness(fit(LEVELS, rates, EPISODES))
    alone = [median_hardness(fit(LEVELS, row[None], EPISODES))[0] for row in rates]
    assert together == pytest.approx(alone, abs=1e-6)


@pytest.mark.parametrize(("floor", "lapse"), [(0.0, 0.0), (0.2, 0.0), (0.1, 0.3)])
def test_half_of_the_episodes_fall_at_the_middle(floor, lapse) -> None:
    curves = curve(0.2, 5.0, floor, lapse)
    assert fall_probability(curves, median_hardness(curves))[0, 0] == pytest.approx(0.5)


def test_middle_of_exact_rates_is_the_curves() -> None:
    true = curve(0.15, 5.0, 0.1)
    found = fit(LEVELS, fall_probability(true, LEVELS), 100_000)
    assert median_hardness(found) == pytest.approx(median_hardness(true), abs=2e-3)


def test_complete_separation_gives_the_middle_of_the_gap() -> None:
    rates = np.array([[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]])
    found = fit(LEVELS, rates, EPISODES)
    assert np.isfinite(found).all()
    assert median_hardness(found) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("rate", [0.0, 1.0, 0.3])
def test_level_rates_have_a_finite_curve(rate) -> None:
    assert np.isfinite(median_hardness(fit(LEVELS, np.full((1, 6), rate), EPISODES))).all()


def test_a_level_without_disturbance_tells_of_the_floor_alone() -> None:
    hardness = np.concatenate([[-np.inf], LEVELS])
    rates = fall_probability(curve(0.2, 5.0, 0.15), hardness)
    assert rates[0, 0] == pytest.approx(0.15)
    assert fit(hardness, rates, 100_000)[0, 2] == pytest.approx(0.15, abs=0.005)
