import numpy as np
import pytest

import policies
from policies.history import Inputs
from policies.network import Network
from policies.residual import Features, ResidualPolicy, apply_correction, authority_of
from quad_env import OBSERVATION, OBSERVATION_SIZE
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.sensing.height_scan import UNSEEN, HeightScan
from quad_env.task.observations import observation_table

SCALE = observation_table(SIMPLE_QUAD).scale


def constant_network(inputs, output):
    """Return a network with a constant output."""
    return Network((np.zeros((inputs, 12), np.float32),), (np.broadcast_to(np.float32(output), 12).copy(),))


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_zero_correction_is_the_trot_bit_for_bit(zero):
    rng, n = np.random.default_rng(8), 8
    residual, trot = ResidualPolicy(policies.make("trot"), constant_network(62, zero)), policies.make("trot")
    residual.reset(n), trot.reset(n)
    observation = rng.normal(size=(n, OBSERVATION_SIZE)).astype(np.float32)
    for step in range(200):
        if step % 40 == 0:
            observation[:, OBSERVATION["command"]] = rng.uniform([-1.0, -0.8, -1.2], [1.5, 0.8, 1.2], (n, 3))
        if step == 100:
            mask = rng.random(n) < 0.5
            residual.reset_where(mask), trot.reset_where(mask)
        assert residual.act(observation).tobytes() == trot.act(observation).tobytes()
        assert residual.phase.tobytes() == trot.phase.tobytes()


class _AtPhases(policies.Trot):
    """Trot with clocks at the start of a stride and at a quarter of it."""

    phase = np.array([0.0, np.pi / 2])


def test_features_by_hand_over_a_gaited_base():
    observation = np.ones((2, OBSERVATION_SIZE), np.float32)
    base_action = np.tile(SIMPLE_QUAD.home_pose, (2, 1)).astype(np.float32) + np.float32(0.25)
    seen = Features(_AtPhases()).update(observation, base_action)
    assert seen.dtype == np.float32
    assert seen.shape == (2, OBSERVATION_SIZE + 14)
    np.testing.assert_array_equal(seen[:, :OBSERVATION_SIZE], np.tile(SCALE, (2, 1)))
    np.testing.assert_allclose(seen[:, OBSERVATION_SIZE : OBSERVATION_SIZE + 2], [[0.0, 1.0], [1.0, 0.0]], atol=1e-7)
    np.testing.assert_allclose(seen[:, OBSERVATION_SIZE + 2 :], 0.25)


def test_what_is_remembered_comes_last():
    features = Features(policies.make("stand"), Inputs(lags=(0.02,), averages=(0.1,)))
    features.reset(2)
    action = np.zeros((2, 12), np.float32)
    for value in (1.0, 2.0, 3.0):
        seen = features.update(np.full((2, OBSERVATION_SIZE), value, np.float32), action)
    share = 1.0 - np.exp(-0.1)
    average = 1.0 + share * (2.0 - 1.0)
    average += share * (3.0 - average)
    np.testing.assert_allclose(seen, np.tile(np.concatenate((3.0 * SCALE, SCALE, average * SCALE)), (2, 1)), rtol=1e-6)


def test_a_clock_of_its_own_turns_by_its_frequency():
    features = Features(policies.make("stand"), Inputs(clock=2.5))
    features.reset(2)
    observation, action = np.zeros((2, OBSERVATION_SIZE), np.float32), np.zeros((2, 12), np.float32)
    for _ in range(10):  # 0.1 s: a quarter of a cycle
        seen = features.update(observation, action)
    np.testing.assert_allclose(seen[:, OBSERVATION_SIZE:], [[1.0, 0.0]] * 2, atol=1e-6)


def test_correction_is_bounded_by_the_authority():
    base = np.tile(SIMPLE_QUAD.home_pose, (1, 1)).astype(np.float32)
    corrected = apply_correction(
        SIMPLE_QUAD, base, np.full((1, 12), 50.0, np.float32), authority_of(SIMPLE_QUAD, 0.15, 0.3)
    )
    np.testing.assert_allclose(corrected - base, [[0.15, 0.3, 0.3] * 4], atol=1e-6)
    halved = apply_correction(
        SIMPLE_QUAD, base, np.full((1, 12), -0.5, np.float32), authority_of(SIMPLE_QUAD, 0.15, 0.3)
    )
    np.testing.assert_allclose(halved - base, [[-0.075, -0.15, -0.15] * 4], atol=1e-6)


def test_a_lost_height_scan_looks_like_level_ground_and_a_step_as_high_as_it_is():
    base = policies.make("trot", height_scan=HeightScan(ahead=1, behind=0, aside=0))
    features, height = Features(base), base.robot.home_height
    features.reset(3)
    observation = np.zeros((3, OBSERVATION_SIZE + 2), np.float32)
    observation[:, OBSERVATION_SIZE:] = [[-height, -height], [UNSEEN, UNSEEN], [-height, 0.1 - height]]
    base.reset(3)
    seen = features.update(observation, base.act(observation))[:, OBSERVATION_SIZE : OBSERVATION_SIZE + 2]
    np.testing.assert_allclose(seen, 2.5 * np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.1]]), atol=1e-6)


def test_a_correction_is_held_for_its_control_steps_from_each_robot_s_own_start_on():
    """A correction is held for three steps; the second of two robots is reset after the fifth step."""
    rng = np.random.default_rng(4)
    weights = rng.normal(0.0, 0.2, (OBSERVATION_SIZE, 12)).astype(np.float32)
    network = Network((weights,), (np.zeros(12, np.float32),))
    policy = ResidualPolicy(policies.make("stand"), network, hold=3)
    policy.reset(2)
    assert not policy.correction.any()
    held = np.zeros((2, 12), np.float32)
    home = SIMPLE_QUAD.home_pose.astype(np.float32)
    for step in range(11):
        if step == 5:
            policy.reset_where(np.array([False, True]))
            assert not policy.correction[1].any()
            np.testing.assert_allclose(policy.correction[0], held[0], atol=1e-5)
        observation = rng.normal(0.0, 1.0, (2, OBSERVATION_SIZE)).astype(np.float32)
        action = policy.act(observation)
        due = np.array([step % 3 == 0, step % 3 == 0 if step < 5 else (step - 5) % 3 == 0])
        held = np.where(due[:, None], np.clip((observation * SCALE) @ weights, -1.0, 1.0), held)
        np.testing.assert_allclose(policy.correction, held, atol=1e-5)
        np.testing.assert_array_equal(policy.base_action, np.tile(home, (2, 1)))
        expected = apply_correction(SIMPLE_QUAD, np.tile(home, (2, 1)), policy.correction, policy.authority)
        np.testing.assert_array_equal(action, expected)


def test_a_hidden_clock_shows_where_the_command_is_to_move():
    features = Features(policies.make("stand"), Inputs(clock=2.5, clock_at_rest="hidden"))
    features.reset(2)
    features.clock_offset[:] = 0.0, 1.0
    seen = np.zeros((2, OBSERVATION_SIZE), np.float32)
    for command in (0.0, 0.5, 0.0, 0.5):
        seen[:, OBSERVATION["command"]] = command
        clock = features.update(seen, np.zeros((2, 12), np.float32))[:, -2:]
        phase = features.clock_phase
        expected = np.stack((np.sin(phase), np.cos(phase)), axis=1) if command else np.zeros((2, 2))
        np.testing.assert_allclose(clock, expected, atol=1e-6)
    np.testing.assert_allclose(phase, 2.0 * np.pi * 2.5 * 0.01 * 4 + np.array((0.0, 1.0)))


def test_a_clock_hurries_while_the_velocity_error_is_large():
    """The error of the first robot is 1.4 m/s, 1 m/s above the limit; the second robot has 0.3 m/s, the third NaN."""
    features = Features(policies.make("stand"), Inputs(clock=2.5, clock_gain=0.8, clock_limit=0.6))
    features.reset(3)
    seen = np.zeros((3, OBSERVATION_SIZE), np.float32)
    seen[:, OBSERVATION["command"]] = 0.6, -0.8, 0.5
    seen[:, OBSERVATION["linear_velocity"]] = [[-0.24, 0.32, 3.0], [0.6, -0.5, 0.0], [np.nan, 0.0, 0.0]]
    turns = np.zeros(3)
    for step in range(1, 30):
        clock = features.update(seen, np.zeros((3, 12), np.float32))[:, -2:]
        frequency = 2.5 + np.array([0.6 * (1.0 - 0.7**step), 0.0, 0.0])
        turns += 0.01 * frequency
        np.testing.assert_allclose(features.clock_frequency, frequency, atol=1e-6)
        expected = np.stack((np.sin(2.0 * np.pi * turns), np.cos(2.0 * np.pi * turns)), axis=1)
        np.testing.assert_allclose(clock, expected, atol=1e-5)


def test_the_position_error_is_the_integral_of_the_velocity_error_since_the_last_command():
    features = Features(policies.make("stand"), Inputs(position_error=0.05))
    features.reset(1)
    seen = np.zeros((1, OBSERVATION_SIZE), np.float32)
    seen[:, OBSERVATION["linear_velocity"]] = 0.2, 0.3, 9.0
    seen[:, OBSERVATION["angular_velocity"]] = 9.0, 9.0, -0.1
    for command, steps, expected in (
        ((0.7, 0.0, 0.4), 5, (0.02, -0.012, 0.02)),
        ((0.7, 0.0, 0.3), 40, (0.05, -0.05, 0.05)),
    ):
        seen[:, OBSERVATION["command"]] = command
        for _ in range(steps):
            shown = features.update(seen, np.zeros((1, 12), np.float32))[0, -3:]
        np.testing.assert_allclose(shown, expected, atol=1e-6)


def test_position_errors_of_robots_are_independent_and_an_unknown_velocity_counts_as_zero():
    """The command of the second robot changes after four steps; the velocity of the third robot is NaN."""
    features = Features(policies.make("stand"), Inputs(position_error=1.0))
    features.reset(3)
    seen = np.zeros((3, OBSERVATION_SIZE), np.float32)
    seen[:, OBSERVATION["command"]] = 0.5, 0.0, 0.0
    seen[:, OBSERVATION["linear_velocity"]] = [[0.1, 0.0, 0.0], [0.1, 0.0, 0.0], [np.nan, np.nan, 0.0]]
    for step in range(8):
        if step == 4:
            seen[1, OBSERVATION["command"]] = 0.2, 0.0, 0.0
        shown = features.update(seen, np.zeros((3, 12), np.float32))[:, -3:]
    # The first step of a command resets the position error, and the first command counts as a change.
    forward = 7 * 0.01 * 0.4, 3 * 0.01 * 0.1, 7 * 0.01 * 0.5
    np.testing.assert_allclose(shown, [(error, 0.0, 0.0) for error in forward], atol=1e-6)


def test_features_actions_and_states_of_an_earlier_step_stay_as_they_were():
    rng = np.random.default_rng(6)
    inputs = Inputs(lags=(0.02,), averages=(0.1,), clock=2.5, clock_gain=1.0, position_error=0.5)
    features, policy = Features(policies.make("stand"), inputs), policies.make("stand")
    network = Network((rng.normal(size=(features.width, 12)).astype(np.float32),), (np.zeros(12, np.float32),))
    residual = ResidualPolicy(policies.make("stand"), network, inputs=inputs)
    for each in (features, policy, residual):
        each.reset(2)
    earlier = []
    for _ in range(4):
        observation = rng.normal(size=(2, OBSERVATION_SIZE)).astype(np.float32)
        base_action = policy.act(observation)
        results = [
            base_action,
            features.update(observation, base_action),
            features.ticks,
            features.clock_offset,
            residual.act(observation),
            residual.correction,
        ]
        earlier += [(result, result.copy()) for result in results]
    for kept, then in earlier:
        np.testing.assert_array_equal(kept, then)


@pytest.mark.parametrize(("bounded", "share"), [(True, 1.0), (False, 1.5)])
def test_a_correction_is_clipped_only_with_bounds(bounded, share):
    home = np.tile(SIMPLE_QUAD.home_pose, (1, 1)).astype(np.float32)
    authority = np.full(12, 0.1, np.float32)
    found = apply_correction(SIMPLE_QUAD, home, np.full((1, 12), 1.5, np.float32), authority, bounded)
    np.testing.assert_allclose(found - home, 0.1 * share, atol=1e-6)
