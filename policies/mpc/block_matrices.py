"""Products and inverses of small matrices in batches, with the same bits for any number of robots.

The matrix indices come first and the robots last: NumPy is fast along the last axis.
"""

import numpy as np

from policies.gait_cycle import Floats
from quad_env.columns import ordered_sum


def multiply(a: Floats, b: Floats) -> Floats:
    """Return the products, (i, k, …), of matrices `a`, (i, j, …), and `b`, (j, k, …).

    The order of the sums is the same for any batch.

    Args:
        a: Matrices, (i, j, …).
        b: Matrices, (j, k, …).

    Returns:
        The products, (i, k, …).
    """
    return ordered_sum(column[:, None] * row for column, row in zip(a.swapaxes(0, 1), b, strict=True))


def transpose(matrices: Floats) -> Floats:
    """Return the transposes of matrices, (i, j, …), as (j, i, …)."""
    return matrices.swapaxes(0, 1)


def add_to_diagonal(matrices: Floats, values: Floats) -> None:
    """Add `values` to the diagonals of matrices, (i, i, …), in place."""
    diagonal = np.arange(len(matrices))
    matrices[diagonal, diagonal] += values


def invert_3x3(matrices: Floats) -> Floats:
    """Return the inverses of matrices, (3, 3, …), by their cofactors."""
    x, y, z = matrices
    cofactors = np.stack([_cross(y, z), _cross(z, x), _cross(x, y)], axis=1)
    inverse: Floats = cofactors / ordered_sum(x * cofactors[:, 0])
    return inverse


def _cross(a: Floats, b: Floats) -> Floats:
    """Return the cross products of vectors, (3, …)."""
    return np.stack((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))
