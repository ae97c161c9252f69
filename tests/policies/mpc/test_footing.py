"""Footholds, swing trajectories and moment arms of the feet by hand, and the ground plane of the footprints."""

import numpy as np
import pytest

from policies.contact.motion_state import MotionState, compute_motion_state
from policies.mpc.footing import (
    TerrainEstimator,
    ground_velocity,
    nominal_footholds,
    plan_footholds,
    point_velocity,
    predict_moment_arms,
    swing_trajectory,
)
from policies.mpc.parameters import MpcParameters
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.policies.readings import reading

P = MpcParameters(
    length=0.4, width=0.6, shift=0.03, step_gain=0.1, lean_gain=0.5, step_height=0.08, landing_depth=0.01, duty=0.5
)
HEIGHT = 0.42
STANCE = np.array([0.2])
CENTRE = np.array([-0.05, 0.02])
NEUTRAL = CENTRE + np.array([0.03, 0.0]) + np.array([[0.2, 0.3], [0.2, -0.3], [-0.2, 0.3], [-0.2, -0.3]])
"""Half the length and width from the centre of mass, and 0.03 m ahead."""


def moving(
    velocity: tuple[float, float] = (0.0, 0.0), command: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> MotionState:
    """Return the motion of a robot at rest in the home pose, except for the arguments; its centre of mass is CENTRE."""
    now = compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), reading(1))
    centre, com_velocity = np.array([[*CENTRE, 0.0]]), np.array([[*velocity, 0.0]])
    bodies = now.bodies._replace(com_position=centre, com_velocity=com_velocity)
    return now._replace(bodies=bodies, command=np.array([command]))


def aims(now: MotionState, pushed: tuple[float, float] = (0.0, 0.0), height: float = HEIGHT) -> np.ndarray:
    return plan_footholds(SIMPLE_QUAD, P, now, np.array([pushed]), STANCE, height)[0]


def test_feet_of_a_robot_at_rest_are_put_to_their_neutral_places() -> None:
    np.testing.assert_allclose(nominal_footholds(SIMPLE_QUAD, P), NEUTRAL - CENTRE)
    np.testing.assert_allclose(aims(moving()), NEUTRAL)


def test_feet_are_put_to_where_they_bear_a_lasting_force() -> None:
    """The offset is lean_gain · height / g = 0.5 · 0.42 / 9.81 = 0.021407 m per m/s², at most 0.2 m."""
    np.testing.assert_allclose(aims(moving(), (2.0, -1.0)), NEUTRAL + np.array([0.042813, -0.021407]), atol=1e-6)
    np.testing.assert_allclose(aims(moving(), (-50.0, 0.0)), NEUTRAL + np.array([-0.2, 0.0]), atol=1e-12)


def test_feet_are_put_ahead_by_half_the_way_of_a_stance_and_by_the_error_of_the_velocity() -> None:
    """The offset is 0.1 s · (0.6, -0.1) m/s plus 0.1 s · (0.6 - 0.4, -0.1 - 0) m/s."""
    now = moving((0.6, -0.1), (0.4, 0.0, 0.0))
    np.testing.assert_allclose(aims(now), NEUTRAL + np.array([0.06 + 0.02, -0.01 - 0.01]), atol=1e-12)


def test_feet_of_a_robot_that_is_to_turn_are_put_round_it() -> None:
    """A point (x, y) moves by 0.15 (-y, x) in 0.1 s at 1.5 rad/s."""
    expected = NEUTRAL + 0.15 * np.column_stack((-NEUTRAL[:, 1], NEUTRAL[:, 0]))
    np.testing.assert_allclose(aims(moving(command=(0.0, 0.0, 1.5))), expected, atol=1e-12)


def test_no_foot_is_put_further_than_it_reaches() -> None:
    """0.1 s at (2, -1.5) m/s and an equal velocity error give (0.4, -0.3) m; the offset is limited to 0.35 m."""
    far = aims(moving((2.0, -1.5)), height=2.0)
    np.testing.assert_allclose(far, NEUTRAL + np.array([0.28, -0.21]), atol=1e-12)


def test_no_foot_is_put_further_aside_than_its_hip_turns() -> None:
    """The hip is at 0.15 + 0.1 m to the side; the foot is at most (0.42 - 0.05) tan 0.42 = 0.16523 m from there."""
    aside = aims(moving((0.0, 1.5)))[:, 1]
    np.testing.assert_allclose(aside, [0.41523, -0.08477, 0.41523, -0.08477], atol=1e-5)
    aside = aims(moving((0.0, -1.5)))[:, 1]
    np.testing.assert_allclose(aside, [0.08477, -0.41523, 0.08477, -0.41523], atol=1e-5)


def test_the_ground_passes_under_a_trunk_that_goes_and_turns() -> None:
    """A point (x, y) of the moving frame has the velocity v + ω (-y, x), the ground under it the opposite velocity."""
    now, places = moving((0.5, -0.2)), np.array([[[0.3, 0.2], [0.3, -0.2], [-0.3, 0.2], [-0.3, -0.2]]])
    by_hand = [[0.1, 0.4], [0.9, 0.4], [0.1, -0.8], [0.9, -0.8]]
    np.testing.assert_allclose(point_velocity(now, np.array([2.0]), places)[0], by_hand)
    bodies = now.bodies._replace(feet=np.concatenate((places, np.full((1, 4, 1), -0.4)), axis=2))
    ground = ground_velocity(now._replace(bodies=bodies), np.array([1.0]))
    np.testing.assert_allclose(ground[0], [[-0.3, -0.1], [-0.7, -0.1], [-0.3, 0.5], [-0.7, 0.5]])


def swung(progress: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return one foot that swings for 0.2 s over rising ground, which passes at -0.5 m/s, by x, y and progress."""
    start, aim, passed = (np.tile(each, (1, 4, 1)) for each in ([0.1, 0.2], [0.3, 0.25], [-0.5, 0.0]))
    found = swing_trajectory(
        P,
        start,
        aim,
        passed,
        np.full((1, 4), progress),
        np.array([0.2]),
        0.01,
        lambda x, y, t: -0.4 + 0.1 * x - 0.2 * y + 0.03 * t,
    )
    return tuple(each[0, 0] for each in found)  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("progress", "place", "velocity"),
    [
        # Ground: -0.4 + 0.01 - 0.04 at the start, -0.4 + 0.03 - 0.05 + 0.03 at the end, and 0.01 below the end.
        (0.0, (0.1, 0.2, -0.43), (-0.5, 0.0, -0.05 + 0.15)),
        (1.0, (0.3, 0.25, -0.40), (-0.5, 0.0, -0.05 + 0.15)),
        # Halfway in x and y: 1.5 (0.2, 0.05) / 0.2 s minus half of the ground's velocity; 0.08 m above the ground.
        (0.5, (0.2, 0.225, -0.41 + 0.08 - 0.005), (1.75, 0.375, 0.175 - 0.075 + 0.15 - 0.075)),
        # A quarter: 5/32 of the path and 3/32 of the ground's 0.1 m back; arc² = 9/16, its slope 3; depth 1.125 · 0.01.
        (
            0.25,
            (0.1 + 0.03125 - 0.009375, 0.2 + 0.0078125, -0.4 + 0.0121875 - 0.0415625 + 0.0075 + 0.045 - 0.0015625),
            (1.1875, 0.28125, 0.11875 - 0.05625 + 0.15 + 1.2 - 0.05625),
        ),
    ],
)
def test_a_swing_is_a_cubic_that_leaves_and_lands_with_the_ground(
    progress: float, place: tuple[float, ...], velocity: tuple[float, ...]
) -> None:
    found = swung(progress)
    np.testing.assert_allclose(found[0], place, atol=1e-9)
    np.testing.assert_allclose(found[1], velocity, atol=1e-4)


def test_the_acceleration_of_a_swing_is_the_mean_one_of_the_coming_control_period() -> None:
    """The mean acceleration is the velocity change from progress 0.5 to, 10 ms later, 0.55.

    The path velocity changes from 1.5 to 1.485 of the distance per swing, and that of the ground from -0.5 to -0.485 of
    its -0.1 m.
    """
    ahead = ((1.485 * 0.2 + 0.485 * 0.1) - (1.5 * 0.2 + 0.5 * 0.1)) / 0.2 / 0.01
    np.testing.assert_allclose(swung(0.5)[2][:2], [ahead, (1.485 - 1.5) * 0.05 / 0.2 / 0.01], atol=0.01)


def test_arms_of_feet_that_stand_lag_behind_and_those_of_feet_that_land_from_their_landing_on() -> None:
    """Moment arms of standing feet lag behind the moving trunk; those of landing feet do from the landing on.

    The velocity is 0.5 m/s ahead and 0.2 m/s to the right, the times are 0.02, 0.06 and 0.10 s. The first foot stands
    throughout. The second foot lifts after the first step and lands 0.01 s before the middle of the last step. The
    third foot is in flight. The last foot lands 0.03 s before the second foot.
    """
    feet = np.array([[[0.2, 0.2, -0.5], [0.2, -0.2, -0.5], [-0.2, 0.2, -0.5], [-0.2, -0.2, -0.5]]])
    aim = np.array([[[0.3, 0.3], [0.3, -0.3], [-0.1, 0.3], [-0.1, -0.3]]])
    stands = np.array([[[1, 1, 0, 0], [1, 0, 0, 1], [1, 1, 0, 1]]], np.bool_)
    since = np.array([[[9.0, 9.0, 9.0, 9.0], [9.0, 9.0, 9.0, 0.03], [9.0, 0.01, 9.0, 0.07]]])
    found = predict_moment_arms(
        feet,
        aim,
        np.array([[-0.05, 0.02, -0.1]]),
        np.array([[0.5, -0.2]]),
        stands,
        since,
        np.array([0.02, 0.06, 0.1]),
        np.array([[[-0.4]]]),
    )[0]
    stood, landing = np.array([0.25, 0.18]), np.array([0.35, -0.32])
    np.testing.assert_allclose(
        found[:, 0, :2],
        [stood + np.array([-0.01, 0.004]), stood + np.array([-0.03, 0.012]), stood + np.array([-0.05, 0.02])],
    )
    np.testing.assert_allclose(found[:, 1, :2], [[0.24, -0.216], landing, landing + np.array([-0.005, 0.002])])
    np.testing.assert_allclose(found[:, 2, :2], np.tile([-0.05, 0.28], (3, 1)))
    np.testing.assert_allclose(found[:, 3, :2], [[-0.05, -0.32], [-0.065, -0.314], [-0.085, -0.306]])
    np.testing.assert_array_equal(found[..., 2], -0.4)


def standing_on(heights: list[float], **readings: tuple[float, ...]) -> MotionState:
    """Return a robot with its feet ±0.25 m ahead and ±0.2 m to the side, at the given heights."""
    now = compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), reading(1, **readings))
    feet = np.column_stack(([0.25, 0.25, -0.25, -0.25], [0.2, -0.2, 0.2, -0.2], heights))
    return now._replace(bodies=now.bodies._replace(feet=feet[None]))


ALL = np.ones((1, 4), np.bool_)


def test_the_ground_under_the_trunk_is_the_mean_of_the_footprints_and_roughness_their_distance_from_a_plane() -> None:
    """A corner 0.04 m high leaves residuals of 0.01 m of the best plane at every corner.

    The filters take 0.01 / 1.01 of this roughness and 0.01 / 0.21 of the slope. The slope is 0.02 m per 0.5 m ahead and
    per 0.4 m to the side.
    """
    prints = TerrainEstimator(slope_time=0.2, period=0.01)
    ground = prints.ground(standing_on([-0.36, -0.4, -0.4, -0.4]), ALL)
    np.testing.assert_allclose(prints.roughness, 0.01 * 0.01 / 1.01, rtol=1e-4)
    slope = np.array([0.02 / 0.5, 0.02 / 0.4]) * 0.01 / 0.21
    np.testing.assert_allclose([ground.forward[0], ground.lateral[0]], slope, rtol=1e-4)
    np.testing.assert_allclose(ground.height, -0.39, atol=1e-9)
    x, y = np.array([[1.0, 0.0, 0.0, 2.0]]), np.array([[0.0, 1.0, 0.0, -1.0]])
    by_hand = -0.39 + np.array([slope[0], slope[1], 0.0, 2.0 * slope[0] - slope[1]])
    np.testing.assert_allclose(ground.at(x, y)[0], by_hand, rtol=1e-4)


def test_roughness_is_the_largest_distance_from_the_plane() -> None:
    """Feet 0.4 m apart in front and 0.2 m behind leave (1, -1, -2, 2) / 10 of the first height: 0.01 m at most."""
    now = standing_on([0.0] * 4)
    feet = np.column_stack(([0.3, 0.3, -0.3, -0.3], [0.2, -0.2, 0.1, -0.1], [-0.35, -0.4, -0.4, -0.4]))
    prints = TerrainEstimator(slope_time=0.2, period=0.01)
    prints.ground(now._replace(bodies=now.bodies._replace(feet=feet[None])), ALL)
    np.testing.assert_allclose(prints.roughness, 0.01 * 0.01 / 1.01, rtol=1e-3)


def test_footprints_pass_under_the_trunk_until_their_foot_lands_again() -> None:
    """In 10 ms at (1, -0.5, 0.2) m/s and 2 rad/s, a print (x, y) moves by -0.01 (1 - 2 y, -0.5 + 2 x, 0.2)."""
    prints = TerrainEstimator(slope_time=0.2, period=0.01)
    prints.ground(standing_on([-0.4] * 4), ALL)
    moving = standing_on([-0.3] * 4, linear_velocity=(1.0, -0.5, 0.2), angular_velocity=(0.0, 0.0, 2.0))
    prints.ground(moving, np.array([[True, False, False, False]]))
    np.testing.assert_allclose(prints.footprints[:, 0, 0], [0.25, 0.2, -0.3], atol=1e-7)
    np.testing.assert_allclose(prints.footprints[:, 1, 0], [0.25 - 0.014, -0.2, -0.402], atol=1e-7)
    np.testing.assert_allclose(prints.footprints[:, 2, 0], [-0.25 - 0.006, 0.2 + 0.01, -0.402], atol=1e-7)
    np.testing.assert_allclose(prints.footprints[:, 3, 0], [-0.25 - 0.014, -0.2 + 0.01, -0.402], atol=1e-7)


def test_no_slope_beyond_the_steepest_is_believed() -> None:
    """Feet on slopes of 1 ahead and -0.9 to the left give final slopes of 0.6 and -0.6."""
    prints, now = TerrainEstimator(slope_time=0.02, period=0.01), standing_on([-0.33, 0.03, -0.83, -0.47])
    for _ in range(60):
        ground = prints.ground(now, ALL)
    np.testing.assert_allclose([ground.forward[0], ground.lateral[0]], [0.6, -0.6], atol=1e-6)


def test_the_slope_turns_with_the_heading_frame() -> None:
    """A robot turns at 1.5 rad/s on a slope; a mean in the rotating frame would have an error of 0.1."""
    prints, yaw_rate, period, rise = TerrainEstimator(slope_time=0.3, period=0.01), 1.5, 0.01, 0.25
    now = compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), reading(1, angular_velocity=(0.0, 0.0, yaw_rate)))
    uphill = np.zeros(2)
    for step in range(300):
        uphill = rise * np.array([np.cos(yaw_rate * period * step), -np.sin(yaw_rate * period * step)])
        feet = now.bodies.feet.copy()
        feet[..., 2] = -0.4 + feet[..., :2] @ uphill
        ground = prints.ground(now._replace(bodies=now.bodies._replace(feet=feet)), np.ones((1, 4), np.bool_))
    np.testing.assert_allclose([ground.forward[0], ground.lateral[0]], uphill, atol=0.01)
