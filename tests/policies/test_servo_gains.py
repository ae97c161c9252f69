"""Servo gains belong to the policy that commands them, and its episodes use these gains."""

import json
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import policies
import quad_env
from evaluate.hardware import HardwareConfig
from evaluate.rollouts import rollout
from policies.parameters import scaled_parameters
from policies.poses import Stand
from policies.trot.open_loop import TrotParameters, searched_parameters
from quad_env import SIMPLE_QUAD
from quad_env.robots.registry import MAKER_SERVOS, ROBOTS
from tests.quad_env.robots.alike import alike
from tests.robot_models import NEEDS_MODELS

GAINS = "35 N·m/rad and 0.5 N·m·s/rad"


class Soft(Stand):
    """The home pose on servos of the robot's default stiffness."""

    stiff_servos = False


@pytest.fixture(scope="module")
def soft(tmp_path_factory: pytest.TempPathFactory) -> quad_env.Robot:
    """Return SimpleQuad's model with built-in servos that are softer than the gains of the project's controllers."""
    robot = quad_env.Robot.from_mjcf(SIMPLE_QUAD.mjcf, home_pose=SIMPLE_QUAD.home_pose)
    return robot._with(servo_stiffness=np.full(12, 35.0), servo_damping=np.full(12, 0.5))


def test_a_controller_that_needs_stiff_servos_commands_them_unless_the_gains_are_given(soft: quad_env.Robot) -> None:
    assert Soft(robot=soft).robot.servo == soft.servo == GAINS
    for name in ("mpc_wbc", "trot_feedback"):  # the targets contain the torques
        assert policies.make(name, robot=soft).robot.servo == GAINS, name
    for name in ("stand", "trot", "trot_integral", "behaviour", "safe:trot"):
        assert policies.make(name, robot=soft, servo="own").robot.servo == SIMPLE_QUAD.servo, name
        assert policies.make(name, robot=soft.with_servo(35.0, 0.5)).robot.servo == GAINS, name


def test_the_reference_trot_has_its_own_gains_unless_they_are_given(soft: quad_env.Robot) -> None:
    make = partial(policies.make, "trot_reference", servo="own")
    assert make().robot.servo == make(robot=soft).robot.servo == "150 N·m/rad and 7.5 N·m·s/rad"
    assert make(robot=SIMPLE_QUAD.with_servo(90.0, 2.0)).robot.servo == "90 N·m/rad and 2 N·m·s/rad"


def test_a_robot_whose_gains_are_given_has_the_parameters_that_were_searched_for_soft_servos(tmp_path: Path) -> None:
    robot = alike(tmp_path)
    own = tmp_path / "alike" / "soft_servos"
    own.mkdir(parents=True)
    found = replace(TrotParameters(), frequency=3.0625)
    (own / "trot.json").write_text(json.dumps(asdict(found)), encoding="utf-8")
    soft = robot.with_servo(5.0, 0.1)
    assert policies.make("trot", robot=soft).parameters == found
    assert policies.make("trot", robot=robot).parameters == scaled_parameters(searched_parameters(), robot)


def test_episodes_run_with_the_gains_of_the_policy(soft: quad_env.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(HardwareConfig, "robot_model", property(lambda _: soft))
    for policy, stiffness in ((Soft(robot=soft), 35.0), (Stand(robot=soft), 300.0)):
        steps = []
        rollout.roll_out(policy, "flat", np.array([3]), steps.append, steps=2)
        np.testing.assert_array_equal(steps[0].env.simulation.model.actuator_gainprm[:, 0], stiffness)
        assert steps[0].env.robot.servo == policy.robot.servo


def test_an_environment_with_other_gains_is_refused_in_a_line(soft: quad_env.Robot) -> None:
    with pytest.raises(ValueError, match="commands servos of 300 N·m/rad and 10 N·m·s/rad, but"):
        Stand(robot=soft).check_compatible(soft, 0.01)
    rising = np.linspace(100.0, 320.0, 12)
    policy = Soft(robot=soft.with_servo(rising, 5.0))
    with pytest.raises(ValueError, match="but the environment's have"):  # the smallest and largest gains are equal
        policy.check_compatible(soft.with_servo(rising[::-1], 5.0), 0.01)


def test_a_bundle_has_the_gains_that_it_was_trained_with(soft: quad_env.Robot, tmp_path: Path) -> None:
    residual = policies.load(Path("models/residual"))
    assert residual.robot.servo == SIMPLE_QUAD.servo  # a bundle of a version without servo gains
    trot, inputs = policies.Trot(robot=SIMPLE_QUAD.with_servo(250.0, np.arange(1.0, 13.0))), residual.features.inputs
    mine = policies.ResidualPolicy(trot, residual.network, residual.authority, "mine", inputs)
    policies.bundle.save(tmp_path, mine, {}, "revision")
    found = policies.load(tmp_path, robot=SIMPLE_QUAD, servo="own")
    np.testing.assert_array_equal(found.robot.servo_stiffness, np.full(12, 250.0))
    np.testing.assert_array_equal(found.base.robot.servo_damping, np.arange(1.0, 13.0))
    file = tmp_path / "policy.json"
    description = json.loads(file.read_text(encoding="utf-8"))
    for wrong in ([250.0], [250.0, -1.0], [[250.0] * 11, 1.0], "stiff"):
        file.write_text(json.dumps(description | {"servo": wrong}), encoding="utf-8")
        with pytest.raises(policies.PolicyError, match="servo must be stiffness and damping of 12 joints"):
            policies.load(tmp_path)


def test_the_option_servo_is_for_every_controller_of_ours() -> None:
    hardware = HardwareConfig(servo="35/0.5")
    assert hardware.policy("trot").robot.servo == GAINS
    with pytest.raises(ValueError, match=r"such as 35/0\.5"):
        _ = HardwareConfig(servo="35").robot_model


@NEEDS_MODELS
def test_named_robots_have_the_gains_of_their_makers_and_our_controllers_stiffer_ones() -> None:
    for name, stiffness, damping in (("go1", 35.0, 0.5), ("go2", 25.0, 0.5), ("spot", 286.0, 2.04)):
        robot = ROBOTS[name]
        assert (robot.servo_stiffness[2], robot.servo_damping[2]) == (stiffness, damping), name
        assert policies.make("trot", robot=name, servo="own").robot.servo_stiffness[2] > 3.0 * stiffness, name
        model = robot.model
        np.testing.assert_array_equal(model.actuator_gainprm[:, 0], robot.servo_stiffness)
        np.testing.assert_array_equal(model.actuator_biasprm[:, 2], -robot.servo_damping)
    residual, reference = (policies.make(each, robot="go1", servo="own") for each in ("residual", "trot_reference"))
    assert residual.robot.servo == reference.robot.servo
    assert set(MAKER_SERVOS) | {"simple_quad"} == set(ROBOTS)
