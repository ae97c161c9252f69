"""Prediction of delayed joint readings."""

import numpy as np
import pytest

import policies
from evaluate.hardware import HardwareConfig
from policies.mpc.joint_predictor import JointPredictor
from quad_env import OBSERVATION
from tests.policies.readings import reading

PERIOD = 0.01
ANGLES, SPEEDS = OBSERVATION["joint_position"], OBSERVATION["joint_velocity"]


@pytest.mark.parametrize("late", [1, 3])
def test_joints_that_do_as_planned_are_known_as_they_are_now(late: int) -> None:
    """The prediction of joints that start at rest with a constant acceleration of 20 rad/s² is ½ a t² and a t."""
    prediction, acceleration = JointPredictor(late, PERIOD), 20.0
    for step in range(30):
        seen = max(step - late, 0) * PERIOD
        found = prediction.predict(reading(1, joint_position=0.5 * acceleration * seen**2))
        if step >= late:
            time = step * PERIOD
            np.testing.assert_allclose(found[0, ANGLES], 0.5 * acceleration * time**2, rtol=0.02, atol=2e-4)
            np.testing.assert_allclose(found[0, SPEEDS], acceleration * time, rtol=0.02, atol=0.02)
        prediction.record(np.full((1, 12), acceleration))


def test_what_no_plan_explains_is_learnt_from_the_readings() -> None:
    """A joint rotates at 3 rad/s without a planned motion."""
    prediction = JointPredictor(1, PERIOD)
    for step in range(40):
        found = prediction.predict(reading(1, joint_position=3.0 * max(step - 1, 0) * PERIOD))
        prediction.record(np.zeros((1, 12)))
    np.testing.assert_allclose(found[0, SPEEDS], 3.0, rtol=1e-3)
    np.testing.assert_allclose(found[0, ANGLES], 3.0 * 39 * PERIOD, rtol=1e-3)


def test_the_evaluator_tells_the_controller_what_its_encoders_take() -> None:
    """The policy gets the encoder delay of typical sensors in one control step, and none for true or ideal sensors."""
    found = [
        HardwareConfig(sensors=name).policy("mpc_wbc").joint_predictor.delay_steps
        for name in ("truth", "ideal", "typical")
    ]
    assert found == [0, 0, 1]
    made = policies.make("safe:mpc_wbc", actuator="motor", sensors="typical").policy
    assert made.joint_predictor.delay_steps == made.observer.delays[0] == 1
    assert len(made.observer.servos.target_weights) == 3
