"""Tables of the estimators: their places on a page, their numbers, and missing values."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from evaluate.rollouts import rollout
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from quad_env.sensing.kalman_models import VELOCITY, error_dim
from research.studies import estimation
from tests.batches import begun
from tests.robot_models import NEEDS_MODELS

DOWN = np.array([[0.0, 0.0, -1.0]])


@pytest.fixture
def brief(monkeypatch) -> None:
    monkeypatch.setattr(rollout, "STEPS", 130)
    monkeypatch.setattr(estimation, "STEPS", 130)


def test_the_table_goes_to_its_place(brief, tmp_path: Path, capsys) -> None:
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- results -->\nold\n<!-- /results -->\nb\n", encoding="utf-8")
    with begun() as batches:
        assert estimation.main(estimation.EstimationOptions(policy="stand", episodes=2, seed=5, page=page)) == 0
    assert {batch.seeds for batch in batches} == {tuple(episode_seeds("validation", 5, 2).tolist())}
    assert {getattr(batch.env.scenario.terrain, "seed", 1) for batch in batches} == {1}
    text, printed = page.read_text(encoding="utf-8"), capsys.readouterr().out
    assert "old" not in text
    assert text.index("| walk |") < text.index("<!-- /results -->")
    assert all(line in printed for line in text.splitlines() if line.startswith("|"))


@NEEDS_MODELS
def test_errors_after_pushes_go_to_their_own_place(monkeypatch, brief, tmp_path: Path) -> None:
    monkeypatch.setattr(estimation, "ROBOTS", ("go1",))
    page = tmp_path / "page.md"
    page.write_text(
        "<!-- pushes -->\nold\n<!-- /pushes -->\n<!-- results -->\nkept\n<!-- /results -->\n", encoding="utf-8"
    )
    options = estimation.EstimationOptions(table="pushes", policy="stand", episodes=2, seeds="search", page=page)
    with begun() as batches, warnings.catch_warnings(action="ignore"):  # too few steps for a push
        assert estimation.main(options) == 0
    assert [batch.env.estimator.__class__.__name__ for batch in batches] == ["ComplementaryFilter", "KalmanFilter"]
    assert {batch.env.robot.name for batch in batches} == {"go1"}
    text = page.read_text(encoding="utf-8")
    assert "old" not in text
    assert "kept" in text
    assert text.index("| go1 | kalman |") < text.index("<!-- /pushes -->")


def test_an_error_counts_in_the_window_after_its_push() -> None:
    """The error is 0.3 m/s from 0.3 to 0.5 s after the second push of the second robot, one of four pushes."""
    pushes = np.array([[150, 600], [300, 700]])
    errors = np.zeros((900, 2, 3))
    errors[700 - estimation.SETTLING :, 1, 2][30:50] = 0.3
    np.testing.assert_allclose(estimation.error_after_push(errors, pushes), [0.0, 0.0, 0.0, 0.0, 0.15, 0.0, 0.0])


def test_nees_of_an_error_of_one_deviation_is_one() -> None:
    covariance = 0.04 * np.eye(error_dim(SIMPLE_QUAD))[None]
    covariance[:, VELOCITY, VELOCITY] = 0.01 * np.eye(3)
    still = np.zeros((1, 3))
    for turned, moved, expected in (
        (still, [[0.0, 0.1, 0.0]], 1.0),
        ([[0.2, 0.0, 0.0]], still, 1.0),
        ([[0.2, 0.2, 0.0]], [[0.1, 0.1, 0.1]], 5.0),
        ([[0.0, 0.0, 3.0]], still, 0.0),  # a rotation about gravity is no error of gravity
    ):
        found = estimation.normalized_error_squared(DOWN, np.array(turned), np.array(moved), covariance)
        np.testing.assert_allclose(found, [expected], atol=1e-9)


def test_the_band_holds_95_per_cent_of_means() -> None:
    means = np.random.default_rng(0).chisquare(5, size=(20_000, 32)).mean(axis=1)
    low, high = estimation.nees_bounds(32)
    assert 0.945 < ((means > low) & (means < high)).mean() < 0.955


def test_the_filter_knows_its_error_on_a_hard_and_on_a_soft_gait(monkeypatch) -> None:
    """The NEES of `trot_feedback`, whose feet hit the ground hard and rebound, is 17 without the term for impacts."""
    monkeypatch.setattr(estimation, "STEPS", 300)
    for policy in ("trot", "trot_feedback"):
        options = estimation.EstimationOptions(policy=policy, episodes=4, seeds="search")
        found = estimation.estimate_errors(options, estimation.walk_scenarios(2)["flat"], "kalman")
        assert np.nanmean(found.nees) < 8.0
