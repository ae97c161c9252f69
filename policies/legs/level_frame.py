"""Level frame: coordinate frame with its origin at the trunk centre, x along the heading, z up.

A vector is a tuple of three arrays, one for each coordinate, or an array (3, …). The arrays of a tuple must broadcast.
"""

from typing import NamedTuple

import numpy as np

from policies.gait_cycle import Floats

Vector = tuple[Floats, Floats, Floats]
"""Type of the vectors of n robots: a tuple of their x, y and z coordinates, three arrays that broadcast."""

_NO_HEADING = 1e-6
"""Lower bound of `LevelFrame.level_x`, dimensionless.

The bound avoids a division by zero if the x axis of the trunk is vertical."""


class LevelFrame(NamedTuple):
    """Attitude of the trunks of n robots: components of the upward unit vector in the base frame.

    The function `level_frame` computes the attitude from the gravity vector. The attitude defines the rotation from the
    base frame to the level frame. Each field is an array (n,).
    """

    up_x: Floats
    """x component of the upward unit vector in the base frame, (n,); positive if the front of the trunk is up."""
    up_y: Floats
    """y component of the upward unit vector in the base frame, (n,); positive if the left side is up."""
    up_z: Floats
    """z component of the upward unit vector in the base frame, (n,): the cosine of the tilt of the trunk."""
    level_x: Floats
    """Length of the horizontal projection of the base frame's x axis (a unit vector), (n,), dimensionless."""

    @property
    def roll(self) -> Floats:
        """Roll angle of the trunk about +x, (n,), rad; positive if its left side is up."""
        return np.arctan2(self.up_y, self.up_z)

    @property
    def pitch(self) -> Floats:
        """Pitch angle of the trunk about +y, (n,), rad; positive if its front is down."""
        pitch: Floats = -np.arcsin(self.up_x.clip(-1.0, 1.0))
        return pitch

    def to_level(self, vector: Vector | Floats) -> Vector:
        """Rotate a `vector` from the base frame to the level frame (x along the heading, z up).

        The vector has three coordinates, each an array. In the base frame, with its unit vector e along x, the level
        frame has the axes z = up, y = up × e / |up × e| and x = y × z.
        """
        x, y, z = vector
        length = self.level_x
        across = self.up_y / length
        rise = self.up_z / length
        return (
            length * x - self.up_x * (across * y + rise * z),
            rise * y - across * z,
            self.up_x * x + self.up_y * y + self.up_z * z,
        )


def level_frame(projected_gravity: Floats) -> LevelFrame:
    """Compute the attitude of n trunks from their unit gravity vectors in the base frame, (3, n)."""
    up_x, up_y, up_z = -projected_gravity
    return LevelFrame(up_x, up_y, up_z, np.maximum(np.sqrt(up_y * up_y + up_z * up_z), _NO_HEADING))
