"""The trot by virtual model control."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import policies
from policies.contact.motion_state import MotionState, compute_motion_state
from policies.mpc.footing import TerrainPlane
from policies.mpc.model_based import ContactPlan, ControlState
from policies.mpc.rigid_body import Friction
from policies.virtual_model.forces import distribute_acceleration, virtual_acceleration
from policies.virtual_model.parameters import MAX_FREQUENCY, VirtualParameters, searched_parameters
from policies.virtual_model.policy import TrotFeedback
from quad_env import OBSERVATION
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.policies.readings import reading
from tests.quad_env.robots.alike import alike

P = VirtualParameters()
WEIGHT = SIMPLE_QUAD.mass * 9.81
ALL = np.ones((1, 4), np.bool_)


def standing(**readings):
    return compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), reading(1, **readings))


def pull(now, height=0.45, forward=0.0, lateral=0.0):
    """Return the virtual acceleration of a trunk at `height` above a slope, for a desired height of 0.45 m."""
    return virtual_acceleration(
        P, now, TerrainPlane(*(np.array([value]) for value in (-height, forward, lateral))), 0.45
    )[0]


def forces(now, wanted, stands=ALL, p=P):
    return distribute_acceleration(
        p, now, np.atleast_2d(wanted), stands, Friction(np.array([0.6]), np.array([2.0 * WEIGHT]))
    )[0]


def test_feet_together_bear_the_weight_and_press_harder_where_the_trunk_is_too_low() -> None:
    now = standing()
    assert pull(now) == pytest.approx(np.zeros(6))
    assert pull(now, 0.42)[2] == pytest.approx(0.03 * P.height_stiffness)
    assert forces(now, np.zeros(6))[:, 2].sum() == pytest.approx(WEIGHT, rel=1e-3)
    assert forces(now, [0, 0, 2.0, 0, 0, 0])[:, 2].sum() == pytest.approx(SIMPLE_QUAD.mass * 11.81, rel=1e-3)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_tilted_trunk_is_turned_back_by_the_feet_of_the_lower_side(axis: int) -> None:
    """The roll is positive with the left side up, and the pitch with the nose down. Feet are fl, fr, hl, hr."""
    gravity = [(0.0, -0.1, -0.995), (0.1, 0.0, -0.995)][axis]
    now = standing(projected_gravity=gravity)
    assert now.tilt[0, axis] == pytest.approx(0.1, rel=0.01)
    wanted = pull(now)
    assert wanted[3 + axis] < 0.0
    up = forces(now, wanted)[:, 2]
    lower, higher = (([1, 3], [0, 2]), ([0, 1], [2, 3]))[axis]
    assert up[lower].sum() > up[higher].sum() + 5.0


def test_a_trunk_that_turns_or_rises_is_slowed_down() -> None:
    now = standing(angular_velocity=(0.5, -0.4, 0.3), linear_velocity=(0.0, 0.0, 0.2))
    damped = [-0.2 * P.height_damping, -0.5 * P.tilt_damping, 0.4 * P.tilt_damping, -0.3 * P.yaw_damping]
    assert pull(now)[2:] == pytest.approx(damped, abs=1e-6)


def test_a_command_pulls_along_and_on_a_slope_up_with_the_trunk_parallel_to_it() -> None:
    now = standing(command=(0.4, 0.0, 0.5))
    assert pull(now)[[0, 1, 5]] == pytest.approx([0.4 * P.forward_damping, 0.0, 0.5 * P.yaw_damping], abs=1e-6)
    uphill = pull(now, forward=0.1)
    assert uphill[2] == pytest.approx(0.04 * P.height_damping, abs=1e-6)
    assert uphill[4] == pytest.approx(-np.arctan(0.1) * P.tilt_stiffness, abs=1e-6)


def test_a_command_pulls_up_a_side_slope_with_the_trunk_parallel_to_it() -> None:
    """The ground rises by 0.1 to the left: the velocity is 0.04 m/s upward at 0.4 m/s to the left.

    The left side is up, with a positive roll.
    """
    now = standing(command=(0.0, 0.4, 0.0))
    uphill, downhill = pull(now, lateral=0.1), pull(now, lateral=-0.1)
    assert uphill[2] == pytest.approx(0.04 * P.height_damping, abs=1e-6)
    assert downhill[2] == pytest.approx(-0.04 * P.height_damping, abs=1e-6)
    assert uphill[3] == pytest.approx(0.0996687 * P.tilt_stiffness, abs=1e-5)  # arctan 0.1
    assert downhill[3] == pytest.approx(-0.0996687 * P.tilt_stiffness, abs=1e-5)
    assert uphill[1] == pytest.approx(0.4 * P.lateral_damping, abs=1e-6)
    assert uphill[[0, 4, 5]] == pytest.approx(np.zeros(3), abs=1e-6)


def test_springs_and_dampers_ask_for_no_more_than_a_robot_can_do() -> None:
    """The robot has a tilt of 1.2 rad, a height error of ±1 m, and a high velocity after an impact."""
    assert pull(standing(projected_gravity=(0.0, -np.sin(1.2), -np.cos(1.2))))[3] == -60.0
    assert pull(standing(projected_gravity=(np.sin(1.2), 0.0, -np.cos(1.2))))[4] == -60.0
    assert pull(standing(), height=-0.55)[2] == 9.0
    assert pull(standing(), height=1.45)[2] == -4.0
    fast = pull(standing(linear_velocity=(4.0, -4.0, 0.0), angular_velocity=(0.0, 0.0, 9.0)))
    assert fast[[0, 1, 5]].tolist() == [-5.0, 5.0, -60.0]


def pushed_by(now: MotionState, acceleration: list[float]) -> ControlState:
    """Return the estimates of a robot with a disturbance acceleration, m/s² and rad/s²."""
    friction = Friction(np.array([0.6]), np.array([2.0 * WEIGHT]))
    return ControlState(now, np.zeros((1, 4, 3)), np.zeros((1, 6)), np.array([acceleration]), friction)


def test_feet_bear_against_a_lasting_push() -> None:
    """A push of 0.8 m/s² ahead, 0.5 to the right and 1 down needs forces of mass · (-0.8, 0.5, 9.81 + 1) N in total."""
    policy, now = TrotFeedback(P), standing()
    policy.reset(1)
    ground = TerrainPlane(*(np.array([value]) for value in (-P.height, 0.0, 0.0)))
    plan = ContactPlan(ALL, ground, now.bodies.feet[..., :2], np.zeros((1, 4, 3)))
    borne = policy._compute_stance_forces(pushed_by(now, [0.8, -0.5, -1.0, 0.0, 0.0, 0.0]), plan)
    assert borne.forces[0].sum(axis=0) == pytest.approx(SIMPLE_QUAD.mass * np.array([-0.8, 0.5, 10.81]), rel=2e-3)
    np.testing.assert_allclose(borne.moment_arms, now.bodies.feet - now.bodies.com_position[:, None])
    turned = policy._compute_stance_forces(pushed_by(now, [0.0, 0.0, 0.0, 0.0, 0.0, 2.0]), plan)
    moment = np.cross(turned.moment_arms[0], turned.forces[0]).sum(axis=0)
    acceleration = np.linalg.solve(now.bodies.rotational_inertia[0], moment)
    assert acceleration == pytest.approx([0.0, 0.0, -2.0], abs=0.02)


@pytest.mark.parametrize(("priority", "upright"), [(100.0, True), (0.01, False)])
def test_two_feet_keep_the_trunk_level_or_brake_it_by_priority(priority: float, upright: bool) -> None:
    now, diagonal = standing(), np.array([[True, False, False, True]])
    p = replace(P, planar_priority=1.0, tilt_priority=priority)
    found = forces(now, [-2.0, 0.0, 0.0, 0.0, 0.0, 0.0], diagonal, p)
    moment = np.cross(now.bodies.feet[0] - now.bodies.com_position[0], found).sum(axis=0)
    braked = found[:, 0].sum() / now.bodies.mass[0]
    assert (np.abs(moment[:2]).max() < 0.5, braked < -1.5) == (upright, not upright)
    assert not found[[1, 2]].any()


def test_forces_stay_within_the_cone_and_never_pull() -> None:
    found = forces(standing(), [5.0, 5.0, -20.0, 60.0, 0.0, 0.0])
    assert found[:, 2].min() >= 0.0
    assert (np.hypot(found[:, 0], found[:, 1]) <= 0.6 * found[:, 2] + 1e-9).all()


def test_forces_are_the_smallest_that_come_nearest_to_the_weighted_accelerations() -> None:
    """The forces of two feet with different weights are the least-squares solution of least norm."""
    now, diagonal = standing(), np.array([[True, False, False, True]])
    p = replace(P, planar_priority=0.7, tilt_priority=0.4, yaw_priority=0.15)
    wanted = np.array([-0.5, 0.4, 0.3, 1.5, -1.0, 2.0])
    weights = np.array([0.7, 0.7, 1.0, 0.4, 0.4, 0.15])
    effects = np.zeros((6, 6))
    for column, foot in enumerate((0, 3)):
        arm = now.bodies.feet[0, foot] - now.bodies.com_position[0]
        for axis in range(3):
            moment = np.cross(arm, np.eye(3)[axis])
            effects[:3, 3 * column + axis] = np.eye(3)[axis] / now.bodies.mass[0]
            effects[3:, 3 * column + axis] = np.linalg.solve(now.bodies.rotational_inertia[0], moment)
    asked = weights * (wanted + 9.81 * np.eye(6)[2])
    square = (weights[:, None] * effects) @ (weights[:, None] * effects).T + 1e-5 * np.eye(6)
    by_hand = ((weights[:, None] * effects).T @ np.linalg.solve(square, asked)).reshape(2, 3)
    found = forces(now, wanted, diagonal, p)
    np.testing.assert_allclose(found[[0, 3]], by_hand, rtol=1e-6, atol=1e-6)
    assert not found[[1, 2]].any()


def test_each_robot_s_feet_are_held_to_its_own_friction_and_its_largest_force() -> None:
    now = compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), reading(2))
    friction = Friction(np.array([0.6, 0.1]), np.array([30.0, 500.0]))
    wanted = np.tile([4.0, 0.0, 5.0, 0.0, 0.0, 0.0], (2, 1))
    found = distribute_acceleration(P, now, wanted, np.ones((2, 4), np.bool_), friction)
    assert found[0, :, 2].max() == 30.0
    assert 30.0 < found[1, :, 2].max() < 500.0
    slope = np.hypot(found[..., 0], found[..., 1]) / found[..., 2]
    assert slope[1].max() == pytest.approx(0.1)
    assert 0.1 < slope[0].max() <= 0.6 + 1e-9


def test_the_velocity_that_is_damped_is_that_of_the_centre_of_mass() -> None:
    """The centre of mass is 0.0365 m behind the trunk's centre and moves to the right during a left turn at 2 rad/s."""
    now = standing(angular_velocity=(0.0, 0.0, 2.0))
    assert now.bodies.com_position[0, :2] == pytest.approx([-0.0364633, 0.0], abs=1e-6)
    assert pull(now)[:2] == pytest.approx([0.0, P.lateral_damping * 2.0 * 0.0364633], abs=1e-6)


def acted(policy: TrotFeedback, **readings: float) -> TrotFeedback:
    """Return the action after a period of rest with the given observations."""
    policy.reset(1)
    for _ in range(8):
        policy.act(reading(1, **readings))
    return policy


def test_diagonal_legs_swing_together() -> None:
    assert acted(TrotFeedback(P))._was_swing[0].tolist() in ([True, False, False, True], [False, True, True, False])


def test_one_robot_has_the_same_targets_alone_and_in_a_batch() -> None:
    rng = np.random.default_rng(3)
    rows = [reading(3) + rng.normal(0.0, 0.05, (3, reading(1).shape[1])).astype(np.float32) for _ in range(25)]
    together, alone = policies.make("trot_feedback"), policies.make("trot_feedback")
    together.reset(3)
    alone.reset(1)
    for row in rows:
        assert together.act(row)[1].tobytes() == alone.act(row[1:2])[0].tobytes()


def test_a_small_robot_steps_no_faster_than_a_slow_trot(tmp_path: Path) -> None:
    assert searched_parameters(alike(tmp_path, longer=0.4)).frequency == MAX_FREQUENCY


def test_joint_targets_follow_the_readings_finitely_when_fallen_over() -> None:
    policy = acted(policies.make("trot_feedback"), linear_velocity=3.0)
    fallen = reading(1)
    fallen[:, OBSERVATION["projected_gravity"]] = 1.0, 0.0, 0.0
    assert np.isfinite(policy.act(fallen)).all()
