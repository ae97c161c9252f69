"""Fit of the fall predictor: how much is walked, and that the safety layer reads what is written."""

from policies.safety import fall_prediction as predictor
from train.search import fall_prediction
from train.search.fall_prediction import Options, main


def test_the_layer_reads_the_threshold_that_was_fitted_on_that_many_hours(tmp_path, monkeypatch):
    walked = []
    monkeypatch.setattr(fall_prediction, "undisturbed", lambda _, seeds, *__: walked.append(len(seeds)) or 0.5)
    assert main(Options(hours=0.5, out=tmp_path / "found.json")) == 0
    assert walked == [180]  # of 10 s each
    monkeypatch.setattr(predictor, "THRESHOLD_FILE", tmp_path / "found.json")
    predictor.fitted_threshold.cache_clear()
    try:
        assert predictor.fitted_threshold() == 0.5 + fall_prediction.MARGIN
    finally:
        predictor.fitted_threshold.cache_clear()
