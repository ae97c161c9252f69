"""Products and inverses of batches of small matrices, for the implicit integration in `servo_step`.

The results are bit-identical for any number of robots in the batch. The axes of a matrix come first and the axis of the
robots is last, because NumPy is fast along the last axis.
"""

import numpy as np

from policies.gait_cycle import Floats
from quad_env.columns import ordered_sum


def multiply(a: Floats, b: Floats) -> Floats:
    """Return the matrix products a b of a batch of matrices.

    The sums are added in the same order for any batch size, so that the result has the same bits.

    Args:
        a: Left matrices, (i, j, …); the axes of the batch are last.
        b: Right matrices, (j, k, …).

    Returns:
        Products, (i, k, …).
    """
    return ordered_sum(column[:, None] * row for column, row in zip(a.swapaxes(0, 1), b, strict=True))


def transpose(matrices: Floats) -> Floats:
    """Return the transposes, (j, i, …), of a batch of matrices, (i, j, …)."""
    return matrices.swapaxes(0, 1)


def add_to_diagonal(matrices: Floats, values: Floats) -> None:
    """Add `values`, (i, …) or broadcastable, to the diagonals of `matrices`, (i, i, …), in place."""
    diagonal = np.arange(len(matrices))
    matrices[diagonal, diagonal] += values


def invert_3x3(matrices: Floats) -> Floats:
    """Return the inverses, (3, 3, …), of a batch of `matrices`, (3, 3, …), computed by their cofactors."""
    x, y, z = matrices
    cofactors = np.stack([_cross(y, z), _cross(z, x), _cross(x, y)], axis=1)
    inverse: Floats = cofactors / ordered_sum(x * cofactors[:, 0])
    return inverse


def _cross(a: Floats, b: Floats) -> Floats:
    """Return the cross products a × b, (3, …), of two batches of vectors, (3, …)."""
    return np.stack((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))
