"""Prediction of a control period in implicit steps: stance feet neither slip nor leave the ground."""

import numpy as np
import pytest

from policies.contact.motion_state import MotionState, compute_motion_state
from policies.mpc.observer import DelayCompensator
from policies.mpc.servo_step import compute_response
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.policies.readings import reading

PERIOD = 0.01
DYNAMICS = Dynamics(SIMPLE_QUAD)


def moving(count: int = 1) -> MotionState:
    """Return robots with fast legs and trunks."""
    speeds = np.random.default_rng(2).normal(0.0, 3.0, 12)
    rows = reading(count, angular_velocity=(1.0, -2.0, 1.5), joint_velocity=speeds)
    return compute_motion_state(SIMPLE_QUAD, DYNAMICS, rows)


def test_feet_on_the_ground_rest_at_the_end_of_the_period() -> None:
    """Jacobians are those at the start of the period; the drift changes them by drift times the period."""
    now, targets = moving(), np.tile(SIMPLE_QUAD.home_pose, (1, 1, 1))
    standing = np.array([[True, False, False, True]])
    velocity = compute_response(SIMPLE_QUAD, now, standing, np.zeros((1, 6)), PERIOD).velocities(targets)[0]
    changed = PERIOD * now.bodies.foot_bias_acceleration[0]
    left = np.abs((now.bodies.jacobians[0] @ velocity[0]) + changed)
    assert np.abs(changed[[0, 3]]).max() > 0.01
    assert left[[0, 3]].max() < 1e-3
    assert left[[1, 2]].max() > 0.1


@pytest.mark.parametrize("delays", [(2, 0), (2, 1), (2, 2)])
def test_a_robot_s_motion_ahead_is_its_own_whatever_the_others_delays(delays: tuple[int, int]) -> None:
    rows = reading(2, joint_velocity=np.outer((0.5, -1.0), np.ones(12)))
    wrench, touching = np.zeros((2, 6)), np.ones((2, 4), np.bool_)

    def ahead(robots: slice) -> MotionState:
        observer, count = DelayCompensator(SIMPLE_QUAD, DYNAMICS, PERIOD), len(range(2)[robots])
        observer.reset(count)
        observer.delay_estimator.delays = np.array(delays)[robots]
        observer.read(rows[robots], wrench[robots])
        return observer.predict(wrench[robots], touching[robots], np.zeros((2, count)), None)

    together = ahead(slice(0, 2))
    for robot in range(2):
        alone = ahead(slice(robot, robot + 1))
        np.testing.assert_array_equal(together.generalised_velocity[robot], alone.generalised_velocity[0])
        np.testing.assert_array_equal(together.bodies.inertia[robot], alone.bodies.inertia[0])
