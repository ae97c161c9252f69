"""Two runs of a policy: paired, what two policies of one run are told; else two samples."""

import numpy as np
import pytest

from evaluate.analysis.comparison import METRICS, by_episode, compare, compare_samples


def test_two_runs_of_the_same_episodes_are_compared_as_two_policies_of_one_run_are(made_up_cell) -> None:
    """The same difference, interval and p-value, to the bit: a purpose has one interval."""
    generator = np.random.default_rng(0)
    cells = [made_up_cell(name, generator.random(64) < 0.1, generator.gamma(2.0, 0.1, 64)) for name in ("trot", "new")]
    a, b = ({metric: by_episode(cell, metric) for metric in METRICS} for cell in cells)
    policies = {each.metric: each for each in compare(cells)}
    for run in compare_samples(a, b, paired=True):
        expected = policies[run.metric]
        assert (run.ci, run.p_value, run.test) == (expected.ci, expected.p_value, expected.test)
        assert run.difference == pytest.approx(expected.difference)


def test_unpaired_samples_may_differ_in_size() -> None:
    a = {"fall_rate": np.ones(4), "velocity_error": np.ones(4)}
    b = {"fall_rate": np.zeros(9), "velocity_error": np.zeros(9)}
    falls, velocity = compare_samples(a, b, paired=False)
    assert (falls.difference, velocity.difference) == (-1.0, -1.0)
    assert falls.p_value < 0.01
    assert velocity.p_value < 0.01
