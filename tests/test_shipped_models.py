"""The trained policies that ship with the project are there and better than what they correct."""

import numpy as np
import pytest

import policies
from evaluate.measures.metrics import Measures, measure
from evaluate.rollouts import rollout
from quad_env.seeding import episode_seeds

EPISODES = 32


@pytest.fixture(scope="module")
def measured() -> dict[str, Measures]:
    """The trot and the shipped residual on the same flat episodes, which no training has seen."""
    seeds = episode_seeds("search", 3, EPISODES)
    return {name: measure(rollout.run(policies.make(name), "flat", seeds)) for name in ("trot", "residual")}


def test_the_shipped_residual_does_not_fall(measured: dict[str, Measures]) -> None:
    assert not measured["residual"].fell.any()


@pytest.mark.parametrize("error", ["velocity_error", "yaw_rate_error"])
def test_the_shipped_residual_follows_commands_better_than_the_trot(measured: dict[str, Measures], error: str) -> None:
    np.testing.assert_array_equal(measured["residual"].commands, measured["trot"].commands)  # paired
    assert getattr(measured["residual"], error).mean() < getattr(measured["trot"], error).mean()


def test_the_shipped_residual_is_over_the_shipped_trot() -> None:
    """A bundle trained before the last search would be judged beside another gait than its own."""
    residual = policies.make("residual")
    assert isinstance(residual, policies.ResidualPolicy)
    assert isinstance(residual.base, policies.Trot)
    assert residual.base.parameters == policies.make("trot").parameters
