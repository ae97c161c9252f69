from dataclasses import replace

import numpy as np
import pytest

import policies
from evaluate.rollouts import rollout
from policies.gaits.change import CHANGE_TIME
from policies.gaits.parameters import (
    GAITS,
    OFFSETS,
    GaitParameters,
    froude_number,
    gait_timing,
    limit_command,
    parameter_row,
)
from policies.gaits.policy import Gaits
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from tests.policies.gaits.strides import TARGET_RATE_LIMIT, Strides, walked
from tests.policies.readings import feet, reading

LEGS = ("fl", "fr", "hl", "hr")
# The nominal path: no compensation, no feedback, an identity for the command map, 40 ticks a cycle.
BARE = GaitParameters(
    frequency=2.5, frequency_rise=0.0, duty=0.6, duty_fall=0.0, body_height=0.4, stance_load=0.0, servo_lead=0.0
)


def bare(gait, **changes):
    """Return a policy with the same nominal parameters for every stepping gait."""
    parameters = dict.fromkeys(OFFSETS, replace(BARE, **changes))
    return Gaits(gait, parameters=parameters)


def steps(policy, command, count):
    """Return actions (count, n, 12) and swing states (count, n, 4) at a constant command."""
    rows = [(policy.act(reading(policy.num_envs, command=command)), policy.swing) for _ in range(count)]
    return np.array([action for action, _ in rows], np.float64), np.array([swing for _, swing in rows])


def touch_downs(swing):
    """Return the control steps at which each leg of the first robot lands."""
    landed = swing[:-1, 0] & ~swing[1:, 0]
    return {leg: np.flatnonzero(landed[:, i]) for i, leg in enumerate(LEGS)}


@pytest.mark.parametrize(
    ("gait", "behind"),
    [
        # Control steps between the landing of fl and the landing of the other legs; a cycle has 40 steps.
        ("trot", {"fr": 20, "hl": 20, "hr": 0}),
        ("pace", {"fr": 20, "hl": 0, "hr": 20}),
        ("bound", {"fr": 0, "hl": 20, "hr": 20}),
        ("pronk", {"fr": 0, "hl": 0, "hr": 0}),
        ("walk", {"fr": 20, "hl": 30, "hr": 10}),  # order hr, hl, fr, fl: a quarter of a cycle between landings
    ],
)
def test_feet_land_in_the_order_that_the_gait_is_named_for(gait, behind):
    policy = bare(gait)
    steps(policy, (0.3, 0.0, 0.0), 150)
    landed = touch_downs(steps(policy, (0.3, 0.0, 0.0), 121)[1])
    for leg, expected in behind.items():
        late = (landed[leg][0] - landed["fl"][0]) % 40
        assert min(abs(late - expected), 40 - abs(late - expected)) <= 1, leg


def test_standing_feet_move_against_the_commanded_velocity_at_their_place():
    policy, command = bare("trot"), (-0.3, 0.2, 0.6)
    steps(policy, command, 200)
    actions, swing = steps(policy, command, 80)
    where = feet(actions[:, 0])
    velocity = np.diff(where, axis=0) / 0.01
    standing = ~swing[:-1, 0] & ~swing[1:, 0]
    vx, vy, yaw_rate = command
    expected = np.stack(
        [-(vx - yaw_rate * where[:-1, :, 1]), -(vy + yaw_rate * where[:-1, :, 0]), np.zeros((79, 4))], axis=-1
    )
    np.testing.assert_allclose(velocity[standing], expected[standing], atol=2e-3)


def test_froude_number_by_hand():
    # 0.5 m/s on 0.4 m; sqrt(0.3² + 0.4²) = 0.5 as well; 1 rad/s about a hip at sqrt(0.25² + 0.15²) m.
    command = np.array([[0.5, 0.0, 0.0], [0.3, 0.4, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(
        froude_number(SIMPLE_QUAD, command, np.full(3, 0.4)), [0.06371, 0.06371, 0.021662], rtol=1e-4
    )


def test_frequency_rises_and_duty_falls_with_the_root_of_the_froude_number_up_to_one():
    values = np.tile(parameter_row(replace(BARE, frequency_rise=1.0, duty_fall=0.1)), (3, 1))
    one = np.sqrt(9.81 * 0.4)
    frequency, duty = gait_timing(
        SIMPLE_QUAD, values, np.array([[0.0, 0.0, 0.0], [0.5 * one, 0.0, 0.0], [2.0 * one, 0.0, 0.0]])
    )
    np.testing.assert_allclose(frequency, [2.5, 3.0, 3.5])
    np.testing.assert_allclose(duty, [0.6, 0.55, 0.5])


@pytest.mark.parametrize("first", GAITS)
def test_no_target_jumps_in_a_change_of_gait_at_any_time_of_the_cycle(first):
    others = [gait for gait in GAITS if gait != first]
    policy = Gaits(first)
    policy.reset(10 * len(others))
    target = np.arange(policy.num_envs) // 10
    begin = 200 + 4 * (np.arange(policy.num_envs) % 10)
    actions = []
    for step in range(400):
        for number, other in enumerate(others):
            if (asked := (begin == step) & (target == number)).any():
                policy.request(other, asked)
        actions.append(policy.act(reading(policy.num_envs, command=(0.4, 0.0, 0.0))))
    rate = np.abs(np.diff(np.array(actions, np.float64), axis=0)) / 0.01
    assert rate.max() < TARGET_RATE_LIMIT
    assert policy.settled[[others[each] != "stand" for each in target]].all()


@pytest.mark.parametrize("first", ["pronk", "walk"])
def test_standing_comes_to_rest_in_the_home_pose_with_every_swing_finished(first):
    policy = Gaits(first)
    policy.reset(16)
    swings, lag = [], 120 + 2 * np.arange(16)
    for step in range(600):
        if (asked := lag == step).any():
            policy.request("stand", asked)
        action = policy.act(reading(16, command=(0.4, 0.1, 0.2)))
        swings.append(policy.swing)
    assert policy.settled.all()
    np.testing.assert_allclose(action, np.tile(SIMPLE_QUAD.home_pose, (16, 1)), atol=0.03)
    still = steps(policy, (0.4, 0.1, 0.2), 5)[0]
    assert (np.abs(still - still[0]) < 1e-6).all()
    # A full swing takes (1 - duty)/rate: 0.1 s for the steps of the stand, and more in some gaits; none is shortened.
    padded = np.concatenate([np.array(swings), np.zeros((1, 16, 4), bool)])[100:]
    for robot, leg in np.ndindex(16, 4):
        edges = np.flatnonzero(np.diff(padded[:, robot, leg].astype(int)))
        lengths = np.diff(edges)[int(padded[0, robot, leg]) :: 2]
        assert lengths.min() >= 7


def test_a_request_changes_the_masked_robots_and_no_bit_of_the_others():
    policy, undisturbed = Gaits("trot"), Gaits("trot")
    policy.reset(4), undisturbed.reset(4)
    steps(policy, (0.4, 0.0, 0.0), 90), steps(undisturbed, (0.4, 0.0, 0.0), 90)
    mask = np.array([True, False, True, False])
    policy.request("bound", mask)
    changed, kept = steps(policy, (0.4, 0.0, 0.0), 150)[0], steps(undisturbed, (0.4, 0.0, 0.0), 150)[0]
    assert changed[:, ~mask].tobytes() == kept[:, ~mask].tobytes()
    assert (changed[-1, mask] != kept[-1, mask]).any(axis=1).all()
    assert policy.gait.tolist() == ["bound", "trot", "bound", "trot"]


def test_offsets_go_the_shorter_way_and_arrive():
    policy = bare("walk")
    steps(policy, (0.0, 0.0, 0.0), 110)
    policy.request("trot")
    seen = []
    for _ in range(round(CHANGE_TIME / 0.01)):
        policy.act(reading())
        seen.append(policy.offsets[0])
    # hl swings from a quarter of a cycle to half of one, hr from three quarters to a whole one.
    np.testing.assert_allclose(np.ptp(seen, axis=0), [0.0, 0.0, np.pi / 2, np.pi / 2], atol=0.01)
    np.testing.assert_allclose(np.exp(1j * seen[-1]), np.exp(1j * np.array(OFFSETS["trot"])), atol=1e-6)


@pytest.mark.parametrize("make", [lambda: Gaits("gallop"), lambda: Gaits().request("gallop")])
def test_an_unknown_gait_is_answered_with_the_valid_ones(make):
    with pytest.raises(ValueError, match=r"gallop.*bound, pace, pronk, trot, walk, stand"):
        make()


def test_beyond_its_limits_a_gait_goes_the_same_way_on_the_ellipsoid():
    values = parameter_row(replace(BARE, forward_limit=0.8, backward_limit=0.2, lateral_limit=0.3, yaw_limit=0.6))
    command = np.array([[0.4, 0.1, 0.2], [1.6, 0.0, 0.0], [-0.4, 0.0, 0.0], [0.8, -0.3, 0.0], [0.0, 0.0, -1.2]])
    half = np.sqrt(0.5)
    expected = [[0.4, 0.1, 0.2], [0.8, 0, 0], [-0.2, 0, 0], [0.8 * half, -0.3 * half, 0], [0, 0, -0.6]]
    np.testing.assert_allclose(limit_command(np.tile(values, (5, 1)), command), expected)


ROBOTS = 6
SPEEDS = {"walk": 0.3}


def walk(gait) -> Strides:
    command = np.array([SPEEDS.get(gait, 0.5), 0.0, 0.0])
    return walked(Gaits(gait), command, episode_seeds("search", 7, ROBOTS), steps=600)


@pytest.mark.parametrize("gait", OFFSETS)
def test_it_walks_as_commanded_on_flat_ground(gait):
    found = walk(gait)
    late = found.since(200)
    assert not found.fell.any()
    assert np.abs(late.duty_errors()).max() < 0.05
    assert np.abs(late.offset_errors()).max() < 0.05
    assert late.heading_velocity[..., 0].mean() == pytest.approx(SPEEDS.get(gait, 0.5), rel=0.1)
    assert found.target_rate.max() < TARGET_RATE_LIMIT


@pytest.mark.parametrize("gait", OFFSETS)
def test_it_keeps_its_feet_whatever_it_is_commanded(gait):
    episodes = rollout.run(
        policies.make("gaits" if gait == "trot" else gait), "flat", episode_seeds("search", 8, ROBOTS), steps=600
    )
    assert (episodes.fall_step == episodes.steps).all()
