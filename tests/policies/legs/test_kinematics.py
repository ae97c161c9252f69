import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from policies.legs.kinematics import foot_positions, joint_angles, leg_angles, leg_height
from quad_env.robots.simple_quad import SIMPLE_QUAD

legs = st.lists(
    st.tuples(
        *(
            st.floats(low, high)
            for low, high in zip(SIMPLE_QUAD.joint_lower[:3], SIMPLE_QUAD.joint_upper[:3], strict=True)
        )
    ),
    min_size=4,
    max_size=4,
).map(np.array)


def drop_in_leg_plane(joints):
    return 0.3 * np.cos(joints[..., 1]) + 0.3 * np.cos(joints[..., 1] + joints[..., 2])


def test_home_pose_has_the_feet_right_below_the_thigh_joints():
    feet = foot_positions(SIMPLE_QUAD, SIMPLE_QUAD.home_pose.reshape(4, 3))
    np.testing.assert_allclose(feet[0], [0.0, 0.1, -0.6 * math.cos(0.5)], atol=1e-15)


def test_positive_hip_angle_swings_a_left_leg_out_and_a_right_leg_in():
    # The tip of the straight left leg, (0.1, -0.6) in the y-z plane, at 0.3 rad about +x; the right leg mirrors it.
    feet = foot_positions(SIMPLE_QUAD, np.tile([0.3, 0.0, 0.0], (4, 1)))
    np.testing.assert_allclose(feet[0, 1:], [0.2728457729, -0.5436498728], atol=1e-9)
    np.testing.assert_allclose(feet[1, 1:], [0.0817784751, -0.6027539142], atol=1e-9)


@given(legs)
def test_inverse_of_forward_is_the_identity_for_feet_below_the_thigh_joint(joints):
    joints[:, 2] = np.minimum(joints[:, 2], -1e-3)  # sqrt of the leg length near a straight knee
    below = drop_in_leg_plane(joints) > 1e-6
    np.testing.assert_allclose(
        joint_angles(SIMPLE_QUAD, foot_positions(SIMPLE_QUAD, joints))[below], joints[below], atol=1e-9
    )


@given(legs)
def test_forward_of_inverse_is_the_identity_over_the_whole_joint_space(joints):
    feet = foot_positions(SIMPLE_QUAD, joints)
    np.testing.assert_allclose(foot_positions(SIMPLE_QUAD, joint_angles(SIMPLE_QUAD, feet)), feet, atol=1e-9)


def test_target_too_far_becomes_the_straight_leg_towards_it():
    target = np.tile([0.5, 0.1, -0.5], (4, 1)) * [[1, 1, 1], [1, -1, 1], [1, 1, 1], [1, -1, 1]]
    feet = foot_positions(SIMPLE_QUAD, joint_angles(SIMPLE_QUAD, target))
    nearest = 0.6 / math.sqrt(0.5) * 0.5
    np.testing.assert_allclose(feet[0], [nearest, 0.1, -nearest], atol=1e-9)
    np.testing.assert_allclose(feet[1], [nearest, -0.1, -nearest], atol=1e-9)


def test_target_inside_the_hip_offset_is_answered_with_its_nearest_point():
    # 0.05 m from the hip axis; the offset keeps the foot 0.1 m away: twice the distance on the same ray.
    target = np.array([[-0.2, 0.03, -0.04]] * 4)
    np.testing.assert_allclose(
        foot_positions(SIMPLE_QUAD, joint_angles(SIMPLE_QUAD, target))[0], [-0.2, 0.06, -0.08], atol=1e-9
    )


def test_degenerate_targets_give_finite_angles():
    feet = np.array([[[0.0, 0.0, 0.0]] * 4, [[0.0, 0.1, 0.0]] * 4, [[9.0, 9.0, 9.0]] * 4])
    assert np.isfinite(joint_angles(SIMPLE_QUAD, feet)).all()


def test_angles_are_the_same_bits_with_the_legs_first_or_last_and_apart_or_not():
    rng = np.random.default_rng(1)
    feet = rng.uniform([-0.2, -0.3, -0.5], [0.2, 0.3, -0.2], (7, 4, 3))
    first = leg_angles(SIMPLE_QUAD, *np.moveaxis(feet, (1, 2), (1, 0)), legs_first=True)
    assert np.array_equal(np.transpose(first, (2, 1, 0)), joint_angles(SIMPLE_QUAD, feet))
    apart = np.stack(leg_angles(SIMPLE_QUAD, feet[..., 0], feet[..., 1], feet[..., 2]), axis=-1)
    assert np.array_equal(apart, joint_angles(SIMPLE_QUAD, feet))


def test_leg_height_of_the_home_pose_is_that_of_the_robot():
    gravity = np.array([[0.0, 0.0, -1.0]])
    np.testing.assert_allclose(
        leg_height(SIMPLE_QUAD, gravity, SIMPLE_QUAD.home_pose[None]), SIMPLE_QUAD.home_height, atol=1e-9
    )
    # Upside down, the lowest foot is above the trunk's centre by that distance minus the foot radius.
    np.testing.assert_allclose(
        leg_height(SIMPLE_QUAD, -gravity, SIMPLE_QUAD.home_pose[None]), -SIMPLE_QUAD.home_height + 0.04, atol=1e-9
    )
