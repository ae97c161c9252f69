"""Faults of runs with and without the hardware profile: the options that reach robots and tables."""

import numpy as np
import pytest

from evaluate.analysis import breaking_points, score, severity_levels
from evaluate.analysis.score import compute_scores
from evaluate.cells import LabelledPolicy, PolicyScenarioResult, load_labelled_policy
from evaluate.hardware import IDEAL, HardwareConfig
from evaluate.rollouts import battery
from evaluate.rollouts.run import RunSettings, run_cells
from quad_env import SIMPLE_QUAD
from quad_env.actuation.hardware import HardwareProfile
from quad_env.actuation.models import Actuator
from quad_env.envs import base
from tests.batches import begun
from tests.evaluate.conftest import outcomes
from tests.planted_faults.harness import Faults, checks_of, fault_tests

MAKERS = "35 N·m/rad and 0.5 N·m·s/rad"


def cells() -> list[PolicyScenarioResult]:
    """Return cells in which every episode without the profile succeeds, and none with it."""
    names = ("flat", "push:2", "push:3", "push:4")
    return [
        outcomes("trot", np.full(8, real), None, battery.resolve_single(name + real * "+hardware"))
        for real in (False, True)
        for name in names
    ]


def check_axes_and_their_breaking_points_are_of_one_world() -> None:
    found = severity_levels.severity_axes(cells())
    assert [axis.name for axis in found] == ["flat", "push", "flat+hardware", "push+hardware"]
    assert [{each.hardware for each in axis.scenarios} for axis in found] == [{False}, {False}, {True}, {True}]
    assert found[3].quantity == found[1].quantity
    points = {point.axis: point.found for point in breaking_points.breaking_points(cells()) if point.of == "falls"}
    assert points == {"push": "never", "push+hardware": "always"}


def check_a_score_is_of_one_world() -> None:
    assert [compute_scores(cells(), "trot", hardware=real)[0].score for real in (False, True)] == [1.0, 0.0]


def check_each_cell_has_its_hardware_and_a_policy_with_the_makers_gains() -> None:
    soft = SIMPLE_QUAD._with(servo_stiffness=np.full(12, 35.0), servo_damping=np.full(12, 0.5))
    both = battery.resolve(("flat", "flat+hardware"), soft)
    with begun() as found, pytest.MonkeyPatch.context() as patch:
        patch.setattr(HardwareConfig, "robot_model", property(lambda _: soft))
        trot = load_labelled_policy("trot", IDEAL, both)
        for scenario in both:
            next(run_cells([trot], [scenario], np.array([7]), RunSettings(1, lambda *_: None, steps=110)))
    assert [batch.env.robot.servo for batch in found] == [SIMPLE_QUAD.servo, MAKERS]
    assert [(batch.sensed, batch.env.simulation.model.actuator_delay[0] > 0) for batch in found] == [
        (False, False),
        (True, True),
    ]


def without_worlds(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(severity_levels, "axis_name", lambda scenario: scenario.axis or scenario.name)


FAULTS: Faults = {
    "grouping by the axis's name alone": (without_worlds, check_axes_and_their_breaking_points_are_of_one_world),
    "a score over both worlds": (
        lambda patch: patch.setattr(score, "is_scored", lambda *_: True),
        check_a_score_is_of_one_world,
    ),
    "profile not passed": (
        lambda patch: patch.setattr(
            base, "hardware_profile", lambda _: HardwareProfile(Actuator(), "truth", "complementary")
        ),
        check_each_cell_has_its_hardware_and_a_policy_with_the_makers_gains,
    ),
    "one policy for both worlds": (
        lambda patch: patch.setattr(LabelledPolicy, "policy_for", lambda self, _: self.policy),
        check_each_cell_has_its_hardware_and_a_policy_with_the_makers_gains,
    ),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
