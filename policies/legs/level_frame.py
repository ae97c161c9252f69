"""Level frame: origin at the trunk centre, x along the heading of the trunk, z up.

A vector is a tuple of three arrays that broadcast, or an array (3, …).
"""

from typing import NamedTuple

import numpy as np

from policies.gait_cycle import Floats

Vector = tuple[Floats, Floats, Floats]

_NO_HEADING = 1e-6
"""Lower bound of `LevelFrame.level_x`, which avoids a division by zero for a vertical trunk."""


class LevelFrame(NamedTuple):
    """Attitude of n trunks, given by the up direction of the world in the base frame.

    `level_frame` makes one from the gravity vector. Each field is (n,).
    """

    up_x: Floats
    """Component x of the up direction; positive if the nose is up."""
    up_y: Floats
    """Component y of the up direction; positive if the left side is up."""
    up_z: Floats
    """Component z of the up direction, the cosine of the tilt."""
    level_x: Floats
    """Length of the horizontal part of the trunk's x axis."""

    @property
    def roll(self) -> Floats:
        """Roll about +x, (n,), rad; positive if the left side is up."""
        return np.arctan2(self.up_y, self.up_z)

    @property
    def pitch(self) -> Floats:
        """Pitch about +y, (n,), rad; positive if the nose is down."""
        pitch: Floats = -np.arcsin(self.up_x.clip(-1.0, 1.0))
        return pitch

    def to_level(self, vector: Vector | Floats) -> Vector:
        """Rotate a `vector` from the base frame to the level frame.

        The axes of the level frame in the base frame are z = up, y = up × x / |up × x| and x = y × z.
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
    """Return the level frames of n robots from their unit gravity vectors, base frame, (3, n)."""
    up_x, up_y, up_z = -projected_gravity
    return LevelFrame(up_x, up_y, up_z, np.maximum(np.sqrt(up_y * up_y + up_z * up_z), _NO_HEADING))
