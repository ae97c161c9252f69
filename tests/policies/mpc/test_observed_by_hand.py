"""Servo torques, predicted readings, and recorded targets and contacts, by hand."""

import numpy as np
import pytest

from policies.contact.motion_state import compute_motion_state
from policies.contact.servo_model import ServoModel
from policies.mpc.joint_predictor import JointPredictor
from policies.mpc.observer import DelayCompensator
from policies.mpc.reading_noise import NoiseEstimator
from policies.mpc.readings import predict_readings
from policies.mpc.servo_step import _integrate, predict_landing
from policies.mpc.state_filter import StateFilter
from quad_env import OBSERVATION
from quad_env.actuation.models import IDEAL, Actuator, TorqueSpeed
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.policies.readings import reading

PERIOD = 0.01
DYNAMICS = Dynamics(SIMPLE_QUAD)
MOTOR = Actuator(TorqueSpeed(stall_torque=100.0, no_load_speed=10.0, peak_torque=80.0), delay=0.006)


def test_servos_give_a_spring_s_and_a_damper_s_torque_within_what_motors_give_at_their_speed() -> None:
    """The torque is 300 · 0.1 - 10 · 2 = 10 N·m.

    300 · 0.5 - 80 = 70 N·m at 8 rad/s is limited to 20 N·m, and at -8 rad/s to 80 N·m.
    """
    servos = ServoModel(SIMPLE_QUAD, MOTOR, PERIOD)
    speed = np.tile([2.0, 8.0, -8.0], 4)[None]
    targets = np.tile([0.1, 0.5, 0.5], 4)[None]
    np.testing.assert_allclose(servos.torque(targets, np.zeros((1, 12)), speed)[0, :3], [10.0, 20.0, 80.0])
    ideal = ServoModel(SIMPLE_QUAD, IDEAL, PERIOD)
    np.testing.assert_allclose(ideal.torque(targets, np.zeros((1, 12)), speed)[0, :3], [10.0, 70.0, 100.0])


def test_late_motors_go_by_the_targets_of_two_control_periods() -> None:
    """With 6 ms of delay, 0.4 of a period follows the present target and 0.6 the previous one; the newest is first."""
    targets = np.array([3.0, 2.0, 7.0])[:, None, None] * np.ones((1, 2, 12))
    found = ServoModel(SIMPLE_QUAD, MOTOR, PERIOD).filtered_targets(targets)
    np.testing.assert_allclose(found[:, 1, 5], [0.4 * 3.0 + 0.6 * 2.0, 0.4 * 2.0 + 0.6 * 7.0])
    np.testing.assert_array_equal(ServoModel(SIMPLE_QUAD, IDEAL, PERIOD).filtered_targets(targets), targets)


def test_feet_that_come_down_to_the_ground_stay_there_and_each_robot_s_own() -> None:
    """A robot falls at 1 m/s: feet 5 mm above the ground stop on it, feet 50 mm above it continue to fall."""
    rows = reading(2, linear_velocity=(0.0, 0.0, -1.0))
    now, targets = compute_motion_state(SIMPLE_QUAD, DYNAMICS, rows), np.tile(SIMPLE_QUAD.home_pose, (2, 1))
    targets[1] += 0.02
    wrench = np.array([[0.0] * 6, [20.0, -10.0, 5.0, 0.0, 1.0, 0.0]])
    gaps = np.array([[0.05] * 4, [0.005, 0.05, 0.05, 0.005]])
    velocity = predict_landing(SIMPLE_QUAD, now, gaps, targets, wrench, PERIOD)
    feet = np.matmul(now.bodies.jacobians, velocity[:, None, :, None])[..., 2, 0]
    np.testing.assert_allclose(feet[0], -1.0 - 9.81 * PERIOD, atol=0.05)
    np.testing.assert_allclose(feet[1, [0, 3]], -0.5, atol=0.02)  # 5 mm in 10 ms
    assert (feet[1, [1, 2]] < -0.7).all()
    alone = predict_landing(
        SIMPLE_QUAD, compute_motion_state(SIMPLE_QUAD, DYNAMICS, rows[1:]), gaps[1:], targets[1:], wrench[1:], PERIOD
    )
    np.testing.assert_array_equal(velocity[1], alone[0])


def test_a_foot_does_not_come_down_to_the_ground_faster_than_half_a_metre_a_second_and_never_pulls() -> None:
    rows = reading(1, linear_velocity=(0.0, 0.0, -3.0))
    now, targets = compute_motion_state(SIMPLE_QUAD, DYNAMICS, rows), SIMPLE_QUAD.home_pose[None]
    down = predict_landing(SIMPLE_QUAD, now, np.full((1, 4), 0.02), targets, np.zeros((1, 6)), PERIOD)
    feet = np.matmul(now.bodies.jacobians, down[:, None, :, None])[0, :, 2, 0]
    np.testing.assert_allclose(feet, -0.5, atol=0.02)
    rising = compute_motion_state(SIMPLE_QUAD, DYNAMICS, reading(1, linear_velocity=(0.0, 0.0, 2.0)))
    up = predict_landing(SIMPLE_QUAD, rising, np.zeros((1, 4)), targets, np.zeros((1, 6)), PERIOD)
    assert (np.matmul(rising.bodies.jacobians, up[:, None, :, None])[0, :, 2, 0] > 1.0).all()


def test_a_foot_that_the_ground_would_have_to_pull_is_let_go() -> None:
    """Robots move fast: held feet with a downward impulse rise, and the other feet rest."""
    random, let_go = np.random.default_rng(0), 0
    for _ in range(20):
        readings = {"linear_velocity": random.normal(0.0, 1.0, 3), "angular_velocity": random.normal(0.0, 3.0, 3)}
        now = compute_motion_state(
            SIMPLE_QUAD, DYNAMICS, reading(1, joint_velocity=random.normal(0.0, 5.0, 12), **readings)
        )
        targets, still = SIMPLE_QUAD.home_pose[None], np.zeros((1, 6))
        free = predict_landing(SIMPLE_QUAD, now, np.full((1, 4), 9.0), targets, still, PERIOD)
        down = np.matmul(now.bodies.jacobians, free[:, None, :, None])[..., 2, 0] < 0.0
        stopped, impulses = _integrate(SIMPLE_QUAD, now, down, still, PERIOD, targets[..., None], np.zeros((1, 4)))
        sinks = np.matmul(now.bodies.jacobians[:, :, 2], stopped)[..., 0] < 0.0
        pulled = down & (impulses[:, 2::3] <= 0.0)
        found = predict_landing(SIMPLE_QUAD, now, np.zeros((1, 4)), targets, still, PERIOD)
        held = np.where(down, ~pulled, sinks)
        by_hand = _integrate(SIMPLE_QUAD, now, held, still, PERIOD, targets[..., None], np.zeros((1, 4)))[0][..., 0]
        np.testing.assert_array_equal(found, by_hand)
        let_go += int(pulled.sum())
    assert let_go > 5


def test_a_push_on_the_trunk_is_in_the_motion_ahead() -> None:
    """A force of 142 N accelerates 14.2 kg in the air for 10 ms, ahead and up; gravity cancels the upward part."""
    now, targets = compute_motion_state(SIMPLE_QUAD, DYNAMICS, reading(1)), SIMPLE_QUAD.home_pose[None]
    wrench = np.array([[142.0, 0.0, 142.0, 0.0, 0.0, 0.0]])
    free, pushed = (
        predict_landing(SIMPLE_QUAD, now, np.full((1, 4), 1.0), targets, each, PERIOD)
        for each in (0.0 * wrench, wrench)
    )
    whole = now.bodies.inertia[0, :3, :3] / SIMPLE_QUAD.mass
    np.testing.assert_allclose(whole, np.eye(3), atol=1e-9)
    momentum = now.bodies.inertia[0, :3] @ (pushed - free)[0]
    np.testing.assert_allclose(momentum, [1.42, 0.0, 1.42], atol=0.02)
    np.testing.assert_allclose(now.bodies.inertia[0, :3] @ free[0], [0.0, 0.0, -1.393], atol=0.02)


def test_readings_a_control_period_later_are_in_the_axes_that_have_turned() -> None:
    """At 1 rad/s nose down, gravity moves to the nose and 0.5 m/s ahead gets an upward part; joints advance."""
    speeds = np.linspace(-2.0, 2.0, 12)
    now = compute_motion_state(
        SIMPLE_QUAD, DYNAMICS, reading(1, angular_velocity=(0.0, 1.0, 0.0), joint_velocity=speeds)
    )
    velocity = np.concatenate(([0.5, 0.0, 0.0], [0.0, 1.0, 0.0], 3.0 * speeds))[None]
    found = predict_readings(SIMPLE_QUAD, now, velocity, PERIOD)[0]
    np.testing.assert_allclose(found[OBSERVATION["projected_gravity"]], [0.01, 0.0, -1.0], atol=1e-4)
    np.testing.assert_allclose(found[OBSERVATION["linear_velocity"]], [0.5, 0.0, 0.005], atol=1e-9)
    np.testing.assert_allclose(found[OBSERVATION["angular_velocity"]], [0.0, 1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(found[OBSERVATION["joint_position"]], PERIOD * 2.0 * speeds, atol=1e-6)
    np.testing.assert_allclose(found[OBSERVATION["joint_velocity"]], 3.0 * speeds, atol=1e-6)


def test_what_each_robot_was_asked_for_and_stood_on_is_that_of_its_own_delay() -> None:
    observer = DelayCompensator(SIMPLE_QUAD, DYNAMICS, PERIOD)
    observer.reset(2)
    for step in range(5):
        rows = reading(2, previous_action=0.1 * step)
        found = observer.read(rows, np.zeros((2, 6)))
        if step == 3:
            observer.delay_estimator.delays = np.array([0, 2])
        observer.calibration.is_active[:] = False
        observer.record_stance(np.array([[True, True, True, step % 2 == 0]] * 2))
    targets = found.targets - SIMPLE_QUAD.home_pose
    np.testing.assert_allclose(targets[:, 0], [0.4, 0.2], atol=1e-6)
    assert observer._stance[:3, 0, 3].tolist() == [True, False, True]
    assert observer.delay_estimator.at_delay(observer._stance)[:, 3].tolist() == [True, True]
    observer.calibration.is_active[:] = True, False
    observer.record_stance(np.zeros((2, 4), np.bool_))
    assert observer._stance[0].all(axis=1).tolist() == [True, False]


def test_a_robot_that_listens_stands_and_then_bends_its_legs() -> None:
    observer = DelayCompensator(SIMPLE_QUAD, DYNAMICS, PERIOD)
    observer.reset(3)
    observer.calibration.is_active = np.array([True, True, False])
    observer.calibration.measures_noise = np.array([True, False, False])
    found = observer.calibration.targets(np.full((3, 12), 9.0))
    np.testing.assert_allclose(found, [SIMPLE_QUAD.home_pose, 1.1 * SIMPLE_QUAD.home_pose, np.full(12, 9.0)])


def test_noise_is_known_by_the_group_and_only_from_two_second_differences_on() -> None:
    """Readings alternate by ±a, with second differences ∓4 a; their product, -16 a², equals -4 σ²: σ = 2 a."""
    noise = NoiseEstimator(PERIOD, [slice(0, 1), slice(1, 3)], np.array([0.0, 0.0]))
    noise.reset(2)
    for step in range(8):
        sign = 1.0 if step % 2 else -1.0
        found = noise.update(np.array([[0.1 * sign, 0.2 * sign, 0.0], [0.0, 0.0, 0.0]]))
        if step < 3:
            assert not found.any()
    np.testing.assert_allclose(found, [[0.04, 0.5 * 0.16], [0.0, 0.0]], rtol=1e-9)


def test_what_seems_to_be_noise_of_a_quiet_walk_is_none() -> None:
    """The threshold is the variance of a quiet walk, and at first 1 + 8 / k times this variance."""
    noise = NoiseEstimator(PERIOD, [slice(0, 1)], np.array([0.15]))
    noise.reset(1)
    found = [float(noise.update(np.array([[0.1 if step % 2 else -0.1]]))[0, 0]) for step in range(30)]
    looks = np.maximum(np.arange(1, 31) - 3, 1)
    by_hand = np.where(np.arange(1, 31) > 3, np.maximum(0.04 - 0.0225 * (1.0 + 8.0 / looks), 0.0), 0.0)
    np.testing.assert_allclose(found, by_hand, atol=1e-9)


@pytest.mark.parametrize("late", [0, 1])
def test_an_observer_takes_over_the_robots_of_another(late: int) -> None:
    """Only the robots of the mask are copied; the others keep their state."""
    own, other = (DelayCompensator(SIMPLE_QUAD, DYNAMICS, PERIOD, joint_delay_steps=late) for _ in range(2))
    own.reset(3)
    other.reset(2)
    for observer, count, shift in ((own, 3, 0.1), (other, 2, -0.2)):
        for _ in range(3):
            observer.read(reading(count, joint_position=shift, previous_action=shift), np.zeros((count, 6)))
            observer.correct(np.ones((count, 4), np.bool_), np.zeros((count, 6)))
            observer.predict(np.zeros((count, 6)), np.ones((count, 4), np.bool_), np.zeros((2, count)))
    own.copy_state_from(np.array([True, False, True]), other)
    assert own._state is not None
    np.testing.assert_allclose(own._state.joint_position[:, 0] - SIMPLE_QUAD.home_pose[0], [-0.2, 0.1, -0.2], atol=1e-3)
    np.testing.assert_allclose(own._targets[0, :, 0] - SIMPLE_QUAD.home_pose[0], [-0.2, 0.1, -0.2], atol=1e-6)


def test_late_joints_of_a_robot_that_begins_again_are_those_that_it_is_shown() -> None:
    """The other of the two robots, at 3 rad/s, is 0.01 rad ahead of the prediction: 3 + 90 · 0.01 rad/s."""
    joints = JointPredictor(1, PERIOD)
    joints.reset(2)
    for step in range(40):
        joints.predict(reading(2, joint_position=0.03 * step))
        joints.record(np.zeros((2, 12)))
    joints.reset_where(np.array([False, True]))
    found = joints.predict(reading(2, joint_position=np.array([[0.03 * 40 + 0.01], [0.03 * 40]])))
    angles, speeds = found[:, OBSERVATION["joint_position"]], found[:, OBSERVATION["joint_velocity"]]
    np.testing.assert_allclose(angles[0], 0.03 * 40 + 0.01 + 0.039, atol=2e-3)
    np.testing.assert_allclose(speeds[0], 3.9, atol=0.1)
    np.testing.assert_allclose(angles[1], 0.03 * 40, atol=1e-6)
    np.testing.assert_allclose(speeds[1], 0.0, atol=1e-6)


NOISY = np.array([[0.0] * 5, [0.004**2, 0.15**2, 0.08**2, 0.003**2, 0.6**2]])
"""Variances of two robots' readings: none, and about the change in a control step."""


def test_a_noisy_reading_counts_by_the_doubt_in_the_prediction_which_it_takes_away() -> None:
    """The prediction variance p grows by u² a step; the gain is p / (p + n), and n p / (p + n) remains.

    With n = u² the gains are 1/2, again 1/2, as the first update leaves no variance, and 1.5 / 2.5.
    """
    state_filter = StateFilter(PERIOD, has_encoders=False)
    state_filter.reset(2)
    shares = []
    for looks in range(1, 5):
        share, joints = state_filter.update_gains(NOISY, np.full(2, looks == 1))
        np.testing.assert_allclose(share[0], 1.0)  # without noise, the estimate is the reading
        np.testing.assert_allclose(joints[0], np.eye(2), atol=1e-9)
        shares.append(share[1, :2].tolist())
        assert (np.diag(joints[1]) < 1.0).all()
    expected, doubt = [], 0.0
    for looks in range(1, 5):
        doubt += 1.0
        expected.append([doubt / (doubt + 1.0)] * 2)
        doubt = 0.0 if looks == 1 else doubt / (doubt + 1.0)
    np.testing.assert_allclose(shares, expected)


def test_joints_are_corrected_by_a_kalman_filter_of_angle_and_speed() -> None:
    """P = F P Fᵀ + Q, K = P (P + R)⁻¹, P = (1 - K) P; F advances an angle by 10 ms of its speed."""
    state_filter = StateFilter(PERIOD, has_encoders=False)
    state_filter.reset(2)
    step, brought, noise = np.array([[1.0, 0.01], [0.0, 1.0]]), np.diag([0.003**2, 0.6**2]), np.diag(NOISY[1, 3:])
    doubt = np.zeros((2, 2))
    for looks in range(1, 6):
        _, found = state_filter.update_gains(NOISY, np.full(2, looks == 1))
        doubt = step @ doubt @ step.T + brought
        gain = doubt @ np.linalg.inv(doubt + noise)
        np.testing.assert_allclose(found[1], gain, rtol=1e-9)
        doubt = np.zeros((2, 2)) if looks == 1 else (np.eye(2) - gain) @ doubt


def test_only_the_readings_of_noisy_robots_are_corrected() -> None:
    """Readings are corrected towards the prediction, which is rest."""
    observer = DelayCompensator(SIMPLE_QUAD, DYNAMICS, PERIOD)
    observer.reset(2)
    still, standing = np.zeros((2, 6)), np.ones((2, 4), np.bool_)
    for _ in range(3):
        observer.read(reading(2), still)
        observer.record_stance(standing)
    observer.noise_estimator.update = lambda _: NOISY  # type: ignore[method-assign]
    shown = reading(2, linear_velocity=(0.2, 0.0, 0.0), joint_velocity=2.0)
    read = observer.read(shown, still)
    np.testing.assert_allclose(read.velocity[0], (0.2, 0.0, 0.0), atol=1e-6)
    np.testing.assert_allclose(read.generalised_velocity[0, 6:], 2.0, atol=1e-6)
    assert 0.02 < read.velocity[1, 0] < 0.18
    assert (np.abs(read.generalised_velocity[1, 6:] - 1.0) < 0.95).all()


def test_joints_of_encoders_are_corrected_though_their_readings_are_quiet() -> None:
    state_filter = StateFilter(PERIOD, has_encoders=True)
    _, joints = state_filter.update_gains(np.zeros((1, 5)), np.zeros(1, np.bool_))
    assert 0.0 < joints[0, 0, 0] < 1.0
    assert joints[0, 1, 1] < 1e-3  # a difference of two samples is almost ignored
