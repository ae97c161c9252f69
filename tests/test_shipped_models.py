"""The trained policies that ship with the project are there and follow commands better than what they correct."""

import numpy as np
import pytest

import policies
from evaluate.measures.metrics import Measures, measure
from evaluate.rollouts import rollout
from quad_env.seeding import episode_seeds
from train.scenarios import practice

EPISODES = 24
MOST = {"flat": (0.75, 0.6), "push": (0.85, 0.65), "rough": (0.65, 0.6)}
"""Velocity and yaw-rate error of the residual, as a share of the trot's: what it is shipped for."""


@pytest.fixture(scope="module", params=MOST)
def measured(request: pytest.FixtureRequest) -> tuple[str, Measures, Measures]:
    """The trot and the shipped residual in the same episodes, on ground and seeds that no training has seen."""
    seeds, scenario = episode_seeds("search", 3, EPISODES), practice(request.param, "search")
    trot, residual = (measure(rollout.run(policies.make(name), scenario, seeds)) for name in ("trot", "residual"))
    return request.param, trot, residual


def test_the_shipped_residual_falls_and_errs_less_than_the_trot(measured: tuple[str, Measures, Measures]) -> None:
    scenario, trot, residual = measured
    np.testing.assert_array_equal(residual.commands, trot.commands)  # paired
    assert not residual.fell.any()
    for error, most in zip(("velocity_error", "yaw_rate_error"), MOST[scenario], strict=True):
        assert getattr(residual, error).mean() <= most * getattr(trot, error).mean(), error


def test_the_shipped_residual_is_over_the_shipped_trot() -> None:
    """A bundle trained before the last search would be judged beside another gait than its own."""
    residual = policies.make("residual")
    assert isinstance(residual, policies.ResidualPolicy)
    assert isinstance(residual.base, policies.Trot)
    assert residual.base.parameters == policies.make("trot").parameters
