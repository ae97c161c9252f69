from dataclasses import replace

import numpy as np
import pytest

import policies
from policies.base import CONTROL_PERIOD, Policy
from policies.behaviour.transitions import TOPPLING_TILT
from policies.safety import Mode, Safe, SafetyLimits
from policies.safety.brace import RELEASE_TIME, REST_TIME, brace_targets
from policies.safety.layer import MAX_TILT, RECENT_TIME, RESPONSE_TIME, velocity_deviation
from quad_env import OBSERVATION
from quad_env.config import FallRule
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import AXES
from quad_env.seeding import episode_seeds
from tests.policies.readings import feet, reading


class Noting(Policy):
    """Policy with straight legs that records its commands."""

    name = "noting"

    def _allocate(self, num_envs):
        self.notes = []

    def _act(self, observation):
        self.notes.append(observation[:, OBSERVATION["command"]].copy())
        return np.zeros((len(observation), 12), np.float32)


def moving(velocity=(0.0, 0.0, 0.0), command=(0.0, 0.0, 0.0), up=(0, 0, 1), turning=(0.0, 0.0, 0.0)):
    motion = {"linear_velocity": velocity, "angular_velocity": turning}
    return reading(1, projected_gravity=np.negative(up), command=command, **motion)


PUSHED = (0.0, 2.0, 0.0)


def test_predicted_fall_is_braced_for_until_the_robot_is_at_rest_and_then_blended_back_to_the_policy():
    noting = Noting()
    policy = Safe(noting, SafetyLimits(torque=1e6, target_rate=1e6, joint_speed=1e6))
    policy.reset(1)
    policy.act(moving(command=(0.5, 0.0, 1.0)))
    wide = policy.act(moving(PUSHED, command=(0.5, 0.0, 1.0)))
    np.testing.assert_allclose(wide, brace_targets(SIMPLE_QUAD, moving(PUSHED)), atol=1e-6)
    assert (policy.mode[0], policy.reason[0]) == (Mode.CATCH, "fall predicted")
    assert not noting.notes[-1].any()
    for _ in range(50):
        action = policy.act(moving(PUSHED, command=(0.5, 0.0, 1.0)))
    np.testing.assert_array_equal(action, wide)
    distance, commanded = [], []
    while policy.mode[0] == Mode.CATCH:
        action = policy.act(moving(command=(0.5, 0.0, 1.0)))
        distance.append(np.abs(action - wide).max())
        commanded.append(noting.notes[-1][0, 0])
    assert len(distance) * CONTROL_PERIOD == pytest.approx(REST_TIME + RELEASE_TIME, abs=CONTROL_PERIOD)
    assert (np.diff(distance) >= 0.0).all()
    assert (np.diff(commanded) >= 0.0).all()
    assert distance[0] < 1e-6 < distance[-1]
    np.testing.assert_array_equal(action, 0.0)
    assert policy.reason[0] == "at rest again"


def test_push_while_getting_up_is_braced_for_again():
    policy = Safe(Noting())
    policy.reset(1)
    policy.act(moving(PUSHED))
    for _ in range(round((REST_TIME + RELEASE_TIME / 2.0) / CONTROL_PERIOD)):
        policy.act(moving())
    assert 0.0 < policy._brace.share[0] < 1.0
    policy.act(moving(PUSHED))
    assert policy._brace.share[0] == 1.0
    assert policy.mode[0] == Mode.CATCH


def test_a_later_fall_is_braced_for_wholly_though_the_robot_came_to_rest_before():
    """A robot that runs against an obstacle is slow at once, but far from its recent mean velocity."""
    policy = Safe(Noting())
    policy.reset(1)
    policy.act(moving(PUSHED))
    while policy.mode[0] == Mode.CATCH:
        policy.act(moving())
    for speed in np.linspace(0.0, 2.0, 300):
        policy.act(moving((speed, 0.0, 0.0), command=(speed, 0.0, 0.0)))
    assert policy.mode[0] == Mode.FOLLOW
    policy.act(moving(command=(2.0, 0.0, 0.0)))
    assert (policy.mode[0], policy._brace.share[0]) == (Mode.CATCH, 1.0)


@pytest.mark.parametrize("state", [{"velocity": (0.7, 0, 0)}, {"turning": (0, 2.0, 0)}, {"up": (0.6, 0, 0.8)}])
def test_robot_that_moves_turns_or_leans_stays_braced(state):
    policy = Safe(Noting())
    policy.reset(1)
    policy.act(moving(PUSHED))
    for _ in range(100):
        policy.act(moving(**state))
    assert policy.mode[0] == Mode.CATCH


def test_robot_that_is_too_far_over_is_the_policys_again():
    policy = Safe(Noting())
    policy.reset(1)
    for up in ((0, 0, 1), (1, 0, 0), (1, 0, 0)):
        policy.act(moving(PUSHED, up=up))
    assert (policy.mode[0], policy.reason[0]) == (Mode.FOLLOW, "too far over")
    policy.act(moving(np.negative(PUSHED), up=(1, 0, 0)))
    assert policy.mode[0] == Mode.FOLLOW


def test_brace_is_wide_and_low_and_lets_the_side_down_that_rises():
    turning = ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.5, 0.0))
    level, rolling, pitching = (feet(brace_targets(SIMPLE_QUAD, moving(turning=rates)))[0] for rates in turning)
    home = feet(SIMPLE_QUAD.home_pose)
    assert (np.abs(level[:, 1]) > np.abs(home[:, 1])).all()
    assert (level[:, 2] > home[:, 2]).all()
    assert (np.sign(rolling - level)[:, 2] == SIMPLE_QUAD.side).all()  # a positive roll lifts the left side
    nose_down = -np.sign(SIMPLE_QUAD.hip_positions[:, 0])  # a positive pitch lowers the nose
    assert (np.sign(pitching - level)[:, 2] == nose_down).all()


def test_pushed_robots_have_the_bits_of_a_batch_while_they_are_caught():
    pushed = AXES["push"].scenario(65.0, "push")
    where = replace(pushed, pushes=replace(pushed.pushes, count=1, window=(0.3, 0.6)))
    env = SimpleQuadVectorEnv(3, where, nthread=1, autoreset_mode="DISABLED")
    together, alone = policies.make("safe:trot"), [policies.make("safe:trot") for _ in range(3)]
    observation, _ = env.reset(seed=episode_seeds("search", 0, 3).tolist())
    together.reset(3)
    reasons = set()
    for _ in range(180):
        action = together.act(observation)
        reasons.update(together.reason)
        rows = [policy.act(row) for policy, row in zip(alone, observation, strict=True)]
        assert action.tobytes() == np.stack(rows).tobytes()
        observation, *_ = env.step(action)
    env.close()
    assert reasons >= {"fall predicted", "at rest again"}


def test_velocity_deviation_is_the_lesser_of_the_speeds_off_the_reference_and_off_the_velocity_of_late():
    velocity = np.array([[4.0, 5.0]])
    near, far = np.array([[1.0, 1.0]]), np.array([[-50.0, 0.0]])
    np.testing.assert_allclose(velocity_deviation(velocity, near, far), [5.0])
    np.testing.assert_allclose(velocity_deviation(velocity, far, near), [5.0])


def test_slow_change_or_change_of_command_is_no_alarm():
    policy = Safe(Noting())
    policy.reset(1)
    for step in range(100):
        policy.act(moving((0.02 * step, 0.0, 0.0)))
    for _ in range(50):
        policy.act(moving((2.0, 0.0, 0.0), command=(-1.0, 0.0, 0.0)))
    assert policy.mode[0] == Mode.FOLLOW


def test_reference_lags_the_command_and_the_velocity_of_late_the_robots_by_their_times():
    policy = Safe(Noting())
    for name, time, seen in (
        ("_reference", RESPONSE_TIME, {"command": (1.0, -2.0, 0.0)}),
        ("_recent_velocity", RECENT_TIME, {"velocity": (1.0, -2.0, 0.0)}),
    ):
        policy.reset(1)
        for _ in range(round(time / CONTROL_PERIOD)):
            policy.act(moving(**seen))
        np.testing.assert_allclose(getattr(policy, name), [[1 - np.exp(-1), -2 * (1 - np.exp(-1))]], rtol=0.05)


def test_behaviour_and_safety_layer_give_a_robot_up_before_the_fall_rule_calls_it_fallen():
    assert TOPPLING_TILT < MAX_TILT < FallRule().tilt
