"""Predictions are compared with MuJoCo in the right frame and at the right time."""

from pathlib import Path

import numpy as np
import pytest

from policies.mpc.parameters import MpcParameters
from policies.mpc.policy import MpcWbc
from quad_env.seeding import episode_seeds
from research.__main__ import main
from research.studies import prediction
from research.studies.prediction import Walk, errors, walk
from tests.batches import begun

PERIODS = 0.04, 0.01


@pytest.fixture(scope="module")
def walked() -> Walk:
    """By parameters that no search changes: what is tested are the forecasts."""
    seeds = episode_seeds("validation", 3, 2)
    return walk(MpcWbc(MpcParameters()), "flat", seeds, command=(0.5, 0.0, 0.6), steps=220)


def test_a_prediction_errs_less_than_the_assumption_that_nothing_changes(walked: Walk) -> None:
    for steps in (1, 5):
        height, horizontal, upward, tilt = errors(walked, steps, *PERIODS)
        same = errors(walked, steps, *PERIODS, still=True)
        assert (horizontal, tilt) < (same[1], same[3])
        assert height < 10.0
        assert horizontal < 0.2
        assert upward < 0.15
        assert tilt < 2.0


@pytest.mark.parametrize("fault", ["a step late", "not turned"])
def test_forecasts_of_another_moment_or_in_another_frame_err_more(
    walked: Walk, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = errors(walked, 1, *PERIODS)
    if fault == "not turned":
        monkeypatch.setattr(prediction, "turned_back", lambda rotation: np.broadcast_to(np.eye(3), rotation.shape))
        assert errors(walked, 1, *PERIODS)[1] > 2.0 * right[1]
    else:
        late = Walk(walked.measured, *(np.roll(each, 2, axis=0) for each in walked[1:6]), walked.fall_step)
        wrong = errors(late, 1, *PERIODS)
        assert wrong[3] > right[3]
        assert wrong[1] > right[1]


def test_the_command_draws_a_stride_and_writes_its_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prediction, "GROUNDS", ("rough",))
    monkeypatch.setattr(prediction.walk, "__defaults__", (None, 260))
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- prediction -->\n<!-- /prediction -->\nafter\n", encoding="utf-8")
    words = ["--episodes", "1", "--start", "100", "--out", str(tmp_path / "p.png"), "--page", str(page)]
    with begun() as batches:
        assert main(["prediction", *words, "--seed", "5"]) == 0
    assert {batch.seeds for batch in batches} == {tuple(episode_seeds("validation", 5, 1).tolist())}
    assert batches[0].env.scenario.terrain.seed == 1
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    text = page.read_text(encoding="utf-8")
    assert "| rough | 0.40 |" in text
    assert text.startswith("before")
    assert text.endswith("after\n")
