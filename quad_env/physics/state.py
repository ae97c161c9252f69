"""State of one robot or of n robots for observations, rewards and falls; conversions between frames."""

from collections.abc import Sequence
from typing import Any, Generic, NamedTuple

from quad_env.columns import BoolOrMask, Components, ScalarOrBatch, all_true, sqrt, sum_of_magnitudes, where

Rotation = tuple[Components[ScalarOrBatch], Components[ScalarOrBatch], Components[ScalarOrBatch]]
"""Rotation matrix from the base frame to the world frame: three rows of three components each."""


class QuadState(NamedTuple, Generic[ScalarOrBatch]):
    """State of one robot or of n robots, from which observations, rewards and terminations are computed.

    Every component is a float for one robot, or an array (n,) for n robots; see `quad_env.columns`. A shape such as (3)
    gives the number of components. `Simulation.state` creates a state after every control step.
    """

    position: Components[ScalarOrBatch]
    """Position of the trunk centre, world frame, (3), m."""
    height: ScalarOrBatch
    """Height of the trunk centre above the terrain below it, m."""
    standing_height: float
    """Height of the trunk centre in the home pose on level ground, m."""
    rotation: Rotation[ScalarOrBatch]
    """Rotation matrix from the base frame to the world frame: three rows of three components."""
    linear_velocity: Components[ScalarOrBatch]
    """Velocity of the trunk centre, base frame, (3), m/s."""
    angular_velocity: Components[ScalarOrBatch]
    """Angular velocity of the trunk, base frame, (3), rad/s."""
    heading_velocity: Components[ScalarOrBatch]
    """Velocity of the trunk in the heading frame (world frame rotated by the yaw), (3).

    The components are the forward and the lateral velocity, m/s, and the yaw rate about the vertical, rad/s.
    """
    vertical_velocity: ScalarOrBatch
    """Vertical velocity of the trunk centre, world frame, m/s."""
    joint_position: Components[ScalarOrBatch]
    """Joint angles, (12), rad."""
    joint_velocity: Components[ScalarOrBatch]
    """Joint velocities, (12), rad/s."""
    joint_torque: Components[ScalarOrBatch]
    """Servo torques in the last physics step, (12), N·m."""
    trunk_contact: BoolOrMask
    """True if the trunk touched the ground in the last physics step."""
    command: Components[ScalarOrBatch]
    """Velocity command in the last control step, heading frame, (3): forward and lateral m/s, yaw rate rad/s."""
    action: Components[ScalarOrBatch]
    """Joint targets of the last control step after clipping, (12), rad."""
    previous_action: Components[ScalarOrBatch]
    """Joint targets of the control step before the last one, (12), rad."""
    swing_time: Components[ScalarOrBatch] | None = None
    """Duration of the swing phase of each foot that touched down in the last control step, (4), s.

    The value is 0 for other feet. A foot that was off the ground for only one control step bounced, which is no swing
    phase. None if no reward or observation term needs swing times.
    """
    touchdown_speed: Components[ScalarOrBatch] | None = None
    """Downward speed of each foot just before its touchdown in the last control step, world frame, (4), m/s.

    The value is 0 for feet that did not touch down. None if no reward or observation term needs touchdown speeds.
    """
    foot_contact: Sequence[Any] | None = None
    """True for each foot on the ground in the last physics step, (4).

    None if no reward or observation term needs foot contacts.
    """
    foot_height: Components[ScalarOrBatch] | None = None
    """Height of the underside of each foot above the terrain below it, (4), m.

    None if no reward or observation term needs foot heights.
    """
    foot_speed: Components[ScalarOrBatch] | None = None
    """Horizontal speed of each foot over the last control step, world frame, (4), m/s.

    None if no reward or observation term needs foot speeds.
    """
    leg_phase: Components[ScalarOrBatch] | None = None
    """Phase of each leg in the gait clock of the learner, (4), rad.

    The leg should swing from 0 to π, and stand from π to 2π. None if there is no gait clock, see
    `Simulation.leg_phase`.
    """
    home_pose: Sequence[float] = ()
    """Joint angles of the home pose, (12), rad."""
    joint_lower: Sequence[float] = ()
    """Lower joint limits, (12), rad."""
    joint_upper: Sequence[float] = ()
    """Upper joint limits, (12), rad."""

    @property
    def projected_gravity(self) -> Components[ScalarOrBatch]:
        """Unit vector of gravity in the base frame, (3)."""
        x, y, z = self.rotation[2]
        return -x, -y, -z

    @property
    def mechanical_power(self) -> ScalarOrBatch:
        """Mechanical power, W: the sum over the joints of the absolute product of torque and velocity."""
        return sum_of_magnitudes(self.joint_torque, self.joint_velocity)


def rotation_matrix(quaternion: Components[ScalarOrBatch]) -> Rotation[ScalarOrBatch]:
    """Convert a `quaternion` (w, x, y, z), of any length above 0, to the matrix of the same rotation."""
    w, x, y, z = quaternion
    norm = sqrt(w * w + x * x + y * y + z * z)
    w = w / norm
    x = x / norm
    y = y / norm
    z = z / norm
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def to_body(rotation: Rotation[ScalarOrBatch], vector_world: Components[ScalarOrBatch]) -> Components[ScalarOrBatch]:
    """Rotate a vector from the world frame to the base frame.

    Args:
        rotation: Rotation matrix R from the base frame to the world frame.
        vector_world: Vector v in the world frame, (3).

    Returns:
        Vector Rᵀ v in the base frame, (3).
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    x, y, z = vector_world
    return xx * x + yx * y + zx * z, xy * x + yy * y + zy * z, xz * x + yz * y + zz * z


def to_heading(
    rotation: Rotation[ScalarOrBatch], vector_world: Components[ScalarOrBatch]
) -> tuple[ScalarOrBatch, ScalarOrBatch]:
    """Return the horizontal components of a world-frame vector in the heading frame.

    The heading frame is the world frame, rotated about the vertical so that x points along the base frame's x axis. If
    the trunk points straight up or down, the heading frame is the world frame.

    Args:
        rotation: Rotation matrix from the base frame to the world frame.
        vector_world: World-frame vector, (2) or (3).

    Returns:
        forward: Component along the heading, in the unit of the vector.
        lateral: Component to the left, in the unit of the vector.
    """
    forward_x, forward_y = rotation[0][0], rotation[1][0]
    length = sqrt(forward_x * forward_x + forward_y * forward_y)
    has_heading = length > 1e-6
    if not all_true(has_heading):
        length = where(has_heading, length, 1.0)
        forward_x = where(has_heading, forward_x, 1.0)
        forward_y = where(has_heading, forward_y, 0.0)
    cos = forward_x / length
    sin = forward_y / length
    x, y = vector_world[0], vector_world[1]
    return cos * x + sin * y, cos * y - sin * x


def heading_velocity(
    rotation: Rotation[ScalarOrBatch], linear_world: Components[ScalarOrBatch], angular_body: Components[ScalarOrBatch]
) -> Components[ScalarOrBatch]:
    """Compute the trunk velocity in the heading frame, which the velocity commands also use.

    Args:
        rotation: Rotation matrix from the base frame to the world frame.
        linear_world: Linear velocity of the trunk, world frame, (3), m/s.
        angular_body: Angular velocity of the trunk, base frame, (3), rad/s.

    Returns:
        Forward and lateral velocity, heading frame, m/s, and yaw rate about the world's vertical, rad/s, (3).
    """
    forward, lateral = to_heading(rotation, linear_world)
    up = rotation[2]
    roll, pitch, yaw = angular_body
    return forward, lateral, up[0] * roll + up[1] * pitch + up[2] * yaw
