"""Which feet of a robot under model-predictive control stand: by the gait, and by the forces that are felt."""

from typing import NamedTuple

import numpy as np

from policies.gait import Floats, LegCycle
from policies.mpc.parameters import MpcParameters
from quad_env.columns import Mask

LATEST = 0.5
"""Share of a stance up to which a foot in the air is still on its way down; later the gait goes on without it."""
EARLIEST = 0.6
"""Share of a swing from which on a foot may land."""


class ContactStates(NamedTuple):
    """Which feet stand, and why; (n, 4)."""

    standing: Mask
    """That bear the robot now."""
    late: Mask
    """That should stand and have not touched the ground yet."""
    landed: Mask
    """Whose places tell of the ground."""


def contact_states(
    p: MpcParameters, cycle: LegCycle, felt: LegCycle, force: Floats, new: Mask, *, flies: bool
) -> ContactStates:
    """Contacts by the gait now and when the vertical forces of the feet were `felt`, (n, 4), N.

    `new`: robots that have felt nothing yet, (n,); `flies`: whether all feet may be in the air together.
    """
    old = ~new[:, None]
    touching = force > p.touch_force
    late = ~cycle.swing & ~felt.swing & ~touching & (cycle.progress < LATEST) & old
    early = cycle.swing & felt.swing & (force > p.early_force) & (felt.progress > EARLIEST)
    standing = (~cycle.swing & ~late) | early
    if not flies:
        # Something has to bear the robot, even in the plan of one that is thrown up.
        standing = np.where(standing.any(axis=1, keepdims=True), standing, ~cycle.swing)
    return ContactStates(standing, late, (~cycle.swing & touching & ~late) | early | ~old)
