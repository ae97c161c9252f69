"""One name, one robot: the loop of the README gives the evaluator's bits, or is refused with the remedy."""

from contextlib import closing
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import policies
import quad_env
from policies import PolicyError
from tests.policies.readme_loop import evaluated, loop_by_the_remedy
from tests.quad_env.robots.alike import alike
from tests.robot_models import NEEDS_MODELS

NAMED = ("go1", "go2")
STIFF = {"behaviour", "bound", "crouch", "document", "document_repaired", "gaits", "pace", "pronk", "stand", "trot"}
STIFF |= {"trot_integral", "walk", "safe:trot"}
NAMES = sorted({*policies.names(), *policies.TRAINED})
OWN = {"residual", "trot_reference"}
"""Policies with their own servo gains on go1 and go2."""


def shipped(robot: str) -> list[str]:
    """Return the policies that are available for a robot, and one of them with the safety layer."""
    return ["safe:trot", *policies.names(robot)]


def expect_the_evaluators_bits(name: str, robot: str) -> str:
    observation, remedy = loop_by_the_remedy(name, robot)
    np.testing.assert_array_equal(observation, evaluated(name, robot))
    return remedy


@pytest.mark.parametrize("name", shipped("simple_quad"))
def test_the_loop_on_simple_quad_gives_the_evaluators_bits(name: str) -> None:
    assert expect_the_evaluators_bits(name, "simple_quad") == ("own" if name == "trot_reference" else "")


@NEEDS_MODELS
@pytest.mark.parametrize(("robot", "name"), [*product(NAMED, ["safe:trot", *NAMES])])
def test_the_loop_on_other_robots_gives_the_evaluators_bits_or_names_the_remedy(robot: str, name: str) -> None:
    if name not in shipped(robot):
        pytest.skip("no such bundle")
    expected = "stiff" if name in STIFF else "own" if name in OWN else ""
    assert expect_the_evaluators_bits(name, robot) == expected


@NEEDS_MODELS
@pytest.mark.parametrize("robot", ["go2", quad_env.ROBOTS.get("go2")], ids=["name", "object"])
def test_a_policy_for_other_gains_than_its_robots_is_refused_in_a_line(robot: Any) -> None:
    says = r'^trot commands servos of 228.* N·m/rad and 6.* N·m·s/rad, but go2 has 25 .*; make .* with servo="stiff"$'
    for make in (policies.make, policies.resolve):
        with pytest.raises(PolicyError, match=says):
            make("trot", robot=robot)
    with pytest.raises(PolicyError, match=r'^safe:trot commands .*servo="stiff"$'):
        policies.make("safe:trot", robot=robot)
    says = r'^residual commands servos of 114.*, but go2 has 25.*; .*servo="own".*robot=policy\.robot$'
    for servo in (None, "stiff", (25.0, 0.5)):
        with pytest.raises(PolicyError, match=says.replace("25", "228") if servo == "stiff" else says):
            policies.make("residual", robot=robot, servo=servo)
    with pytest.raises(PolicyError, match=r'^.*residual.* commands servos of 114.*servo="own"'):
        policies.load("models/go2/residual", robot=robot)
    assert policies.load("models/go2/residual").robot == policies.make("residual", robot=robot, servo="own").robot


@NEEDS_MODELS
@pytest.mark.parametrize("servo", [None, "stiff", (90.0, 2.0), (90.0, np.arange(1.0, 13.0))], ids=str)
@pytest.mark.parametrize("robot", ["go1", "simple_quad"])
@pytest.mark.parametrize("name", ["mpc_wbc", "trot"])
def test_the_same_words_are_the_same_gains(name: str, robot: str, servo: Any) -> None:
    if (name, robot, servo) == ("trot", "go1", None):
        pytest.skip("refused")
    env = gym.make(quad_env.ENV_ID, robot=robot, servo=servo)
    policy = policies.make(name, robot=robot, servo=servo)
    np.testing.assert_array_equal(env.unwrapped.model.actuator_gainprm[:, 0], policy.robot.servo_stiffness)
    np.testing.assert_array_equal(-env.unwrapped.model.actuator_biasprm[:, 2], policy.robot.servo_damping)
    batch = gym.make_vec(quad_env.ENV_ID, num_envs=2, robot=robot, servo=servo)
    policy.check_compatible(batch.unwrapped.robot, batch.unwrapped.dt)
    policies.make(name, robot=env.unwrapped.robot).check_compatible(env.unwrapped.robot, env.unwrapped.dt)


@NEEDS_MODELS
def test_stiff_servos_are_those_of_a_policy_with_gains_of_its_own() -> None:
    own, stiff = (policies.make("trot", robot="go1", servo=servo) for servo in ("own", "stiff"))
    assert own.robot.servo == stiff.robot.servo != quad_env.ROBOTS["go1"].servo
    assert own.parameters == stiff.parameters
    given = policies.make("trot", robot="go1", servo=(35.0, 0.5))
    assert given.parameters != stiff.parameters, "those that were searched for soft servos"


@pytest.mark.parametrize("servo", ["soft", 300.0, (300.0, 0.0), np.ones((2, 3))], ids=str)
def test_what_is_no_gains_is_refused_in_a_line(servo: Any) -> None:
    for make in (policies.make, policies.resolve):
        with pytest.raises(PolicyError, match=r"servo (gains are|is a pair).*") as error:
            make("trot", servo=servo)
        assert "\n" not in str(error.value)


def test_a_robot_of_a_file_has_one_set_of_gains(tmp_path: Any) -> None:
    robot = alike(tmp_path)
    for name in ("trot", "mpc_wbc", "stand"):
        np.testing.assert_array_equal(policies.make(name, robot=robot).robot.servo_stiffness, robot.servo_stiffness)
    with pytest.raises(PolicyError, match=r'^trot_reference commands .*servo="own"'):
        policies.make("trot_reference", robot=robot)


@NEEDS_MODELS
def test_a_policy_of_a_python_file_is_evaluated_on_the_gains_that_it_commands(tmp_path: Any) -> None:
    file = tmp_path / "mine.py"
    file.write_text("import policies\n\nclass Mine(policies.Trot):\n    pass\n", encoding="utf-8")
    name = f"{file}:Mine"
    np.testing.assert_array_equal(evaluated(name, "go2"), evaluated("trot", "go2"))
    with pytest.raises(PolicyError, match=r'mine\.py:Mine commands servos of 228.*servo="stiff"'):
        policies.resolve(name, robot="go2")
    for servo, gains in (("own", "228"), ("stiff", "228"), ((30.0, 1.0), "30")):
        with closing(policies.resolve(name, robot="go2", servo=servo)) as policy:
            assert policy.robot.servo.startswith(f"{gains} N·m/rad"), servo
