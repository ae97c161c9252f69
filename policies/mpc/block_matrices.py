"""Products and inverses of batches of small matrices, for the implicit integration in `servo_step`.

The results for a robot have the same bits for any number of robots in the batch. An array has the axes of the matrix
first and the axis of the robots last, because NumPy is fast along the last axis.
"""

import numpy as np

from policies.gait_cycle import Floats
from quad_env.columns import ordered_sum


def multiply(a: Floats, b: Floats) -> Floats:
    """Return the matrix products a b of a batch of matrices.

    The sums are added in the same order for any batch size, so that the result has the same bits.

    Args:
        a: Left matrices, (i, j, …); the axes … of the batch are last.
        b: Right matrices, (j, k, …), with the axes … of the same batch.

    Returns:
        Products, (i, k, …).
    """
    return ordered_sum(column[:, None] * row for column, row in zip(a.swapaxes(0, 1), b, strict=True))


def transpose(matrices: Floats) -> Floats:
    """Return the transposes, (j, i, …), of a batch of `matrices`, (i, j, …); the axes … of the batch are last."""
    return matrices.swapaxes(0, 1)


def add_to_diagonal(matrices: Floats, values: Floats) -> None:
    """Add values to the diagonals of a batch of matrices, in place.

    Args:
        matrices: Square matrices, (i, i, …); the axes … of the batch are last.
        values: Diagonal elements to add, (i, …) or an array that broadcasts to this shape.
    """
    diagonal = np.arange(len(matrices))
    matrices[diagonal, diagonal] += values


def invert_3x3(matrices: Floats) -> Floats:
    """Return the inverses, (3, 3, …), of a batch of `matrices`, (3, 3, …); the axes … of the batch are last.

    An inverse is the transposed matrix of cofactors divided by the determinant.
    """
    x, y, z = matrices
    cofactors = np.stack([_cross(y, z), _cross(z, x), _cross(x, y)], axis=1)
    inverse: Floats = cofactors / ordered_sum(x * cofactors[:, 0])
    return inverse


def _cross(a: Floats, b: Floats) -> Floats:
    """Return the cross products a × b, (3, …), of two batches of vectors, (3, …); the axes … of the batch are last."""
    return np.stack((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))
