"""The estimator, compared with motions computed by hand."""

import numpy as np
import pytest

from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.sensing.estimator import (
    TILT_TIME,
    VELOCITY_TIME,
    AlignedReadings,
    ComplementaryFilter,
    leg_odometry_velocity,
)

DT, ROW = 0.01, np.zeros(1, np.intp)
DOWN, STILL = np.array([[0.0, 0.0, -1.0]]), np.zeros((1, 3))
ALL, NONE = np.ones((1, 4), bool), np.zeros((1, 4), bool)
REST = np.array([[0.0, 0.0, 9.81]])


def read(gyro=STILL, force=REST, joints=SIMPLE_QUAD.home_pose, before=None, standing=ALL) -> AlignedReadings:
    joints = np.reshape(joints, (1, 12))
    before = joints if before is None else before.reshape(1, 12)
    return AlignedReadings(np.array(gyro), np.array(force), joints, before, standing, standing, np.ones(1, bool))


def estimator(at_rest=REST, gyro=STILL) -> ComplementaryFilter:
    out = ComplementaryFilter(SIMPLE_QUAD, 1, DT, DT)
    out.reset(ROW, at_rest, read(gyro=gyro))
    return out


def moving(thigh: float, calf: float) -> tuple[np.ndarray, np.ndarray]:
    """Return joints of four legs in mid-sample at home, and a sample before, with given rates, rad/s."""
    change = np.tile((0.0, thigh, calf), 4) * DT / 2
    return SIMPLE_QUAD.home_pose + change, SIMPLE_QUAD.home_pose - change


def by_legs(joints: np.ndarray, before: np.ndarray, turning=STILL, standing=ALL) -> np.ndarray:
    velocity, known = leg_odometry_velocity(
        SIMPLE_QUAD, read(joints=joints, before=before, standing=standing), np.array(turning), DOWN, DT
    )
    assert known.all()
    return velocity[0]


def test_shins_that_keep_their_direction_push_the_trunk_along_the_thighs_circle() -> None:
    expected = (SIMPLE_QUAD.thigh_length * np.cos(0.5) * 2, 0, -SIMPLE_QUAD.thigh_length * np.sin(0.5) * 2)
    np.testing.assert_allclose(by_legs(*moving(2.0, -2.0)), expected, atol=1e-4)


def test_a_shin_that_turns_rolls_on_its_foot() -> None:
    """The shank is at thigh + calf = -0.5 rad."""
    expected = (
        2 * (SIMPLE_QUAD.foot_radius + SIMPLE_QUAD.calf_length * np.cos(-0.5)),
        0,
        -2 * SIMPLE_QUAD.calf_length * np.sin(-0.5),
    )
    np.testing.assert_allclose(by_legs(*moving(0.0, 2.0)), expected, atol=1e-4)


def test_on_one_still_leg_the_trunk_circles_about_the_foot() -> None:
    one = np.array([[True, False, False, False]])  # front left: the foot is 0.25 m ahead and 0.25 m to the left
    velocity = by_legs(SIMPLE_QUAD.home_pose, SIMPLE_QUAD.home_pose, [[0.0, 0.0, 2.0]], one)
    np.testing.assert_allclose(velocity, (2 * 0.25, -2 * 0.25, 0), atol=1e-12)


def test_a_leg_that_moves_under_a_turning_trunk_counts_from_the_middle_of_its_way() -> None:
    """The velocity is that of thigh and trunk about the foot in the middle of the motion, at (0.25, 0.25) m."""
    one = np.array([[True, False, False, False]])
    along = by_legs(*moving(2.0, -2.0), standing=one)
    velocity = by_legs(*moving(2.0, -2.0), [[0.0, 0.0, 2.0]], one)
    np.testing.assert_allclose(velocity - along, (2 * 0.25, -2 * 0.25, 0), atol=1e-4)


def test_a_hip_that_turns_moves_the_trunk_sideways_over_the_foot() -> None:
    legs = np.zeros(12)
    change = np.tile((1.0, 0.0, 0.0), 4) * DT / 2
    length = SIMPLE_QUAD.thigh_length + SIMPLE_QUAD.calf_length + SIMPLE_QUAD.foot_radius
    velocity = by_legs(legs + change, legs - change)
    np.testing.assert_allclose(velocity[:2], (0, -length), atol=1e-4)


def test_without_a_standing_foot_nothing_is_known_and_the_accelerometer_goes_on() -> None:
    velocity, known = leg_odometry_velocity(SIMPLE_QUAD, read(standing=NONE), STILL, DOWN, DT)
    assert not known.any()
    assert (velocity == 0).all()
    flying = estimator()
    for _ in range(10):
        flying.update(read(force=[[1.0, 0.0, 9.81]], standing=NONE), ROW)
    np.testing.assert_allclose(flying.velocity, [[0.1, 0.0, 0.0]], atol=3e-3)


def test_standing_feet_take_a_wrong_velocity_away_in_the_stated_time() -> None:
    standing = estimator()
    standing.velocity[:] = (0.4, -0.2, 0.1)
    for _ in range(round(VELOCITY_TIME / DT)):
        standing.update(read(), ROW)
    share = (1 - DT / VELOCITY_TIME) ** round(VELOCITY_TIME / DT)
    np.testing.assert_allclose(standing.velocity[0], share * np.array((0.4, -0.2, 0.1)), atol=2e-3)


@pytest.mark.parametrize(
    ("axis", "expected"), [(0, (0, -np.sin(0.5), -np.cos(0.5))), (1, (np.sin(0.5), 0, -np.cos(0.5))), (2, (0, 0, -1))]
)
def test_the_gyroscope_turns_gravity_the_other_way(axis: int, expected: tuple[float, ...]) -> None:
    """The angle is half a radian in half a second; the accelerometer agrees with the estimate and has no effect."""
    turn = np.eye(3)[[axis]]
    turning = estimator(gyro=turn)
    for _ in range(50):
        turning.update(read(gyro=turn, force=-9.81 * turning.gravity, standing=NONE), ROW)
        turning.velocity[:] = 0.0
    np.testing.assert_allclose(turning.gravity[0], expected, atol=6e-3)


def test_the_accelerometer_takes_a_wrong_tilt_away_in_the_stated_time() -> None:
    tilted = estimator(at_rest=np.array([[0.1, 0.0, 9.81]]))
    before = tilted.gravity[0, 0]
    for _ in range(round(TILT_TIME / DT)):
        tilted.update(read(), ROW)
    assert tilted.gravity[0, 0] / before == pytest.approx(np.exp(-1), abs=0.02)


def test_a_circle_walked_at_constant_speed_is_no_tilt() -> None:
    """1 m/s forward at 1 rad/s: the specific force is 1 m/s² to the left in addition to gravity."""
    circling = estimator(gyro=[[0.0, 0.0, 1.0]])
    circling.velocity[:] = (1.0, 0.0, 0.0)
    for _ in range(300):
        circling.update(read(gyro=[[0.0, 0.0, 1.0]], force=[[0.0, 1.0, 9.81]], standing=NONE), ROW)
    np.testing.assert_allclose(circling.gravity, DOWN, atol=0.01)
    np.testing.assert_allclose(circling.velocity, [[1.0, 0.0, 0.0]], atol=0.03)


def test_a_turn_is_the_mean_of_two_samples_of_the_gyroscope() -> None:
    """From rest to 1 rad/s: 5 mrad in the first 10 ms, and 10 mrad in each further 10 ms."""
    turning = estimator()
    for angle in (0.005, 0.015, 0.025):
        turning.update(read(gyro=[[1.0, 0.0, 0.0]], force=-9.81 * turning.gravity, standing=NONE), ROW)
        turning.velocity[:] = 0.0
        np.testing.assert_allclose(turning.gravity[0], [0.0, -np.sin(angle), -np.cos(angle)], atol=2e-4)


def both(one: AlignedReadings, other: AlignedReadings) -> AlignedReadings:
    """Return the readings of two robots."""
    return AlignedReadings._make(np.concatenate(pair) for pair in zip(one, other, strict=True))


def test_each_robot_is_estimated_by_its_own_readings_and_begins_by_itself() -> None:
    """The first robot stands, and the second is in flight and accelerates; then the second is reset with a tilt."""
    rows, two = np.arange(2), ComplementaryFilter(SIMPLE_QUAD, 2, DT, DT)
    flying = read(gyro=[[0.0, 0.0, 1.0]], force=[[1.0, 0.0, 9.81]], standing=NONE)
    two.reset(rows, np.concatenate((REST, REST)), both(read(), flying))
    two.velocity[0] = 0.4, 0.0, 0.0
    alone = estimator()
    alone.velocity[0] = 0.4, 0.0, 0.0
    for _ in range(10):
        two.update(both(read(), flying), rows)
        alone.update(read(), ROW)
    np.testing.assert_array_equal(two.velocity[0], alone.velocity[0])
    np.testing.assert_array_equal(two.gravity[0], alone.gravity[0])
    assert np.hypot(*two.velocity[1, :2]) == pytest.approx(0.1, abs=0.01)
    kept = two.velocity[0].copy()
    two.reset(rows[1:], np.array([[0.0, 3.0, 9.0]]), read())
    np.testing.assert_array_equal(two.velocity, [kept, np.zeros(3)])
    np.testing.assert_allclose(two.gravity[1], -np.array([0.0, 3.0, 9.0]) / np.hypot(3.0, 9.0))
    turned = read(gyro=[[1.0, 0.0, 0.0]], force=-9.81 * two.gravity[1:], standing=NONE)
    before = two.gravity[1].copy()
    two.update(turned, rows[1:])
    # The rotation starts from rest, not from the angular velocity before the reset.
    assert np.arccos(before @ two.gravity[1]) == pytest.approx(0.005, abs=2e-4)
