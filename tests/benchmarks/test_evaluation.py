"""Benchmark of an evaluation: the bare physics repeats its control steps, and the parts add up to the whole."""

import time

import numpy as np
import pytest

from benchmarks.support.evaluation_parts import PARTS, BareControlSteps, TimedEvaluation
from evaluate.rollouts import run

STEPS = 150


@pytest.fixture(scope="module")
def evaluation() -> TimedEvaluation:
    return TimedEvaluation(("stand",), "flat", on_hardware_profile=False, episodes=3, steps=STEPS)


def test_the_bare_physics_repeats_the_control_steps_of_the_evaluation(evaluation: TimedEvaluation) -> None:
    evaluation.run()
    calls = evaluation.calls
    assert evaluation.robot_steps == 3 * len(calls) == 3 * STEPS
    bare = BareControlSteps(evaluation)
    for number in (0, 70, STEPS - 2):
        evaluation.calls = [calls[number]]
        assert bare.run() > 0.0
        np.testing.assert_allclose(bare.qpos, calls[number + 1].qpos, atol=1e-3)
        assert np.abs(bare.qpos - calls[number].qpos).max() > 0.0
    evaluation.calls = calls


def test_the_parts_add_up_to_the_whole(evaluation: TimedEvaluation) -> None:
    begin = time.process_time()
    parts = evaluation.run()
    whole = time.process_time() - begin
    assert tuple(parts) == PARTS
    assert all(seconds > 0.0 for seconds in parts.values())
    recorded = evaluation.stopwatch.seconds["calls"]
    assert sum(parts.values()) + recorded == pytest.approx(whole, rel=0.1)


def test_timing_changes_no_result_and_leaves_nothing_behind(evaluation: TimedEvaluation) -> None:
    true_measure = run.measure_cell
    evaluation.run()
    assert run.measure_cell is true_measure
    first, second = evaluation.evaluate()[0], evaluation.evaluate()[0]
    np.testing.assert_array_equal(first.measures.velocity_error, second.measures.velocity_error)
