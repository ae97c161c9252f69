"""The smooth way from one thing to another."""

from policies.gait import Floats


def smoothstep(progress: Floats) -> Floats:
    """Share of the way, 0 to 1, at a progress of 0 to 1, elementwise: the cubic that begins and ends level."""
    return progress * progress * (3.0 - 2.0 * progress)
