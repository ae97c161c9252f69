"""The tables of the estimators: their places on a page, their figures, and what cannot be measured."""

from pathlib import Path

import numpy as np
import pytest

from evaluate.rollouts import rollout
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.named import SCENARIOS
from quad_env.seeding import episode_seeds
from quad_env.sensing.error_state import VELOCITY, size
from research.studies import estimation, policies_on_estimates
from tests.batches import begun

DOWN = np.array([[0.0, 0.0, -1.0]])


@pytest.fixture
def brief(monkeypatch) -> None:
    monkeypatch.setattr(rollout, "STEPS", 130)
    monkeypatch.setattr(estimation, "STEPS", 130)


def test_each_table_goes_to_its_own_place(brief, tmp_path: Path, capsys) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "a\n<!-- results -->\nold\n<!-- /results -->\nb\n<!-- success -->\nold\n<!-- /success -->\nc\n",
        encoding="utf-8",
    )
    chosen = {"policies": ("stand",), "scenarios": ("flat",), "episodes": 2, "seed": 5, "page": page}
    with begun() as batches:
        assert estimation.main(estimation.Options(**chosen)) == 0
    assert {batch.seeds for batch in batches} == {tuple(episode_seeds("validation", 5, 2).tolist())}
    assert {getattr(batch.env.scenario.terrain, "seed", 1) for batch in batches} == {1}
    text, printed = page.read_text(encoding="utf-8"), capsys.readouterr().out
    assert "old" not in text
    assert text.index("| walk |") < text.index("<!-- /results -->") < text.index("| scenario |")
    assert all(line in printed for line in text.splitlines() if line.startswith("|"))
    kept = text[: text.index("<!-- success -->")]
    assert estimation.main(estimation.Options(**chosen, tables=("success",))) == 0
    assert page.read_text(encoding="utf-8").startswith(kept)
    assert "| walk |" not in capsys.readouterr().out


def test_successes_are_of_the_same_episodes_with_other_eyes(brief) -> None:
    seeds = episode_seeds("search", 0, 2)
    with begun() as batches:
        found = policies_on_estimates.successes("stand", SCENARIOS["flat"], seeds, "typical", 1)
    assert {each.seeds for each in batches} == {tuple(seeds.tolist())}
    assert [each.sensed for each in batches] == [False, True, True]
    estimators = [type(each.env.estimator).__name__ for each in batches[1:]]
    assert estimators == ["ComplementaryFilter", "KalmanFilter"]
    assert len(found.truth) == 2
    assert list(found.estimates) == ["complementary", "kalman"]


def test_a_loss_is_below_nothing(monkeypatch) -> None:
    """Of 40 episodes 30 succeed on the truth, 20 of these on one estimate and 30 on the other."""
    truth, worse = np.arange(40) < 30, np.arange(40) < 20
    made = policies_on_estimates.Successes(1.0 * truth, {"complementary": 1.0 * worse, "kalman": 1.0 * truth})
    monkeypatch.setattr(policies_on_estimates, "successes", lambda *_: made)
    *_, row = policies_on_estimates.table(["trot"], [SCENARIOS["flat"]], np.arange(40), "typical", 1)
    _, name, policy, on_truth, _, less, _, same, _ = (cell.strip() for cell in row.split("|"))
    assert (name, policy, on_truth[:4]) == ("flat", "`trot`", "75\u00a0%")
    assert less.startswith("−25 [−40,")
    assert same.startswith(("0 [", "+0 ["))


def test_nees_of_an_error_of_one_deviation_is_one() -> None:
    covariance = 0.04 * np.eye(size(SIMPLE_QUAD))[None]
    covariance[:, VELOCITY, VELOCITY] = 0.01 * np.eye(3)
    still = np.zeros((1, 3))
    for turned, moved, expected in (
        (still, [[0.0, 0.1, 0.0]], 1.0),
        ([[0.2, 0.0, 0.0]], still, 1.0),
        ([[0.2, 0.2, 0.0]], [[0.1, 0.1, 0.1]], 5.0),
        ([[0.0, 0.0, 3.0]], still, 0.0),  # a turn about gravity is no error of it
    ):
        found = estimation.normalised(DOWN, np.array(turned), np.array(moved), covariance)
        np.testing.assert_allclose(found, [expected], atol=1e-9)


def test_the_band_holds_95_per_cent_of_means() -> None:
    means = np.random.default_rng(0).chisquare(5, size=(20_000, 32)).mean(axis=1)
    low, high = estimation.band(32)
    assert 0.945 < ((means > low) & (means < high)).mean() < 0.955


def test_the_filter_knows_its_error_on_a_hard_and_on_a_soft_gait(monkeypatch) -> None:
    """NEES of `trot_feedback`, whose feet hit the ground hard and come up with it, is 17 where that is left out."""
    monkeypatch.setattr(estimation, "STEPS", 300)
    for policy in ("trot", "trot_feedback"):
        options = estimation.Options(policy=policy, episodes=4, seeds="search")
        found = estimation.errors(options, estimation.walks(2)["flat"], "kalman")
        assert np.nanmean(found.nees) < 8.0
