import numpy as np
import pytest

import policies
from policies.history import Remembered
from policies.network import Network
from policies.residual import Features, ResidualPolicy, authority_of, compose
from quad_env import OBSERVATION, OBSERVATION_SIZE
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.task.observations import observation_table

SCALE = observation_table(SIMPLE_QUAD).scale


def constant_network(inputs, output):
    """A network that answers the same, whatever it sees."""
    return Network((np.zeros((inputs, 12), np.float32),), (np.broadcast_to(np.float32(output), 12).copy(),))


@pytest.mark.parametrize("n", [1, 3, 64])
@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_zero_correction_is_the_trot_bit_for_bit_over_1000_steps(n, zero):
    rng = np.random.default_rng(n)
    residual, trot = ResidualPolicy(policies.make("trot"), constant_network(62, zero)), policies.make("trot")
    residual.reset(n), trot.reset(n)
    observation = rng.normal(size=(n, OBSERVATION_SIZE)).astype(np.float32)
    for step in range(1000):
        if step % 200 == 0:
            observation[:, OBSERVATION["command"]] = rng.uniform([-1.0, -0.8, -1.2], [1.5, 0.8, 1.2], (n, 3))
        if step == 500:
            mask = rng.random(n) < 0.5
            residual.reset_where(mask), trot.reset_where(mask)
        assert residual.act(observation).tobytes() == trot.act(observation).tobytes()
        assert residual.phase.tobytes() == trot.phase.tobytes()


class _AtPhases(policies.Trot):
    """A trot whose clocks stand at the start of a stride and at a quarter of it."""

    phase = np.array([0.0, np.pi / 2])


def test_features_by_hand_over_a_gaited_base():
    observation = np.ones((2, OBSERVATION_SIZE), np.float32)
    base_action = np.tile(SIMPLE_QUAD.home_pose, (2, 1)).astype(np.float32) + np.float32(0.25)
    seen = Features(_AtPhases()).see(observation, base_action)
    assert seen.dtype == np.float32
    assert seen.shape == (2, OBSERVATION_SIZE + 14)
    np.testing.assert_array_equal(seen[:, :OBSERVATION_SIZE], np.tile(SCALE, (2, 1)))
    np.testing.assert_allclose(seen[:, OBSERVATION_SIZE : OBSERVATION_SIZE + 2], [[0.0, 1.0], [1.0, 0.0]], atol=1e-7)
    np.testing.assert_allclose(seen[:, OBSERVATION_SIZE + 2 :], 0.25)


def test_features_over_a_base_without_a_clock_are_the_observation_alone():
    observation = np.full((3, OBSERVATION_SIZE), 2.0, np.float32)
    seen = Features(policies.make("stand")).see(observation, np.zeros((3, 12), np.float32))
    np.testing.assert_array_equal(seen, 2.0 * np.tile(SCALE, (3, 1)))


def test_what_is_remembered_comes_last_and_a_restarted_robot_remembers_nothing():
    features = Features(policies.make("stand"), Remembered(lags=(0.02,), averages=(0.1,)))
    features.reset(2)
    action = np.zeros((2, 12), np.float32)
    for value in (1.0, 2.0, 3.0):
        seen = features.see(np.full((2, OBSERVATION_SIZE), value, np.float32), action)
    share = 1.0 - np.exp(-0.1)
    average = 1.0 + share * (2.0 - 1.0)
    average += share * (3.0 - average)
    np.testing.assert_allclose(seen, np.tile(np.concatenate((3.0 * SCALE, SCALE, average * SCALE)), (2, 1)), rtol=1e-6)
    features.reset_where(np.array([True, False]))
    seen = features.see(np.full((2, OBSERVATION_SIZE), 4.0, np.float32), action)
    np.testing.assert_array_equal(seen[0], np.tile(4.0 * SCALE, 3))
    np.testing.assert_array_equal(seen[1, OBSERVATION_SIZE : 2 * OBSERVATION_SIZE], 2.0 * SCALE)


def test_times_that_cannot_be_remembered_are_refused():
    for wrong in (0.0, -1.0, 11.0, float("nan")):
        with pytest.raises(ValueError, match="above 0 s"):
            Remembered(lags=(wrong,))
        with pytest.raises(ValueError, match="above 0 s"):
            Remembered(averages=(wrong,))


def test_correction_is_bounded_by_the_authority():
    base = np.tile(SIMPLE_QUAD.home_pose, (1, 1)).astype(np.float32)
    corrected = compose(SIMPLE_QUAD, base, np.full((1, 12), 50.0, np.float32), authority_of(SIMPLE_QUAD))
    np.testing.assert_allclose(corrected - base, [[0.15, 0.3, 0.3] * 4], atol=1e-6)
    halved = compose(SIMPLE_QUAD, base, np.full((1, 12), -0.5, np.float32), authority_of(SIMPLE_QUAD))
    np.testing.assert_allclose(halved - base, [[-0.075, -0.15, -0.15] * 4], atol=1e-6)


def test_corrected_action_stays_within_the_joint_limits():
    base = np.stack([SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper]).astype(np.float32)
    outward = np.stack([-np.ones(12), np.ones(12)]).astype(np.float32)
    np.testing.assert_array_equal(compose(SIMPLE_QUAD, base, outward, authority_of(SIMPLE_QUAD)), base)


def test_residual_over_stand_has_no_phase_and_needs_no_clock_inputs():
    policy = ResidualPolicy(policies.make("stand"), constant_network(OBSERVATION_SIZE, 1.0))
    assert policy.phase is None
    action = policy.act(np.zeros(OBSERVATION_SIZE, np.float32))
    np.testing.assert_allclose(action, SIMPLE_QUAD.home_pose + [0.15, 0.3, 0.3] * 4, atol=1e-6)


def test_network_of_the_wrong_width_is_refused():
    with pytest.raises(ValueError, match="62 inputs"):
        ResidualPolicy(policies.make("trot"), constant_network(OBSERVATION_SIZE, 0.0))
