"""The trot by virtual model control."""

from dataclasses import replace

import numpy as np
import pytest

import policies
from policies.gait_cycle import LegCycle
from policies.mpc.contact import ContactStates
from policies.mpc.footing import Ground, passing
from policies.mpc.motion import motion
from policies.mpc.rigid_body import Friction
from policies.virtual_model.forces import Aim, load, pulled, shared
from policies.virtual_model.parameters import FASTEST, VirtualParameters, ranges_of, searched_parameters
from policies.virtual_model.policy import TrotVirtual
from quad_env import OBSERVATION
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.policies.readings import reading

P = VirtualParameters()
WEIGHT = SIMPLE_QUAD.mass * 9.81
ALL = np.ones((1, 4))


def standing(**readings):
    return motion(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), reading(1, **readings))


def level(height=0.45):
    return Aim(np.zeros((1, 3)), np.zeros(1), np.array([height]), np.zeros((1, 2)))


def forces(now, wanted, share=ALL):
    return shared(P, now, np.atleast_2d(wanted), share, Friction(np.array([0.6]), np.array([2.0 * WEIGHT])))[0]


def test_feet_together_bear_the_weight_and_press_harder_where_the_trunk_is_too_low() -> None:
    now = standing()
    assert pulled(P, now, level(), np.array([0.45]))[0] == pytest.approx(np.zeros(6))
    assert pulled(P, now, level(), np.array([0.42]))[0, 2] == pytest.approx(0.03 * P.height_stiffness)
    assert forces(now, np.zeros(6))[:, 2].sum() == pytest.approx(WEIGHT, rel=1e-3)
    assert forces(now, [0, 0, 2.0, 0, 0, 0])[:, 2].sum() == pytest.approx(SIMPLE_QUAD.mass * 11.81, rel=1e-3)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_tilted_trunk_is_turned_back_by_the_feet_of_the_lower_side(axis: int) -> None:
    """Left side up: roll above 0; nose down: pitch above 0. Feet are fl, fr, hl, hr."""
    gravity = [(0.0, -0.1, -0.995), (0.1, 0.0, -0.995)][axis]
    now = standing(projected_gravity=gravity)
    assert now.tilt[0, axis] == pytest.approx(0.1, rel=0.01)
    wanted = pulled(P, now, level(), np.array([0.45]))[0]
    assert wanted[3 + axis] < 0.0
    up = forces(now, wanted)[:, 2]
    lower, higher = (([1, 3], [0, 2]), ([0, 1], [2, 3]))[axis]
    assert up[lower].sum() > 1.5 * up[higher].sum()


def test_a_trunk_that_turns_or_rises_is_slowed_down() -> None:
    now = standing(angular_velocity=(0.5, -0.4, 0.3), linear_velocity=(0.0, 0.0, 0.2))
    wanted = pulled(P, now, level(), np.array([0.45]))[0, 2:]
    damped = [-0.2 * P.height_damping, -0.5 * P.tilt_damping, 0.4 * P.tilt_damping, -0.3 * P.yaw_damping]
    assert wanted == pytest.approx(damped, abs=1e-6)


def test_two_feet_keep_the_trunk_level_before_they_brake_it() -> None:
    now, diagonal = standing(), np.array([[1.0, 0.0, 0.0, 1.0]])
    found = forces(now, [-3.0, 0.0, 0.0, 0.0, 0.0, 0.0], diagonal)
    arms = now.bodies.feet[0] - now.bodies.centre[0]
    moment = np.cross(arms, found).sum(axis=0)
    assert np.abs(moment[:2]).max() < 2.0
    assert found[[1, 2]].any() == np.False_


def test_forces_stay_within_the_cone_and_never_pull() -> None:
    found = forces(standing(), [5.0, 5.0, -20.0, 60.0, 0.0, 0.0])
    assert found[:, 2].min() >= 0.0
    assert (np.hypot(found[:, 0], found[:, 1]) <= 0.6 * found[:, 2] + 1e-9).all()


def test_a_foot_takes_over_its_load_after_landing_and_gives_it_up_before_lift_off() -> None:
    stance, period = np.array([0.2]), 0.01
    progress = np.array([[0.0, 0.5, 0.95, 0.3]])
    share = load(
        replace(P, load_time=0.03), LegCycle(np.array([[False, False, False, True]]), progress), stance, period
    )
    assert share[0] == pytest.approx([1.0 / 3.0, 1.0, 1.0 / 3.0, 0.0])


def acted(policy: TrotVirtual, **readings: float) -> TrotVirtual:
    """After a while at rest with those readings."""
    policy.reset(1)
    for _ in range(8):
        policy.act(reading(1, **readings))
    return policy


def test_footholds_go_out_with_the_velocity_and_to_the_side_of_a_push() -> None:
    policy = TrotVirtual(P)
    policy.reset(1)
    still, ahead, left = (
        policy._footholds(standing(linear_velocity=v), np.zeros((1, 6)))[0]
        for v in ((0, 0, 0), (0.5, 0, 0), (0, 0.5, 0))
    )
    reach = P.neutral_share * P.duty / P.frequency + P.step_gain
    np.testing.assert_allclose(ahead - still, np.tile([0.5 * reach, 0.0], (4, 1)), atol=2e-3)
    np.testing.assert_allclose(left - still, np.tile([0.0, 0.5 * reach], (4, 1)), atol=2e-3)
    far = policy._footholds(standing(linear_velocity=(9, 0, 0)), np.zeros((1, 6)))[0]
    np.testing.assert_allclose((far - still)[:, 0], P.reach, atol=2e-3)


def test_the_ground_passes_backward_under_a_robot_that_goes_ahead() -> None:
    policy = acted(TrotVirtual(P))
    now = standing(linear_velocity=(0.5, 0.2, 0.0))
    assert passing(now, policy.reference[:, 2])[0] == pytest.approx(np.tile([-0.5, -0.2], (4, 1)), abs=1e-6)


@pytest.mark.parametrize(("late", "higher"), [(0, 0.04), (2, 0.0)])
def test_feet_swing_higher_on_rough_ground_where_joints_are_read_in_time(late: int, higher: float) -> None:
    policy = TrotVirtual(replace(P, roughness_gain=4.0, landing_depth=0.0), late=late)
    policy.reset(2)
    policy.prints.roughness[0] = 0.01
    still, ground = np.zeros((2, 4, 2)), Ground(*np.zeros((3, 2)))
    up = [policy._path(np.full((2, 4), t), still, still, ground)[:, 0, 2] for t in (0.0, 0.5, 1.0)]
    np.testing.assert_allclose(up, [[0.0, 0.0], [P.step_height + higher, P.step_height], [0.0, 0.0]], atol=1e-12)


def test_the_way_lost_is_made_up_for() -> None:
    policy = TrotVirtual(replace(P, position_gain=1.0, integral_gain=0.0, acceleration=100.0))
    policy.reset(1)
    for _ in range(100):
        policy.act(reading(1, command=(0.4, 0.0, 0.0)))
    assert policy.reference[0] == pytest.approx([0.8, 0.0, 0.0], abs=0.02)


def test_diagonal_legs_swing_together() -> None:
    assert acted(TrotVirtual(P))._swinging[0].tolist() in ([True, False, False, True], [False, True, True, False])


@pytest.mark.parametrize(("error", "held"), [(0.0, True), (2.0, False)])
def test_a_foot_that_lands_early_is_held_but_yields_under_a_push(error: float, held: bool) -> None:
    policy, now = TrotVirtual(P), standing(linear_velocity=(0.3, 0.0, 0.0))
    policy.reset(1)
    swing = np.array([[True, False, False, True]])
    landed = np.array([[True, True, True, False]])
    cycle, contacts = LegCycle(swing, np.full((1, 4), 0.8)), ContactStates(landed, ~landed & ~swing, landed)
    ground_velocity = passing(now, policy.reference[:, 2])
    policy._lift(now, cycle, contacts, np.array([[error, 0.0, 0.0]]), ground_velocity)
    assert policy.held[0].tolist() == [held, False, False, False]
    assert policy.yielding[0].tolist() == [not held, False, False, False]
    if held:  # it goes with the ground
        place = now.bodies.feet[0, 0] - np.array([0.003, 0.0, 0.0])
        np.testing.assert_allclose(policy._place[0, 0], place, atol=1e-6)


def test_one_robot_has_the_same_targets_alone_and_in_a_batch() -> None:
    rng = np.random.default_rng(3)
    rows = [reading(3) + rng.normal(0.0, 0.05, (3, reading(1).shape[1])).astype(np.float32) for _ in range(25)]
    together, alone = policies.make("trot_virtual"), policies.make("trot_virtual")
    together.reset(3)
    alone.reset(1)
    for row in rows:
        assert together.act(row)[1].tobytes() == alone.act(row[1:2])[0].tobytes()


def test_it_steps_no_faster_than_a_slow_trot() -> None:
    assert ranges_of()["frequency"][1] <= FASTEST
    assert searched_parameters().frequency <= FASTEST


def test_joint_targets_follow_the_readings_finitely_when_fallen_over() -> None:
    policy = acted(policies.make("trot_virtual"), linear_velocity=3.0)
    fallen = reading(1)
    fallen[:, OBSERVATION["projected_gravity"]] = 1.0, 0.0, 0.0
    assert np.isfinite(policy.act(fallen)).all()
