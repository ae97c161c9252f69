"""The error-state filter: its derivatives, frames and covariance, and batches of robots."""

from functools import cache

import numpy as np
import pytest

import policies
from quad_env.config import GRAVITY
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.kinematics import foot_jacobians, foot_positions
from quad_env.robots.simple_quad import SIMPLE_QUAD as ROBOT
from quad_env.sensing import kalman_models
from quad_env.sensing.estimator import AlignedReadings, unit
from quad_env.sensing.estimators import ESTIMATORS, KALMAN
from quad_env.sensing.kalman import KalmanFilter
from quad_env.sensing.kalman_models import FEET, NominalState, StepMeasurements, exp_so3
from quad_env.sensing.suite import Encoders, Imu, SensorSuite
from quad_env.task.observations import OBSERVATION

DT, SMALL = 0.01, 1e-6
AHEAD = {"command": (0.8, 0.0, 0.3)}
GRAVITY_SEEN, VELOCITY_SEEN = OBSERVATION["projected_gravity"], OBSERVATION["linear_velocity"]


def motion(random: np.random.Generator) -> NominalState:
    gravity = unit(np.array([[0.2, -0.3, -1.0]]))
    feet = ROBOT.hip_positions + foot_positions(ROBOT, ROBOT.home_pose.reshape(1, 4, 3))
    return NominalState(gravity, *(0.5 * random.normal(size=(3, 1, 3))), feet)


def samples(random: np.random.Generator) -> StepMeasurements:
    joints = ROBOT.home_pose.reshape(1, 4, 3)
    later = joints + 0.05 * random.normal(size=joints.shape)
    return StepMeasurements(random.normal(size=(1, 3)), GRAVITY * np.array([[0.1, 0.2, 1.0]]), joints, later)


def error_between(truth: NominalState, estimate: NominalState) -> np.ndarray:
    """Return the small error with which `corrected` maps the estimate to the truth."""
    tilt = np.cross(estimate.gravity, truth.gravity)
    feet = (truth.feet - estimate.feet).reshape(1, -1)
    return np.concatenate((tilt, *(t - e for t, e in list(zip(truth, estimate, strict=True))[1:4]), feet), axis=1)[0]


def test_the_transition_is_the_derivative_of_the_prediction() -> None:
    random = np.random.default_rng(0)
    start, seen = motion(random), samples(random)
    to = kalman_models.rotate_state(start, seen, DT)
    found = kalman_models.error_transition_matrix(ROBOT, start, seen, to, DT)[0]
    after = kalman_models.predict(ROBOT, start, to, DT)
    for entry in range(kalman_models.error_dim(ROBOT)):
        error = np.zeros((1, kalman_models.error_dim(ROBOT)))
        error[0, entry] = SMALL
        if entry < 3:  # a rotation about gravity is no error of gravity
            error[0, :3] -= start.gravity[0] * (start.gravity[0] @ error[0, :3])
        off = kalman_models.inject_error(start, error)
        moved = kalman_models.predict(ROBOT, off, kalman_models.rotate_state(off, seen, DT), DT)
        expected = found @ error[0]
        expected[:3] -= after.gravity[0] * (after.gravity[0] @ expected[:3])
        np.testing.assert_allclose(error_between(moved, after) / SMALL, expected / SMALL, atol=3e-5)


def test_the_jacobians_of_the_feet_are_derivatives() -> None:
    joints = ROBOT.home_pose.reshape(1, 4, 3) + 0.3 * np.random.default_rng(1).normal(size=(1, 4, 3))
    found = foot_jacobians(ROBOT, joints)
    for joint in range(3):
        step = SMALL * np.eye(3)[joint]
        change = foot_positions(ROBOT, joints + step) - foot_positions(ROBOT, joints - step)
        np.testing.assert_allclose(found[..., joint], change / (2.0 * SMALL), atol=1e-8)


def test_a_turn_takes_the_world_the_other_way() -> None:
    """After a roll to the right by Exp(-ω dt), gravity is on the right of the trunk, where y is left."""
    roll = np.array([[0.5, 0.0, 0.0]])
    gravity = kalman_models.matvec(exp_so3(-roll), np.array([[0.0, 0.0, -1.0]]))
    np.testing.assert_allclose(gravity, [[0.0, -np.sin(0.5), -np.cos(0.5)]], atol=1e-12)


@cache
def walked(seeds: tuple[int, ...], steps: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the actions of robots that walk ahead by the true state, and the true state after each action."""
    env, policy = SimpleQuadVectorEnv(len(seeds)), policies.make("trot")
    true, _ = env.reset(seed=list(seeds), options=AHEAD)
    policy.reset(num_envs=len(seeds))
    actions: list[np.ndarray] = []
    truth: list[np.ndarray] = []
    for _ in range(steps):
        actions.append(policy.act(true))
        true = env.step(actions[-1])[0]
        truth.append(true)
    return actions, truth


def walk(sensors: str, num_envs: int, seeds: list[int], steps: int, estimator: str = KALMAN):
    """Return the errors of gravity and velocity, (steps, n, 3) each, and the filter; robots walk by the true state."""
    env = SimpleQuadVectorEnv(num_envs, sensors=sensors, estimator=estimator)
    env.reset(seed=seeds, options=AHEAD)
    actions, truth = walked(tuple(seeds), steps)
    errors = np.array([env.step(action)[0] for action in actions], np.float64) - np.array(truth)
    return errors[..., GRAVITY_SEEN], errors[..., VELOCITY_SEEN], env.estimator


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt((errors**2).sum(axis=-1).mean()))


def test_it_is_nearer_to_the_truth_than_the_complementary_filter() -> None:
    by_kalman, by_complementary = (walk("typical", 2, [0, 1], 200, name)[1] for name in (KALMAN, ESTIMATORS[0]))
    assert rms(by_kalman[100:]) < 0.7 * rms(by_complementary[100:])


@pytest.mark.parametrize(
    ("sensors", "estimator", "gravity", "velocity"),
    [
        ("ideal", ESTIMATORS[0], 0.025, 0.06),
        ("typical", ESTIMATORS[0], 0.035, 0.2),
        ("ideal", KALMAN, 0.017, 0.087),
    ],
)
def test_of_a_trot_the_estimates_are_close(sensors: str, estimator: str, gravity: float, velocity: float) -> None:
    tilts, velocities, _ = walk(sensors, 6, [*range(6)], 250, estimator)
    assert rms(tilts[100:]) < gravity
    assert rms(velocities[100:]) < velocity
    assert np.abs(velocities[100:].mean(axis=(0, 1))).max() < 0.04


def test_robots_are_estimated_each_by_itself() -> None:
    together = walk("typical", 2, [5, 6], 120)[2]
    alone = walk("typical", 1, [6], 120)[2]
    for of_all, of_one in ((together.gravity, alone.gravity), (together.velocity, alone.velocity)):
        np.testing.assert_allclose(of_all[1], of_one[0], atol=1e-9)
    covariance = together.covariance
    np.testing.assert_allclose(covariance[1], alone.covariance[0], atol=1e-9)
    np.testing.assert_allclose(covariance, np.swapaxes(covariance, 1, 2), atol=1e-12)
    assert np.linalg.eigvalsh(covariance).min() > 0.0


def test_a_reset_forgets_one_robot_alone() -> None:
    vec = SimpleQuadVectorEnv(2, sensors="typical", estimator=KALMAN)
    vec.reset(seed=[1, 2])
    stand = np.tile(ROBOT.home_pose, (2, 1)).astype(np.float32)
    for _ in range(50):
        vec.step(stand)
    filter_ = vec.estimator
    assert isinstance(filter_, KalmanFilter)
    kept = filter_.covariance[1].copy()
    vec.reset(seed=[3, 4], options={"reset_mask": np.array([True, False])})
    np.testing.assert_array_equal(filter_.covariance[1], kept)
    assert not filter_.velocity[0].any()


def read(gyro: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> AlignedReadings:
    """Return the readings of one robot in the home pose, level, on all feet, with a given gyroscope reading, rad/s."""
    feet, joints = np.ones((1, 4), np.bool_), ROBOT.home_pose[None]
    force = np.array([[0.0, 0.0, GRAVITY]])
    return AlignedReadings(np.array([gyro]), force, joints, joints, feet, feet, np.ones(1, np.bool_))


def after_one_sample(suite: SensorSuite, late: int = 0, gyro: tuple[float, float, float] = (0.0, 0.0, 0.0)):
    """Return a filter of a standing robot after one sample."""
    filter_, robot = KalmanFilter(ROBOT, suite, 1, DT, late), np.arange(1)
    filter_.reset(robot, read().accelerometer, read(gyro))
    filter_.update(read(gyro), robot)
    return filter_


@pytest.mark.parametrize(("axis", "late"), [(0, 0), (0, 4), (1, 1)])
def test_the_trunk_turns_on_as_it_does_over_the_delay_of_the_readings(axis: int, late: int) -> None:
    """Gravity rotates by -ω in the frame of the trunk, and the prediction continues for ω · delay from the readings."""
    gyro = tuple(0.8 * np.eye(3)[axis])
    filter_ = after_one_sample(SensorSuite(imu=Imu(gyro_bias=0.5)), late, gyro)
    assert np.abs(filter_.gyro_bias).max() > 0.1  # the feet, which rest, show a slower rotation of the trunk
    speed = np.array(gyro) - filter_.gyro_bias[0]
    expected = filter_.nominal.gravity[0]
    for _ in range(1000):  # small steps of dg/dt = -ω × g
        expected = expected - 1e-3 * late * DT * np.cross(speed, expected)
    np.testing.assert_allclose(filter_.gravity[0], expected, atol=1e-5)
    change = np.linalg.norm(filter_.gravity - filter_.nominal.gravity)
    assert change == pytest.approx(np.linalg.norm(speed) * late * DT, rel=0.01)


def test_feet_that_swing_fast_do_not_pull_the_velocity() -> None:
    """Two legs swing back at 4 m/s for 0.1 s in free fall, as after a push.

    The horizontal velocity of the trunk is zero.
    """
    filter_, robot = KalmanFilter(ROBOT, SensorSuite(), 1, DT, 0), np.arange(1)
    filter_.reset(robot, read().accelerometer, read())
    lifted = read()._replace(accelerometer=np.zeros((1, 3)), contact=np.zeros((1, 4), np.bool_))
    for sample in range(10):
        swung = np.outer((1, 0, 0, 1), (0.0, 0.1, 0.0)).ravel() * sample
        filter_.update(lifted._replace(joints=lifted.joints + swung), robot)
    assert np.abs(filter_.velocity[0, :2]).max() < 0.05


def test_resting_feet_that_are_taken_for_swinging_correct_a_wrong_velocity() -> None:
    """The estimate of a standing robot is 1 m/s with a std of 3 mm/s; contact sensors raise the variance in 0.4 s."""
    filter_, robot = after_one_sample(SensorSuite()), np.arange(1)
    for _ in range(20):
        filter_.update(read(), robot)
    filter_.nominal.velocity[:] = (1.0, 0.0, 0.0)
    filter_.contact.probability[:] = 0.0
    filter_.contact.reading_time[:] = 0.0
    assert np.sqrt(filter_.covariance[0, 3, 3]) < 0.01
    for _ in range(40):
        filter_.update(read(), robot)
    assert np.abs(filter_.velocity).max() < 0.05


def test_after_one_sample_feet_are_as_uncertain_as_the_encoders() -> None:
    """The covariance is J Jᵀ σ²: the previous uncertainty of 1 cm has little effect."""
    suite = SensorSuite(encoders=Encoders(noise=0.001, bits=None))
    found = after_one_sample(suite).covariance[0]
    for leg, jacobian in enumerate(foot_jacobians(ROBOT, ROBOT.home_pose.reshape(1, 4, 3))[0]):
        place, noise = kalman_models.foot(leg), 0.001**2 * jacobian @ jacobian.T
        np.testing.assert_allclose(found[place, place], noise, atol=0.02 * noise.max())


def test_the_covariance_counts_the_mounting_of_the_imu_as_tilt() -> None:
    straight, turned = (
        after_one_sample(SensorSuite(imu=Imu(rotation=(angle, angle, angle)))).covariance[0] for angle in (0.0, 0.02)
    )
    more = np.zeros_like(straight)
    more[kalman_models.TILT, kalman_models.TILT] = 0.02**2 * np.eye(3)
    np.testing.assert_allclose(turned - straight, more, atol=1e-12)


def moved_on(filter_: KalmanFilter, times: int = 1, *, fresh: bool = True, **fields: np.ndarray) -> None:
    """Step the filter `times` control steps with given readings; the other readings are those at rest."""
    now = read()._replace(has_new_angles=np.array([fresh]), **fields)
    for _ in range(times):
        filter_.update(now, np.arange(1))


def test_robots_that_are_stepped_in_turns_equal_robots_that_are_stepped_together() -> None:
    """No intermediate matrix of an earlier sample or of another robot reaches an estimate."""
    random = np.random.default_rng(2)
    robots = np.arange(3)
    together = KalmanFilter(ROBOT, SensorSuite(), 3, DT, 1)
    in_turns = KalmanFilter(ROBOT, SensorSuite(), 3, DT, 1)
    start = AlignedReadings(*(np.repeat(values, 3, axis=0) for values in read()))
    for filter_ in (together, in_turns):
        filter_.reset(robots, start.accelerometer, start)
    for _ in range(4):
        gyro = random.normal(size=(3, 3))
        joints = start.joints + 0.05 * random.normal(size=(3, 12))
        contact = random.random((3, 4)) < 0.5
        readings = start._replace(gyro=gyro, joints=joints, contact=contact)
        together.update(readings, robots)
        for rows in (np.array([1]), np.array([0, 2])):
            in_turns.update(AlignedReadings(*(values[rows] for values in readings)), rows)
    for one, other in zip(together.nominal, in_turns.nominal, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(together.covariance, in_turns.covariance)


IN_THE_AIR = {"contact": np.zeros((1, 4), np.bool_), "sustained_contact": np.zeros((1, 4), np.bool_)}


def begun(late: int = 0) -> KalmanFilter:
    filter_ = KalmanFilter(ROBOT, SensorSuite(), 1, DT, late)
    filter_.reset(np.arange(1), read().accelerometer, read())
    return filter_


def test_a_velocity_goes_on_over_the_delay_with_its_acceleration_and_0_8_of_the_change_of_that() -> None:
    """The velocity is 0.03 · (1 + 0.8 · 1) m/s at first, then 0.03 m/s.

    The acceleration is 1 m/s² from one sample on, and the delay 30 ms.
    """
    filter_ = begun(late=3)
    for gained in (0.054, 0.03, 0.03):
        moved_on(filter_, accelerometer=np.array([[1.0, 0.0, 9.81]]), **IN_THE_AIR)
        ahead = filter_.velocity - filter_.nominal.velocity
        np.testing.assert_allclose(ahead, [[gained, 0.0, 0.0]], atol=2e-3)


def test_encoders_without_a_new_sample_correct_nothing() -> None:
    """Joint readings have an offset of 0.1 rad: only a new sample moves the feet there."""
    joints = read().joints + 0.1
    there = ROBOT.hip_positions + foot_positions(ROBOT, joints.reshape(1, 4, 3))
    for fresh in (False, True):
        filter_ = begun()
        before = filter_.nominal.feet.copy()
        moved_on(filter_, fresh=fresh, joints=joints, previous_joints=joints, **IN_THE_AIR)
        expected = there if fresh else before
        assert np.abs(filter_.nominal.feet - expected).max() < 0.2 * np.abs(there - before).max()


def test_a_foot_s_reading_is_long_only_where_it_is_not_interrupted() -> None:
    filter_ = begun()
    stands = {"contact": np.ones((1, 4), np.bool_), "sustained_contact": np.ones((1, 4), np.bool_)}
    moved_on(filter_, 3, **stands)
    np.testing.assert_allclose(filter_.contact.reading_time, 0.03)
    moved_on(filter_, 1, **IN_THE_AIR)
    np.testing.assert_array_equal(filter_.contact.reading_time, 0.0)
    moved_on(filter_, 2, **stands)
    np.testing.assert_allclose(filter_.contact.reading_time, 0.02)


def test_the_ground_gives_where_the_force_on_the_trunk_changes_and_not_while_it_stays() -> None:
    """After a step of 20 m/s², the variance of foot heights exceeds that of a robot at rest.

    The next change is relative to the force at that time.
    """
    heights = []
    for force in (9.81, 29.81):
        filter_ = begun()
        moved_on(filter_, 40)
        moved_on(filter_, accelerometer=np.array([[0.0, 0.0, force]]))
        heights.append(float(filter_.covariance[0, FEET, FEET][2, 2]))
        np.testing.assert_allclose(filter_.previous.specific_force, [[0.0, 0.0, force]], atol=0.05)
    assert heights[1] > 1.02 * heights[0]
