import functools
import os
import signal
import sys
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import policies
from evaluate.commands.options import Options
from evaluate.commands.plan import check
from evaluate.measures.at_rest import Motion, controlled_stops
from policies.base import CONTROL_PERIOD, Policy
from policies.safety import DeadlineMissed, Mode, PolicyProcessError, Safe, SafetyLimits, Watched
from policies.safety.target_limits import limited
from quad_env import OBSERVATION, OBSERVATION_SIZE
from quad_env.actuation.models import Actuator, TorqueSpeed
from quad_env.columns import of_robots
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD


class Breaking(Policy):
    """The trot until a step, then something else."""

    name = "breaking"

    def __init__(self, broken, after=100):
        super().__init__()
        self._trot, self._broken, self._after = policies.make("trot"), broken, after

    def _allocate(self, num_envs):
        self.calls = 0
        self._trot.reset(num_envs)

    def _restart(self, mask):
        self._trot.reset_where(mask)

    def _act(self, observation):
        self.calls += 1
        action = self._trot.act(observation)
        return action if self.calls < self._after else self._broken(action)


def raising(_):
    raise ZeroDivisionError("planted")


def all_nan(action):
    return np.full_like(action, np.nan)


def nan_of_the_second(action):
    action[1, 3] = np.inf
    return action


def misshapen(action):
    return action[:, :6]


def drive(policy, steps=350, count=3, before_step=None):
    """Walk on flat ground; what the trunk and the joints did, and the largest torque."""
    env = SimpleQuadVectorEnv(count, nthread=1, autoreset_mode="DISABLED", terminate_on_fall=False)
    observation, _ = env.reset(seed=0, options={"command": (0.5, 0.0, 0.0)})
    policy.reset(count)
    rows, torque = [], 0.0
    for step in range(steps):
        if before_step is not None:
            before_step(step)
        observation, *_ = env.step(policy.act(observation))
        state = env.simulation.state(of_robots(np.zeros((count, 3))))
        torque = max(torque, np.abs(state.joint_torque).max())
        speed = np.abs(observation[:, OBSERVATION["joint_velocity"]]).max(axis=1)
        up = -observation[:, OBSERVATION["projected_gravity"]][:, 2]
        rows.append((np.asarray(state.height), up, np.asarray(state.vertical_velocity), speed))
    env.close()
    return Motion(*np.moveaxis(np.array(rows, dtype=np.float64), 1, 0)), torque


@pytest.mark.parametrize(
    ("broken", "reason"),
    [
        (raising, "policy raised an exception"),
        (all_nan, "policy returned non-finite targets"),
        (misshapen, "policy returned targets of a wrong shape or type"),
    ],
)
def test_failing_policy_ends_in_a_controlled_stop_with_its_reason_in_the_log(broken, reason):
    policy = Safe(Breaking(broken))
    trace, torque = drive(policy)
    assert controlled_stops(trace, np.full(3, 350), 0.01).all()
    assert torque <= SIMPLE_QUAD.rated_torque
    assert policy.mode.tolist() == [Mode.STOP] * 3
    events = policy.events()
    assert [(event.step, event.robot, event.mode, event.reason) for event in events] == [
        (100, robot, Mode.STOP, reason) for robot in range(3)
    ]
    assert ("planted" in "".join(policy.failures())) == (broken is raising)


def test_only_the_robot_whose_targets_are_not_finite_stops():
    policy = Safe(Breaking(nan_of_the_second))
    drive(policy, steps=130)
    assert policy.mode.tolist() == [Mode.FOLLOW, Mode.STOP, Mode.FOLLOW]


def test_the_same_faults_without_the_layer_reach_the_robot():
    with pytest.raises(ZeroDivisionError):
        drive(Breaking(raising))
    with pytest.raises(ValueError, match="finite"):
        drive(Breaking(all_nan))


def test_policy_that_hangs_is_answered_for_within_a_control_step_and_stopped():
    watched = Watched(functools.partial(policies.make, "trot"), deadline=5.0)
    policy = Safe(watched)

    def hang(step):
        if step == 100:
            os.kill(watched._process.pid, signal.SIGSTOP)

    try:
        trace, torque = drive(policy, before_step=hang)
    finally:
        watched.close()
    assert policy.events()[0].step == 101
    assert "DeadlineMissed" in policy.failures()[0]
    assert controlled_stops(trace, np.full(3, 350), 0.01).all()
    assert torque <= SIMPLE_QUAD.rated_torque


@pytest.mark.parametrize("robots", [1, 1024])  # the second's observations are more than a pipe holds
def test_deadline_is_kept_whatever_the_size_of_the_question(robots):
    with_deadline = Watched(functools.partial(policies.make, "stand"), deadline=3.0)
    with_deadline.reset(robots)
    try:
        observation = np.zeros((robots, OBSERVATION_SIZE), np.float32)
        assert with_deadline.act(observation).shape == (robots, 12)
        os.kill(with_deadline._process.pid, signal.SIGSTOP)
        began = time.perf_counter()
        with pytest.raises(DeadlineMissed, match="3000 ms"):
            with_deadline.act(observation)
        assert 3.0 <= time.perf_counter() - began < 30.0  # the upper bound is for a busy machine
        with pytest.raises(PolicyProcessError, match="reset"):
            with_deadline.act(observation)
        with_deadline.reset(robots)
        assert with_deadline.act(observation).shape == (robots, 12)
    finally:
        with_deadline.close()


def test_watched_policy_gives_the_bits_of_the_policy_and_its_exceptions_by_name():
    watched, plain = Watched(functools.partial(policies.make, "trot"), deadline=30.0), policies.make("trot")
    watched.reset(2), plain.reset(2)
    try:
        rows = np.random.default_rng(0).normal(size=(30, 2, OBSERVATION_SIZE)).astype(np.float32)
        for number, row in enumerate(rows):
            if number == 10:
                watched.reset_where(np.array([True, False])), plain.reset_where(np.array([True, False]))
            assert watched.act(row).tobytes() == plain.act(row).tobytes()
        with pytest.raises(PolicyProcessError, match="ValueError: observation must"):
            watched.ask(("act", np.zeros(3, np.float32)), 30.0)
    finally:
        watched.close()


def test_watched_process_that_dies_is_an_error_and_no_missed_deadline():
    watched = Watched(functools.partial(sys.exit, 3), deadline=30.0)
    with pytest.raises(PolicyProcessError, match="ended"):
        watched.reset(1)
    watched.close()


def test_emergency_stop_is_obeyed_by_the_next_action_and_until_a_reset():
    policy = Safe(policies.make("trot"))
    policy.reset(2)
    observation = np.zeros((2, OBSERVATION_SIZE), np.float32)
    observation[:, OBSERVATION["projected_gravity"]] = (0, 0, -1)
    for _ in range(20):
        policy.act(observation)
    policy.emergency_stop(np.array([True, False]), damp=True)
    action = policy.act(observation)
    np.testing.assert_allclose(action[0], SIMPLE_QUAD.home_pose, atol=1e-6)
    assert np.abs(action[1] - SIMPLE_QUAD.home_pose).max() > 0.01
    assert policy.events()[-1].reason == "emergency stop requested"
    for _ in range(5):
        policy.act(observation)
    assert policy.mode.tolist() == [Mode.DAMP, Mode.FOLLOW]
    policy.reset_where(np.array([True, False]))
    assert policy.mode.tolist() == [Mode.FOLLOW, Mode.FOLLOW]


def test_emergency_stop_of_a_walking_robot_is_a_controlled_stop():
    policy = Safe(policies.make("trot"))

    def stop(step):
        if step == 150:
            policy.emergency_stop()

    trace, _ = drive(policy, before_step=stop)
    assert controlled_stops(trace, np.full(3, 350), 0.01).all()


joint_rows = st.lists(st.floats(-3.0, 3.0), min_size=12, max_size=12)


@given(joint_rows, joint_rows, st.lists(st.floats(-15.0, 15.0), min_size=12, max_size=12), st.floats(20.0, 100.0))
def test_limited_targets_ask_for_no_torque_above_the_limit_and_stay_in_range(target, previous, speed, torque):
    joints = np.clip(np.array([previous]) * 0.3, SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper)
    speeds = np.array([speed])
    result = limited(
        SIMPLE_QUAD, CONTROL_PERIOD, np.array([target]), joints, joints, speeds, SafetyLimits(torque=torque)
    )
    asked = SIMPLE_QUAD.servo_stiffness * (result - joints) - SIMPLE_QUAD.servo_damping * speeds
    inside = (result > SIMPLE_QUAD.joint_lower) & (
        result < SIMPLE_QUAD.joint_upper
    )  # at a joint's end the range counts
    assert (np.abs(asked[inside]) <= torque + 1e-9).all()
    assert ((result >= SIMPLE_QUAD.joint_lower) & (result <= SIMPLE_QUAD.joint_upper)).all()


def test_the_limits_of_a_weaker_actuator_follow_its_torque_speed_line_and_its_delay():
    """By hand: 40 N·m and 10 rad/s leave a joint at 5 rad/s 20 N·m to drive it on and all 40 to brake it; 0.01 s on
    it has turned by 0.05 rad. A target is (torque + 10 · 5) / 300 from there."""
    limits = SafetyLimits.of(SIMPLE_QUAD, Actuator(TorqueSpeed(40.0, 10.0), delay=0.01))
    joints, speeds, far = np.zeros((1, 12)), np.full((1, 12), 5.0), np.full((1, 12), 2.0)
    thigh = (0, 1)
    assert limited(SIMPLE_QUAD, CONTROL_PERIOD, far, far, joints, speeds, limits)[thigh] == pytest.approx(
        0.05 + (20.0 + 50.0) / 300.0
    )
    assert limited(SIMPLE_QUAD, CONTROL_PERIOD, -far, -far, joints, speeds, limits)[thigh] == pytest.approx(
        0.05 + (-40.0 + 50.0) / 300.0
    )
    # Past the speed without load nothing drives the joint on.
    assert limited(SIMPLE_QUAD, CONTROL_PERIOD, far, far, joints, 3.0 * speeds, limits)[thigh] == pytest.approx(
        0.15 + (0.0 + 150.0) / 300.0
    )


def test_the_safety_layer_of_a_run_knows_the_actuator_of_its_robots(tmp_path):
    plan = check(Options(out=tmp_path, policies=("safe:trot",), actuator="torque_speed", scenarios=("flat",)))
    assert (
        plan.policies[0].policy._limits
        == SafetyLimits.of(SIMPLE_QUAD, "torque_speed")
        == SafetyLimits(100.0, no_load_speed=10.0)
    )
    assert SafetyLimits.of(SIMPLE_QUAD) == SafetyLimits(SIMPLE_QUAD.rated_torque)
    assert SafetyLimits.of(SIMPLE_QUAD, "motor").delay == 0.002


def test_targets_change_no_faster_than_the_limit_and_not_further_along_a_joint_that_is_too_fast():
    previous = joints = np.tile(SIMPLE_QUAD.home_pose, (1, 1))
    far, still = joints + 0.25, np.zeros((1, 12))
    limits = SafetyLimits(torque=1e6, target_rate=10.0, joint_speed=5.0)
    np.testing.assert_allclose(limited(SIMPLE_QUAD, CONTROL_PERIOD, far, previous, joints, still, limits) - joints, 0.1)
    fast = np.full((1, 12), 6.0)
    np.testing.assert_allclose(limited(SIMPLE_QUAD, CONTROL_PERIOD, far, previous, joints, fast, limits), joints)
    np.testing.assert_allclose(limited(SIMPLE_QUAD, CONTROL_PERIOD, far, previous, joints, -fast, limits) - joints, 0.1)


def test_undisturbed_trot_passes_the_layer_unchanged():
    plain, safe = policies.make("trot"), policies.make("safe:trot")
    env = SimpleQuadVectorEnv(4, nthread=1)
    observation, _ = env.reset(seed=3)
    plain.reset(4), safe.reset(4)
    for _ in range(300):
        action = safe.act(observation)
        np.testing.assert_allclose(action, plain.act(observation), atol=1e-6)
        observation, *_ = env.step(action)
    env.close()
    assert not safe.events()


def test_wrong_masks_and_settings_are_refused():
    policy = Safe(policies.make("trot"))
    policy.reset(2)
    with pytest.raises(ValueError, match="mask"):
        policy.emergency_stop(np.array([True]))
    with pytest.raises(ValueError, match="positive"):
        SafetyLimits(torque=0.0)
    with pytest.raises(policies.PolicyError, match="gallop"):
        policies.make("safe:gallop")
    assert policies.resolve("safe:stand").name == "safe:stand"
