"""Runs with and without the hardware profile: policies, batteries, and options that exclude the profile."""

from pathlib import Path

import numpy as np
import pytest

from evaluate.cells import load_labelled_policy
from evaluate.commands.options import EvaluateOptions
from evaluate.commands.plan import check, select_scenarios
from evaluate.hardware import IDEAL, HardwareConfig
from evaluate.records import manifest as manifests
from evaluate.records.provenance import policy_digest
from evaluate.rollouts import battery
from evaluate.rollouts.run import RunSettings, run_cells
from quad_env.actuation.hardware import hardware_profile
from quad_env.cli.command_line import UsageError
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import AXES
from quad_env.scenarios.scenario import Scenario
from tests.batches import begun

MAKERS = "35 N·m/rad and 0.5 N·m·s/rad"


def scenarios(*names: str, robot: Robot = SIMPLE_QUAD) -> tuple[Scenario, ...]:
    return battery.resolve(names, robot)


@pytest.fixture
def soft(monkeypatch: pytest.MonkeyPatch) -> Robot:
    """Return SimpleQuad's model with built-in servos that are softer than the gains of the project's controllers."""
    robot = SIMPLE_QUAD._with(servo_stiffness=np.full(12, 35.0), servo_damping=np.full(12, 0.5))
    monkeypatch.setattr(HardwareConfig, "robot_model", property(lambda _: robot))
    return robot


def test_our_controllers_command_the_makers_gains_with_the_profile_and_learned_ones_their_own(soft: Robot) -> None:
    flat, real = both = scenarios("flat", "flat+hardware", robot=soft)
    trot, learned = load_labelled_policy("trot", IDEAL, both), load_labelled_policy("residual", IDEAL, both)
    assert (trot.policy_for(flat).robot.servo, trot.policy_for(real).robot.servo) == (SIMPLE_QUAD.servo, MAKERS)
    assert learned.policy_for(flat).robot.servo == learned.policy_for(real).robot.servo == SIMPLE_QUAD.servo
    assert load_labelled_policy("trot", IDEAL, (real,)).policy.robot.servo == MAKERS
    assert len(load_labelled_policy("trot", IDEAL, both, only_on=("flat",)).variants) == 1


def test_the_robots_of_each_cell_have_the_gains_of_their_policy_and_the_profile_or_none(soft: Robot) -> None:
    both = scenarios("flat", "flat+hardware", robot=soft)
    trot = load_labelled_policy("trot", IDEAL, both)
    with begun() as found:
        for each in both:
            next(run_cells([trot], [each], np.array([7]), RunSettings(1, lambda *_: None, steps=120)))
    assert [batch.env.robot.servo for batch in found] == [SIMPLE_QUAD.servo, MAKERS]
    assert [batch.sensed for batch in found] == [False, True]


def test_policies_that_predict_and_safety_layers_know_the_profiles_delays() -> None:
    real = scenarios("flat+hardware")
    assert load_labelled_policy("mpc_wbc", IDEAL, real).policy.joint_predictor.delay_steps == 1  # type: ignore[attr-defined]
    limits = load_labelled_policy("safe:trot", IDEAL, real).policy._limits  # type: ignore[attr-defined]
    assert limits.delay == hardware_profile(SIMPLE_QUAD).actuator.delay


def test_a_digest_covers_both_policies_and_is_as_ever_of_one(soft: Robot) -> None:
    both = scenarios("flat", "flat+hardware", robot=soft)
    numbers = {"seed": 0, "episodes": 1, "steps": 1000, "threads": 1}
    of_both, of_one = (
        manifests.manifest([load_labelled_policy("trot", IDEAL, given)], given, {}, **numbers).policies["trot"]
        for given in (both, both[:1])
    )
    ideal, real = load_labelled_policy("trot", IDEAL, both).variants
    assert of_both == policy_digest(ideal, real) != policy_digest(ideal, ideal)
    assert of_one == policy_digest(ideal) != of_both


def test_every_name_has_its_twin() -> None:
    for name, count in (("push", 1), ("push:3", 1), ("payload=15+slope=10", 1), ("push:all", 8), ("all", 18)):
        plain, real = scenarios(name), scenarios(f"{name}+hardware")
        assert [f"{each.name}+hardware" for each in plain] == [each.name for each in real]
        assert {each.hardware for each in real} == {True}
        assert [(each.axis, each.severity) for each in plain] == [(each.axis, each.severity) for each in real]
        assert len(plain) == count


def test_the_default_battery_has_every_axis_with_the_profile_at_the_level_after_the_nominal_one() -> None:
    found = [each for each in scenarios("default") if each.hardware]
    middle = {each.axis: each.severity for each in found[2:]}
    assert [each.name for each in found[:2]] == ["flat+hardware", "steady+hardware"]
    assert middle == {axis.name: axis.levels[axis.nominal_level] for axis in AXES.values()}


def test_the_option_puts_the_profile_on_every_scenario_once(tmp_path: Path) -> None:
    plan = check(EvaluateOptions(("trot",), scenarios=("push", "flat+hardware"), hardware=True, out=tmp_path))
    assert [each.name for each in plan.scenarios] == ["push+hardware", "flat+hardware"]
    assert all(each.name.endswith("+hardware") for each in select_scenarios(EvaluateOptions(hardware=True)))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            EvaluateOptions(hardware=True, sensors="typical"),
            "--hardware: the profile has its own --actuator, --sensors and",
        ),
        (
            EvaluateOptions(scenarios=("push+hardware", "flat"), actuator="motor"),
            r"--scenarios push\+hardware: the profile",
        ),
    ],
)
def test_hardware_of_ones_own_beside_the_profile_is_refused_in_a_line(options: EvaluateOptions, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        select_scenarios(options)


def test_a_battery_with_hardware_of_ones_own_leaves_the_profile_out() -> None:
    found = select_scenarios(EvaluateOptions(full=True, sensors="typical"))
    assert found == tuple(each for each in scenarios("default") if not each.hardware)
