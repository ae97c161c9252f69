"""The trot with feedback: the sign and size of each feedback, and its frames."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from policies.base import CONTROL_PERIOD
from policies.gait_cycle import Gait
from policies.legs.kinematics import joint_angles
from policies.parameters import limits_of
from policies.trot.feedback import BRACE_RANGE, BRACE_TIME, LARGEST_CORRECTION, LARGEST_SLOWDOWN, TrotFeedback
from policies.trot.feedback_parameters import FeedbackParameters, searched_parameters
from quad_env import OBSERVATION, OBSERVATION_SIZE
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.task.observations import observation_table
from tests.policies.readings import feet, reading

FORWARD, LEFT, UP = np.eye(3)
HIPS = np.concatenate((SIMPLE_QUAD.hip_positions[:, :2], np.zeros((4, 1))), axis=1)
AROUND = np.cross(UP, HIPS)
"""To the left about the trunk."""
LEFT_UP, NOSE_UP = (np.outer(np.sign(HIPS[:, axis]), UP) for axis in (1, 0))
GAINS = """
    forward_bias integral_gain yaw_integral_gain stance_push yaw_push stance_yield raibert_gain raibert_lateral
    yaw_step capture_gain frequency_gain tilt_gain tilt_damping height_gain height_damping slope_share slope_shift
    slope_height terrain_compliance rough_height rough_step rough_slowdown slope_slowdown stance_load servo_lead
"""
OFF = dict.fromkeys(GAINS.split(), 0.0) | dict.fromkeys(("brace_error", "slope_brace", "rough_brace"), 100.0)
OFF |= {"blend_time": CONTROL_PERIOD, "velocity_filter": 1e-3}
"""Every feedback off."""
GAIT = {"frequency": 6.0, "duty": 0.5, "body_height": 0.28, "stance_width": 0.48, "stance_shift": -0.08}
GAIT |= {"plane_filter": 0.2}
BARE = FeedbackParameters(**OFF | GAIT)
ROUNDING = 1e-6
"""m: actions are float32."""


def answer(changes, steps=3, **readings):
    """How far the targets of the feet move for those readings, (4, 3) m, with only some feedback on, and who stands."""
    parameters = dataclasses.replace(BARE, **changes)
    felt, level = TrotFeedback(parameters), TrotFeedback(parameters)
    for _ in range(steps):
        moved, usual = felt.act(reading(**readings)), level.act(reading())
    standing = ~Gait(felt.leg_offsets, parameters.duty).legs(felt.phase).swing[0]
    assert standing.sum() == 2
    return feet(moved) - feet(usual), standing


@pytest.mark.parametrize(
    ("gain", "readings", "standing", "way"),
    [
        # The standing legs turn the trunk back, lift it, slow it down:
        ({"tilt_gain": 1.0}, {"projected_gravity": (np.sin(0.1), 0.0, -np.cos(0.1))}, True, -NOSE_UP),  # nose down
        ({"tilt_gain": 1.0}, {"projected_gravity": (0.0, -np.sin(0.1), -np.cos(0.1))}, True, LEFT_UP),  # left side up
        ({"tilt_damping": 0.1}, {"angular_velocity": (0.0, 0.5, 0.0)}, True, -NOSE_UP),  # pitching nose down
        ({"height_gain": 0.5}, {"joint_position": np.tile([0.0, 0.4, -0.8], 4)}, True, -UP),  # crouched
        ({"height_damping": 0.02}, {"linear_velocity": (0.0, 0.0, 0.5)}, True, UP),
        ({"stance_push": 0.05}, {"linear_velocity": (0.4, 0.0, 0.0)}, True, FORWARD),
        ({"yaw_push": 0.05}, {"angular_velocity": (0.0, 0.0, 0.5)}, True, AROUND),
        # The swinging feet go where they catch it:
        ({"raibert_gain": 0.1}, {"linear_velocity": (0.4, 0.0, 0.0)}, False, FORWARD),
        ({"raibert_lateral": 0.1}, {"linear_velocity": (0.0, 0.4, 0.0)}, False, LEFT),
        ({"capture_gain": 0.1, "capture_threshold": 0.5}, {"linear_velocity": (0.0, -1.0, 0.0)}, False, -LEFT),
        ({"yaw_step": 0.1}, {"angular_velocity": (0.0, 0.0, 0.5)}, False, AROUND),
    ],
)
def test_each_feedback_moves_the_standing_or_the_swinging_feet_its_way_and_the_others_not(
    gain, readings, standing, way
):
    moved, stands = answer(gain, steps=6, **readings)
    moved, affected = moved - answer({}, steps=6, **readings)[0], stands == standing
    assert ((moved * way).sum(axis=1)[affected] > 0.0005).all()
    assert np.abs(moved[~affected]).max() < ROUNDING


def test_every_reading_of_the_sensors_lags_from_the_second_on_and_no_command():
    policy = TrotFeedback(dataclasses.replace(BARE, sensor_filter=9.0 * CONTROL_PERIOD))
    columns = np.ones((OBSERVATION_SIZE, 1))
    np.testing.assert_array_equal(policy._smoothed(columns.copy()), columns)
    policy._ticks += 1.0
    smoothed = policy._smoothed(columns + 1.0)[:, 0]
    for name in ("linear_velocity", "angular_velocity", "projected_gravity", "joint_position"):
        np.testing.assert_allclose(smoothed[OBSERVATION[name]], 1.1, err_msg=name)
    assert (smoothed[OBSERVATION["command"]] == 2.0).all()


def strides(share, **changes):
    """The policy after 3 s with joints that move by that share of their targets' movement."""
    policy = TrotFeedback(dataclasses.replace(BARE, blend_time=0.3, **changes))
    action = SIMPLE_QUAD.home_pose
    for _ in range(300):
        moved = share * (action - SIMPLE_QUAD.home_pose)
        before, action = policy.phase, policy.act(reading(joint_position=moved))
    return policy, (policy.phase - before)[0] % (2.0 * np.pi) / (2.0 * np.pi * CONTROL_PERIOD)


def test_joints_that_do_not_follow_slow_the_gait_down_and_those_that_do_leave_it_alone():
    frequency = BARE.frequency
    assert strides(0.1)[1] == pytest.approx(frequency)  # off
    assert strides(1.0, least_following=0.4)[1] == pytest.approx(frequency)
    assert strides(0.1, least_following=0.4)[1] == pytest.approx((1.0 - LARGEST_SLOWDOWN) * frequency)


def test_slower_steps_are_higher_and_longer():
    slow, _ = strides(0.1, least_following=0.4, step_height=0.05, slow_step=0.1)
    usual = TrotFeedback(dataclasses.replace(BARE, step_height=0.05))
    lifts, places = [], []
    for _ in range(200):
        for policy in (slow, usual):
            policy.act(reading(command=(0.5, 0.0, 0.0)))
        lifts.append([policy.lift.max() for policy in (slow, usual)])
        places.append([policy.feet[0, 0, 0] for policy in (slow, usual)])
    np.testing.assert_allclose(np.max(lifts, axis=0), (0.05 + 0.1 * LARGEST_SLOWDOWN, 0.05), atol=2e-3)
    longer = np.divide(*np.ptp(places[100:], axis=0))
    assert longer == pytest.approx(1.0 / (1.0 - LARGEST_SLOWDOWN), rel=0.15)


def test_while_a_push_is_caught_the_clock_runs_faster():
    faster, plain = (
        TrotFeedback(dataclasses.replace(BARE, frequency_gain=share, capture_threshold=0.5)) for share in (0.4, 0.0)
    )
    for policy in (faster, plain):
        policy.act(reading(linear_velocity=(1.0, 0.0, 0.0)))
    assert faster.phase[0] == pytest.approx(plain.phase[0] * (1.0 + 0.4 * 0.5))


def test_standing_feet_push_against_no_more_than_the_error_that_a_step_is_to_catch():
    changes = {"stance_push": 0.05, "capture_threshold": 0.5}
    most, standing = answer(changes, linear_velocity=(0.5, 0.0, 0.0))
    beyond, _ = answer(changes, linear_velocity=(2.0, 0.0, 0.0))
    np.testing.assert_allclose(beyond[standing], most[standing], atol=ROUNDING)
    aslant, _ = answer(changes, linear_velocity=(2.0, 2.0, 0.0))
    np.testing.assert_allclose(aslant[standing, 1], most[standing, 0] / np.sqrt(2.0), atol=1e-4)


def test_the_integral_of_a_steady_velocity_error_grows_against_it_up_to_its_limit():
    policy = TrotFeedback(dataclasses.replace(BARE, integral_gain=2.0))
    slow = reading(linear_velocity=(-0.1, 0.0, 0.0))
    for _ in range(50):
        policy.act(slow)
    assert policy.velocity_correction[:, 0].tolist() == pytest.approx([2.0 * 0.1 * 0.5, 0.0, 0.0])
    for _ in range(500):
        policy.act(slow)
    assert policy.velocity_correction[0, 0] == LARGEST_CORRECTION
    pushed = TrotFeedback(dataclasses.replace(BARE, integral_gain=2.0))
    for _ in range(50):
        pushed.act(reading(linear_velocity=(1.0, 0.0, 0.0)))
    assert not pushed.velocity_correction.any()  # a push is no bias


def test_far_too_fast_for_any_foothold_all_feet_come_down_wide_and_low_and_the_clock_stops():
    parameters = dataclasses.replace(BARE, brace_error=1.0, brace_width=0.66, brace_length=0.6, brace_height=0.18)
    policy = TrotFeedback(dataclasses.replace(parameters, brace_lead=0.0, brace_tilt_gain=0.0, brace_tilt_damping=0.0))
    fast = reading(linear_velocity=(0.0, 1.5 + BRACE_RANGE, 0.0))
    for _ in range(round(BRACE_TIME / CONTROL_PERIOD) + 1):
        action, phase = policy.act(fast), policy.phase[0]
    braced = feet(policy.act(fast))
    assert policy.phase[0] == phase
    np.testing.assert_allclose(np.abs(braced), np.tile([0.3, 0.33, 0.18], (4, 1)), atol=1e-5)
    assert action.shape == (12,)


def test_bracing_ends_slowly_and_the_trot_goes_on():
    policy = TrotFeedback(dataclasses.replace(BARE, brace_error=1.0, brace_release=0.2))
    for _ in range(10):
        policy.act(reading(linear_velocity=(3.0, 0.0, 0.0)))
    assert policy.brace.item() == 1.0
    for _ in range(10):
        policy.act(reading())
    assert policy.brace.item() == pytest.approx(0.5)
    phase = policy.phase[0]
    policy.act(reading())
    assert policy.phase[0] > phase


def standing_on(z):
    """Reading of a level trunk whose feet stand 0.35 m below it and higher by those heights, (4,), m."""
    feet = HIPS + np.outer(0.1 * SIMPLE_QUAD.side, LEFT) + np.outer(-0.35 + z, UP)
    joints = joint_angles(SIMPLE_QUAD, feet - SIMPLE_QUAD.hip_positions).ravel()
    return reading(joint_position=joints - SIMPLE_QUAD.home_pose)


def on_slope(forward, lateral):
    """Reading of a level trunk whose feet stand on that slope."""
    return standing_on(forward * HIPS[:, 0] + lateral * (HIPS[:, 1] + 0.1 * SIMPLE_QUAD.side))


def on_a_stone(height):
    """Reading of a level trunk one of whose feet stands that much higher than the others, m."""
    return standing_on(height * np.array([1.0, 0.0, 0.0, 0.0]))


@pytest.mark.parametrize("slope", [(0.0, -0.2), (-0.2, 0.15)])
def test_the_slope_under_the_feet_is_felt_and_the_swinging_feet_follow_it(slope):
    policy, level = (TrotFeedback(dataclasses.replace(BARE, body_height=0.38)) for _ in range(2))
    for _ in range(200):
        action, usual = policy.act(on_slope(*slope)), level.act(on_slope(0.0, 0.0))
    np.testing.assert_allclose(np.ravel(policy.ground.slope), slope, atol=2e-3)
    target, plain = feet(action), feet(usual)
    np.testing.assert_allclose(target[:, 2] - plain[:, 2], target[:, :2] @ slope, atol=2e-3)


def test_on_a_slope_the_legs_hang_along_gravity_and_the_trunk_leans_with_it():
    """Trunk parallel to a slope of 0.3: seen from the trunk gravity leans back, and so do the feet."""
    pitch = np.arctan(0.3)
    uphill = (-np.sin(pitch), 0.0, -np.cos(pitch))
    policy = TrotFeedback(dataclasses.replace(BARE, tilt_gain=1.0, slope_share=1.0))
    level = TrotFeedback(dataclasses.replace(BARE, tilt_gain=1.0, slope_share=1.0))
    for _ in range(300):
        action, usual = policy.act(reading(projected_gravity=uphill)), level.act(reading())
    shift = feet(action) - feet(usual)
    np.testing.assert_allclose(policy.ground.slope[0].item(), 0.3, atol=2e-3)
    assert (shift[:, 0] < -0.05).all()


def test_on_ground_too_rough_to_walk_on_it_stands_still_on_all_feet_and_remembers():
    bare = dataclasses.replace(BARE, hold_width=0.56, hold_length=0.6, hold_height=0.34)
    policy = TrotFeedback(dataclasses.replace(bare, rough_brace=0.02))
    for _ in range(200):
        policy.act(on_a_stone(0.2))
    phase = policy.phase[0]
    for _ in range(100):
        action = policy.act(on_slope(0.0, 0.0))
    assert policy.phase[0] == phase
    assert not policy.reference.any()
    # The slope that the stone seemed to be is forgotten by now.
    np.testing.assert_allclose(np.abs(feet(action)), np.tile([0.3, 0.28, 0.34], (4, 1)), atol=2e-3)
    even = TrotFeedback(dataclasses.replace(BARE, rough_brace=0.02))
    for _ in range(200):
        even.act(on_a_stone(0.02))
    assert even.brace.item() == 0.0


def roughness_learnt(first, then):
    """Roughness, m, that a robot learns in half a second on a stone under a command, after another on even ground."""
    policy = TrotFeedback(BARE)
    for row, velocity in ((on_slope(0.0, 0.0), first), (on_a_stone(0.2), then)):
        row[OBSERVATION["command"]] = velocity
        for _ in range(50):
            policy.act(row)
    return policy.ground.roughness.item()


def test_what_a_robot_feels_while_its_command_has_just_jumped_is_no_rough_ground():
    steady = roughness_learnt((1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    turned_round = roughness_learnt((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
    only_turning = roughness_learnt((1.0, 0.0, 0.0), (1.0, 0.0, 1.0))
    assert steady == only_turning > 0.01
    assert turned_round == 0.0


@pytest.mark.parametrize(("slope_brace", "brace"), [(100.0, 0.0), (0.05, 1.0)], ids=["stepping", "braced"])
def test_feet_are_shifted_uphill_by_the_slope(slope_brace, brace):
    slope = (-0.2, 0.1)
    changes = {"slope_brace": slope_brace, "plane_filter": 0.05}
    shifted, plain = (TrotFeedback(dataclasses.replace(BARE, slope_shift=shift, **changes)) for shift in (0.2, 0.0))
    for _ in range(200):
        for policy in (shifted, plain):
            policy.act(on_slope(*slope))
    assert plain.brace.item() == pytest.approx(brace)
    np.testing.assert_allclose(np.ravel(plain.ground.slope), slope, atol=2e-3)
    moved = (shifted.feet - plain.feet)[..., 0]
    np.testing.assert_allclose(moved, np.tile(np.multiply(0.2, slope)[:, None], 4), atol=2e-3)


@pytest.mark.parametrize("ground", ["rough", "steep"])
def test_bad_ground_slows_the_robot_down(ground):
    policy = TrotFeedback(dataclasses.replace(BARE, rough_slowdown=20.0, slope_slowdown=2.0, plane_filter=0.05))
    row = on_a_stone(0.2) if ground == "rough" else on_slope(0.3, 0.0)
    row[OBSERVATION["command"]] = (1.0, 0.0, 0.0)
    for _ in range(200):
        policy.act(row)
    bad = (20.0 * policy.ground.roughness.item()) ** 2 + (2.0 * policy.ground.steepness.item()) ** 2
    assert bad > 0.3
    assert policy.reference[0, 0] == pytest.approx(1.0 / (1.0 + bad), rel=0.05)


def test_it_mirrors_left_and_right():
    mirror = [1, 0, 3, 2]

    def leaning(side):
        return reading(
            projected_gravity=(0.05, 0.04 * side, -np.sqrt(1 - 0.05**2 - 0.04**2)),
            linear_velocity=(0.3, 0.5 * side, 0.1),
            angular_velocity=(0.3 * side, 0.2, 0.4 * side),
            command=(0.6, 0.2 * side, 0.5 * side),
        )

    # A frequency at which no step of the clock meets the end of a swing: rounding would decide who lands first.
    left, right = (TrotFeedback(dataclasses.replace(searched_parameters(), frequency=5.37)) for _ in range(2))
    right._phase = right._phase + np.pi
    for _ in range(40):
        one, other = left.act(leaning(1.0)).reshape(4, 3), right.act(leaning(-1.0)).reshape(4, 3)
        np.testing.assert_allclose(other[mirror] * [-1, 1, 1], one, atol=1e-5)


@settings(max_examples=20)
@given(st.data())
def test_within_the_limits_every_action_is_finite_whatever_is_read(data):
    drawn = {
        name: data.draw(st.floats(low, high) | st.sampled_from((low, high)))
        for name, (low, high) in limits_of(FeedbackParameters).items()
    }
    policy = TrotFeedback(FeedbackParameters(**drawn))
    rng, bound = np.random.default_rng(data.draw(st.integers(0, 1000))), observation_table(SIMPLE_QUAD).bound
    for scale in (0.01, 1.0, 1.0, 1.0, 1.0):
        row = (scale * rng.uniform(-bound, bound)).astype(np.float32)
        assert np.isfinite(policy.act(row)).all()
