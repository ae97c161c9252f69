"""Named readings, computed from the current positions and velocities, never from a substep earlier."""

from typing import Generic, NamedTuple

from quad_env.columns import BoolOrMask, Components, ScalarOrBatch, sqrt, sum_of_magnitudes, where

Rotation = tuple[Components[ScalarOrBatch], Components[ScalarOrBatch], Components[ScalarOrBatch]]
"""Rows of the matrix that turns base-frame vectors into world-frame ones."""


class QuadState(NamedTuple, Generic[ScalarOrBatch]):
    """Readings that observations, rewards, terminations and infos may look at, of one robot or of n: see `columns`."""

    position: Components[ScalarOrBatch]
    """Trunk centre in the world frame, (3), m."""
    height: ScalarOrBatch
    """Trunk centre above the terrain below it, m."""
    standing_height: float
    """The same in the home pose on level ground, m."""
    rotation: Rotation[ScalarOrBatch]
    """From the base frame to the world frame, (3)(3)."""
    linear_velocity: Components[ScalarOrBatch]
    """Velocity of the trunk's centre, in the base frame, (3), m/s."""
    angular_velocity: Components[ScalarOrBatch]
    """Angular velocity of the trunk, in the base frame, (3), rad/s."""
    heading_velocity: Components[ScalarOrBatch]
    """Forward and lateral velocity of the trunk's centre in the heading frame, m/s, and yaw rate about the world's
    vertical, rad/s; (3)."""
    vertical_velocity: ScalarOrBatch
    """World frame, m/s."""
    joint_position: Components[ScalarOrBatch]
    """(12), rad."""
    joint_velocity: Components[ScalarOrBatch]
    """(12), rad/s."""
    joint_torque: Components[ScalarOrBatch]
    """Servo torque during the last physics substep, (12), N·m."""
    trunk_contact: BoolOrMask
    """Whether the trunk touched the ground in the last physics substep."""
    command: Components[ScalarOrBatch]
    """In force during the step: forward and lateral velocity, m/s, and yaw rate, rad/s; (3)."""
    action: Components[ScalarOrBatch]
    """Joint targets of the step, clipped, (12), rad."""
    previous_action: Components[ScalarOrBatch]
    """Joint targets of the step before, (12), rad."""
    swing_time: Components[ScalarOrBatch] | None = None
    """Time in the air that a touch-down of each foot has ended in this control step, (4), s; 0 without a touch-down. A
    foot that is off the ground in one control step alone has bounced. None where no reward term asks for it."""
    touchdown_speed: Components[ScalarOrBatch] | None = None
    """Downward speed of each foot in the control step before it touched down, world frame, (4), m/s; 0 without a
    touch-down. None as `swing_time`."""

    @property
    def projected_gravity(self) -> Components[ScalarOrBatch]:
        """Unit vector of gravity in the base frame, (3)."""
        x, y, z = self.rotation[2]
        return -x, -y, -z

    @property
    def mechanical_power(self) -> ScalarOrBatch:
        """Σ ‖torque · joint speed‖ over the joints, W."""
        return sum_of_magnitudes(self.joint_torque, self.joint_velocity)


def rotation_matrix(quaternion: Components[ScalarOrBatch]) -> Rotation[ScalarOrBatch]:
    """Rotation matrix of a quaternion (w, x, y, z), which is normalised first."""
    w, x, y, z = quaternion
    norm = sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / norm, x / norm, y / norm, z / norm
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def to_body(rotation: Rotation[ScalarOrBatch], vector_world: Components[ScalarOrBatch]) -> Components[ScalarOrBatch]:
    """A world vector in the base frame, (3): Rᵀ v."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    x, y, z = vector_world
    return xx * x + yx * y + zx * z, xy * x + yy * y + zy * z, xz * x + yz * y + zz * z


def to_heading(
    rotation: Rotation[ScalarOrBatch], vector_world: Components[ScalarOrBatch]
) -> tuple[ScalarOrBatch, ScalarOrBatch]:
    """The forward and the lateral part of a world vector, (2 or 3), in the heading frame.

    That is the world frame turned about the vertical onto the base frame's x axis. A trunk that points straight up or
    down has no heading; the world's x axis stands in for it.
    """
    forward_x, forward_y = rotation[0][0], rotation[1][0]
    length = sqrt(forward_x * forward_x + forward_y * forward_y)
    upright = length > 1e-6
    safe = where(upright, length, 1.0)
    cos, sin = where(upright, forward_x / safe, 1.0), where(upright, forward_y / safe, 0.0)
    x, y = vector_world[0], vector_world[1]
    return cos * x + sin * y, cos * y - sin * x


def heading_velocity(
    rotation: Rotation[ScalarOrBatch], linear_world: Components[ScalarOrBatch], angular_body: Components[ScalarOrBatch]
) -> Components[ScalarOrBatch]:
    """Planar velocity in the heading frame and yaw rate about the world's vertical, (3)."""
    forward, lateral = to_heading(rotation, linear_world)
    up = rotation[2]
    roll, pitch, yaw = angular_body
    return forward, lateral, up[0] * roll + up[1] * pitch + up[2] * yaw
