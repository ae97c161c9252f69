"""Faults in servo gains: an environment, a policy or a training on other gains than its words say."""

import numpy as np

from policies import registry
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot, parse_servo_gains
from tests.planted_faults.harness import Faults, checks_of, fault_tests
from tests.policies.readme_loop import evaluated, loop_by_the_remedy
from tests.robot_models import NEEDS_MODELS
from train import training_robots
from train.commands.run import parse

pytestmark = NEEDS_MODELS


def check_the_loop_of_a_scripted_policy_gives_the_evaluators_bits() -> None:
    np.testing.assert_array_equal(loop_by_the_remedy("trot", "go2")[0], evaluated("trot", "go2"))


def check_the_loop_of_a_trained_policy_gives_the_evaluators_bits() -> None:
    np.testing.assert_array_equal(loop_by_the_remedy("residual", "go2")[0], evaluated("residual", "go2"))


def check_end_to_end_trains_on_the_makers_gains() -> None:
    config = parse(
        ["--policy", "end-to-end", "--robot", "go1", "--base", "stand", "--ppo.envs", "2", "--ppo.minibatch", "48"]
    )
    maker = get_robot("go1")
    for on_profile in (False, True):
        base = training_robots.make_base(config, on_profile)
        assert base.robot.has_gains((maker.servo_stiffness, maker.servo_damping))
    robots = training_robots.make_batch(config, 0, 1.0)
    model = robots.simulation.model
    robots.close()
    np.testing.assert_array_equal(model.actuator_gainprm[:, 0], maker.servo_stiffness)


FAULTS: Faults = {
    "five-line loop with other gains": (
        lambda patch: patch.setattr(registry, "check_servo", lambda *_: None),
        check_the_loop_of_a_scripted_policy_gives_the_evaluators_bits,
    ),
    "five-line loop of a trained policy with other gains": (
        lambda patch: patch.setattr(registry, "check_servo", lambda *_: None),
        check_the_loop_of_a_trained_policy_gives_the_evaluators_bits,
    ),
    "stiff servos that are the maker's": (
        lambda patch: patch.setattr(
            Robot,
            "servo_gains",
            lambda robot, _, count=1: parse_servo_gains((robot.servo_stiffness, robot.servo_damping), count),
        ),
        check_the_loop_of_a_scripted_policy_gives_the_evaluators_bits,
    ),
    "end-to-end on the stiff servos of its pose": (
        lambda patch: patch.setattr(Robot, "with_servo", lambda robot, *_: robot),
        check_end_to_end_trains_on_the_makers_gains,
    ),
}


test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
