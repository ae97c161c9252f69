import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import policies
from evaluate.commands.options import EvaluateOptions
from evaluate.commands.plan import check
from evaluate.measures.at_rest import controlled_stops
from policies.base import CONTROL_PERIOD
from policies.safety import Mode, Safe, SafetyLimits
from quad_env import OBSERVATION
from quad_env.actuation.models import Actuator, TorqueSpeed
from quad_env.columns import to_components
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.evaluate.measures.uneventful import uneventful
from tests.policies.readings import reading

BROKEN, STEPS = 60, 300


class Breaking(policies.Trot):
    """The trot up to a step, then a given replacement."""

    def __init__(self, broken):
        super().__init__()
        self.broken, self.calls = broken, 0

    def _act(self, observation):
        self.calls += 1
        action = super()._act(observation)
        return action if self.calls < BROKEN else self.broken(action)


def raising(_):
    raise ZeroDivisionError("planted")


def not_finite_of_the_second(action):
    action[1, 3] = np.inf
    return action


def misshapen(action):
    return action[:, :6]


def drive(policy, steps=STEPS, count=3, before_step=None):
    """Walk on flat ground, and return the motion of trunk and joints, and the largest torque."""
    env = SimpleQuadVectorEnv(count, nthread=1, autoreset_mode="DISABLED", terminate_on_fall=False)
    observation, _ = env.reset(seed=0, options={"command": (0.5, 0.0, 0.0)})
    policy.reset(count)
    rows, torque = [], 0.0
    for step in range(steps):
        if before_step is not None:
            before_step(step)
        observation, *_ = env.step(policy.act(observation))
        state = env.simulation.state(to_components(np.zeros((count, 3))))
        torque = max(torque, np.abs(state.joint_torque).max())
        tilt = np.arccos(np.clip(-observation[:, OBSERVATION["projected_gravity"]][:, 2], -1.0, 1.0))
        rows.append((np.asarray(state.height), tilt, observation[:, OBSERVATION["joint_velocity"]]))
    env.close()
    height, tilt, speed = map(np.array, zip(*rows, strict=True))
    position = np.repeat(height[..., None], 3, axis=-1)  # on flat ground
    changes = {"height": height, "tilt": tilt, "joint_velocity": speed, "position": position}
    return uneventful(SIMPLE_QUAD, steps, count, **changes), torque


@pytest.mark.parametrize(
    ("broken", "reason", "robots"),
    [
        (raising, "policy raised ZeroDivisionError: planted", [0, 1, 2]),
        (misshapen, "policy returned targets of a wrong shape or type", [0, 1, 2]),
        (not_finite_of_the_second, "policy returned non-finite targets", [1]),
    ],
)
def test_failing_policy_ends_in_a_controlled_stop_of_its_robots_with_its_reason_in_the_log(broken, reason, robots):
    policy = Safe(Breaking(broken))
    episodes, torque = drive(policy)
    assert controlled_stops(episodes)[robots].all()
    assert torque <= SIMPLE_QUAD.rated_torque
    assert np.flatnonzero(policy.mode == Mode.STOP).tolist() == robots
    assert policy.reason.tolist() == [reason if robot in robots else "" for robot in range(3)]


def test_emergency_stop_of_a_walking_robot_is_a_controlled_stop_until_a_reset_or_damps_its_joints():
    policy = Safe(policies.make("trot"))

    def stop(step):
        if step == BROKEN:
            policy.emergency_stop()

    episodes, _ = drive(policy, before_step=stop)
    assert controlled_stops(episodes).all()
    assert policy.reason.tolist() == ["emergency stop requested"] * 3
    policy.reset_where(np.array([True, False, False]))
    assert policy.mode.tolist() == [Mode.FOLLOW, Mode.STOP, Mode.STOP]
    policy.emergency_stop(np.array([True, False, False]), damp=True)
    np.testing.assert_allclose(policy.act(reading(3))[0], SIMPLE_QUAD.home_pose, atol=1e-6)
    assert policy.mode[0] == Mode.DAMP


joint_rows = st.lists(st.floats(-3.0, 3.0), min_size=12, max_size=12)


@given(joint_rows, joint_rows, st.lists(st.floats(-15.0, 15.0), min_size=12, max_size=12), st.floats(20.0, 100.0))
def test_limited_targets_ask_for_no_torque_above_the_limit_and_stay_in_range(target, previous, speed, torque):
    joints = np.clip(np.array([previous]) * 0.3, SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper)
    speeds = np.array([speed])
    limits = SafetyLimits(torque=torque)
    result = limits.limit_targets(SIMPLE_QUAD, CONTROL_PERIOD, np.array([target]), joints, joints, speeds)
    asked = SIMPLE_QUAD.servo_stiffness * (result - joints) - SIMPLE_QUAD.servo_damping * speeds
    # The range limits the target at the end of the joint.
    inside = (result > SIMPLE_QUAD.joint_lower) & (result < SIMPLE_QUAD.joint_upper)
    assert (np.abs(asked[inside]) <= torque + 1e-9).all()
    assert ((result >= SIMPLE_QUAD.joint_lower) & (result <= SIMPLE_QUAD.joint_upper)).all()


def test_the_limits_of_a_weaker_actuator_follow_its_torque_speed_line_and_its_delay():
    """A motor of 40 N·m and 10 rad/s gives 20 N·m forward and 40 N·m for braking at a joint speed of 5 rad/s.

    The joint rotates by 0.05 rad in the delay of 0.01 s. The limit of the target is (torque + 10 · 5) / 300 from there.
    """
    limits = SafetyLimits.for_robot(SIMPLE_QUAD, Actuator(TorqueSpeed(40.0, 10.0), delay=0.01))
    joints, speeds, far = np.zeros((1, 12)), np.full((1, 12), 5.0), np.full((1, 12), 2.0)
    thigh = (0, 1)
    assert limits.limit_targets(SIMPLE_QUAD, CONTROL_PERIOD, far, far, joints, speeds)[thigh] == pytest.approx(
        0.05 + (20.0 + 50.0) / 300.0
    )
    assert limits.limit_targets(SIMPLE_QUAD, CONTROL_PERIOD, -far, -far, joints, speeds)[thigh] == pytest.approx(
        0.05 + (-40.0 + 50.0) / 300.0
    )
    # Beyond the no-load speed the motor gives no forward torque.
    assert limits.limit_targets(SIMPLE_QUAD, CONTROL_PERIOD, far, far, joints, 3.0 * speeds)[thigh] == pytest.approx(
        0.15 + (0.0 + 150.0) / 300.0
    )


def test_the_safety_layer_of_a_run_knows_the_actuator_of_its_robots(tmp_path):
    plan = check(EvaluateOptions(out=tmp_path, policies=("safe:trot",), actuator="torque_speed", scenarios=("flat",)))
    limits = plan.policies[0].policy._limits
    assert (np.unique(limits.torque), np.unique(limits.no_load_speed), limits.delay) == (100.0, 10.0, 0.0)
    assert SafetyLimits.of(SIMPLE_QUAD) == SafetyLimits(SIMPLE_QUAD.rated_torque)
    assert SafetyLimits.for_robot(SIMPLE_QUAD, "motor").delay == 0.002


def test_targets_change_no_faster_than_the_limit_and_not_further_along_a_joint_that_is_too_fast():
    previous = joints = np.tile(SIMPLE_QUAD.home_pose, (1, 1))
    far, still = joints + 0.25, np.zeros((1, 12))
    limits = SafetyLimits(torque=1e6, target_rate=10.0, joint_speed=5.0)
    np.testing.assert_allclose(
        limits.limit_targets(SIMPLE_QUAD, CONTROL_PERIOD, far, previous, joints, still) - joints, 0.1
    )
    fast = np.full((1, 12), 6.0)
    np.testing.assert_allclose(limits.limit_targets(SIMPLE_QUAD, CONTROL_PERIOD, far, previous, joints, fast), joints)
    np.testing.assert_allclose(
        limits.limit_targets(SIMPLE_QUAD, CONTROL_PERIOD, far, previous, joints, -fast) - joints, 0.1
    )


def test_undisturbed_trot_passes_the_layer_unchanged():
    plain, safe = policies.make("trot"), policies.make("safe:trot")
    env = SimpleQuadVectorEnv(4, nthread=1)
    observation, _ = env.reset(seed=3)
    plain.reset(4), safe.reset(4)
    for _ in range(150):
        action = safe.act(observation)
        np.testing.assert_allclose(action, plain.act(observation), atol=1e-6)
        observation, *_ = env.step(action)
    env.close()
    assert not safe.reason.any()


def test_wrong_masks_and_settings_are_refused():
    policy = Safe(policies.make("trot"))
    policy.reset(2)
    with pytest.raises(ValueError, match="mask"):
        policy.emergency_stop(np.array([True]))
    with pytest.raises(ValueError, match="more than 0"):
        SafetyLimits(torque=0.0)
    with pytest.raises(policies.PolicyError, match="gallop"):
        policies.make("safe:gallop")
    assert policies.resolve("safe:stand").name == "safe:stand"
