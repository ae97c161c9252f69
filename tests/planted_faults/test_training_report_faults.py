"""Faults in the reports of trainings: validations of a curve, runs of its band, and remaining time."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluate.analysis import learning_curves
from evaluate.analysis.learning_curves import SeedBand, group_by_seed, read_curve
from research.training.curves import draw_bands
from tests.planted_faults.harness import Faults, checks_of, fault_tests
from tests.research.test_curves import folder_of_run
from train.config import PpoConfig, TrainConfig
from train.sb3 import progress
from train.sb3.progress import ProgressEstimator


def check_a_curve_is_that_of_its_run_and_its_band_goes_from_seed_to_seed() -> None:
    with tempfile.TemporaryDirectory() as folder:
        rates = {"a": (0.1, 0.5), "b": (0.3, 0.9)}
        runs = [
            folder_of_run(Path(folder) / name, [(1, first, 1.0), (2, last, 1.0)], seed=seed)
            for seed, (name, (first, last)) in enumerate(rates.items())
        ]
        (axes, _) = draw_bands(group_by_seed([read_curve(run) for run in runs])).axes
    of_a, of_b, mean = (np.asarray(line.get_ydata()) for line in axes.get_lines())
    assert [of_a.tolist(), of_b.tolist()] == [pytest.approx([10.0, 50.0]), pytest.approx([30.0, 90.0])]
    assert mean.tolist() == pytest.approx([20.0, 70.0])
    band = axes.collections[0].get_paths()[0].vertices
    for step, low, high in ((1, 10.0, 30.0), (2, 50.0, 90.0)):
        heights = band[band[:, 0] == step, 1]
        assert (heights.min(), heights.max()) == (pytest.approx(low), pytest.approx(high))


def check_the_time_left_has_the_validations_in_it() -> None:
    now = 0.0
    config = TrainConfig(steps=400, ppo=PpoConfig(envs=10, rollout_steps=10))
    pace = ProgressEstimator(config, clock=lambda: now)
    now = 1.0  # for 100 steps
    with pace.validation(100):
        now = 21.0
    assert pace.remaining_time(100) == pytest.approx(3 * 1.0 + 20.0)


def over_one_run(self: SeedBand) -> Any:
    """Return a band over the validations of the first run only."""
    figures = self.runs[0].figures
    mean, low, high = (of(figures, axis=1, keepdims=True) for of in (np.mean, np.min, np.max))
    return tuple(np.broadcast_to(each, figures.shape) for each in (mean, low, high))


FAULTS: Faults = {
    "a curve from another run's file": (
        lambda patch: patch.setattr(learning_curves, "VALIDATIONS_FILE", "../a/validations.json"),
        check_a_curve_is_that_of_its_run_and_its_band_goes_from_seed_to_seed,
    ),
    "a band over one run's validations": (
        lambda patch: patch.setattr(SeedBand, "over_seeds", over_one_run),
        check_a_curve_is_that_of_its_run_and_its_band_goes_from_seed_to_seed,
    ),
    "time left without validation": (
        lambda patch: patch.setattr(ProgressEstimator, "_validation_time", lambda *_: 0.0),
        check_the_time_left_has_the_validations_in_it,
    ),
    "speed with the time of validations": (
        lambda patch: patch.setattr(progress, "sum", lambda _: 0.0, raising=False),
        check_the_time_left_has_the_validations_in_it,
    ),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
