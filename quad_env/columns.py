"""Scalar-or-batch arithmetic: one formula for floats (one robot) and arrays (n,), with equal bits.

NumPy and Python round + - * / and sqrt equally, so results do not depend on the batch size or on the type. The function
`ordered_sum` adds in order, because NumPy's sum adds pairwise and Python's sum compensates rounding errors.
The single environment uses floats, because they make it about three times as fast as a batch of one.
"""

import math
import operator
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Double-precision array."""
Mask = NDArray[np.bool_]
"""Array of bool."""
EnvIndices = NDArray[np.intp]
"""Indices of some robots in a batch, (k,)."""
EnvSelection = slice | EnvIndices
"""Selection of robots in a batch: a slice, or indices (k,)."""
ScalarOrBatch = TypeVar("ScalarOrBatch", float, Array)
"""Float for one robot, or array (n,) for n robots."""
Components = Sequence[ScalarOrBatch]
"""Components of a vector: k floats for one robot, or k arrays (n,) for n robots, as a tuple or an array (k, n)."""
ComponentReader = Callable[[Array], Components[ScalarOrBatch]]
"""Function that takes an array of all robots, (n, k), and returns the k components of the selected robots."""
BoolOrMask = bool | Mask
"""Bool for one robot, or mask (n,) for n robots; both work with the operators `&` and `|`."""


def to_components(rows: Array) -> Components[Array]:
    """Convert `rows` of n robots, (n, k), to components, a new array (k, n)."""
    return cast("Components[Array]", rows.T.copy())


def to_scalars(rows: Array) -> Components[float]:
    """Convert `rows` of one robot, (1, k), to components, a tuple of k floats."""
    return tuple(rows.tolist()[0])


def component_reader(env_ids: EnvSelection | None) -> ComponentReader[Any]:
    """Return a function that reads the components of the robots `env_ids`; see `ComponentReader`.

    If `env_ids` is None, the function returns floats of the only robot.
    """
    return to_scalars if env_ids is None else lambda rows: to_components(rows[env_ids])


def in_single_precision(vectors: Sequence[Components[ScalarOrBatch]]) -> NDArray[np.float32]:
    """Concatenate the components of all `vectors` into a new array in single precision, (k,) or (k, n)."""
    if isinstance(vectors[0][0], float):
        flat: list[Any] = []
        for vector in vectors:
            flat += vector
        return np.array(flat, np.float32)
    return np.concatenate(vectors, dtype=np.float32, casting="same_kind")


def ordered_sum(columns: Iterable[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the sum of `columns`, added from the first to the last."""
    out: Any = 0.0
    for column in columns:
        out += column  # `columns` stay unchanged, because 0.0 + column is a new array
    return out  # type: ignore[no-any-return]


def differences(
    x: Components[ScalarOrBatch], y: Components[ScalarOrBatch] | Sequence[float]
) -> Components[ScalarOrBatch]:
    """Return the differences xᵢ - yᵢ of the components of `x` and `y`; numbers in `y` apply to all robots."""
    return np.subtract(x.T, np.transpose(y)).T if isinstance(x, np.ndarray) else tuple(map(operator.sub, x, y))


def sum_of_squares(x: Components[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the sum of squares Σ xᵢ² over the components of `x`."""
    products: Iterable[ScalarOrBatch] = map(operator.mul, x, x)
    return ordered_sum(products)


def sum_of_magnitudes(x: Components[ScalarOrBatch], y: Components[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the sum of magnitudes Σ |xᵢ yᵢ| over the components of `x` and `y`."""
    products: Iterable[ScalarOrBatch] = map(operator.mul, x, y)
    return ordered_sum(map(abs, products))


def fraction_above(x: Components[ScalarOrBatch], bound: float) -> ScalarOrBatch:
    """Return the fraction of the components xᵢ of `x` with a magnitude |xᵢ| above `bound`."""
    if isinstance(x, np.ndarray):
        return cast("ScalarOrBatch", np.count_nonzero(np.abs(x) > bound, axis=0) / len(x))
    # A list, because it is faster than a generator.
    return sum([value > bound or value < -bound for value in x]) / len(x)  # type: ignore[return-value]  # noqa: C419


def sqrt(x: ScalarOrBatch) -> ScalarOrBatch:
    """Return the square root of `x`."""
    return math.sqrt(x) if isinstance(x, float) else np.sqrt(x)


def exp(x: ScalarOrBatch) -> ScalarOrBatch:
    """Return the exponential of `x`.

    NumPy computes it for floats too, because the C library's result differs in the last bit.
    """
    return float(np.exp(x)) if isinstance(x, float) else np.exp(x)


def clip(x: ScalarOrBatch, low: float, high: float) -> ScalarOrBatch:
    """Return `x`, limited to the range from `low` to `high`."""
    return min(max(x, low), high) if isinstance(x, float) else np.clip(x, low, high)


def clipped_index(x: ScalarOrBatch, last: int) -> Any:
    """Return the integer part of a non-negative `x` as an index, limited to the index `last`."""
    return min(int(x), last) if isinstance(x, float) else np.minimum(x.astype(np.intp), last)


def where(truth: Any, x: Any, y: Any) -> Any:
    """Return `x` where `truth` is True, otherwise `y`."""
    if isinstance(truth, np.ndarray):
        return np.where(truth, x, y)
    return x if truth else y


def any_true(truth: BoolOrMask) -> bool:
    """Return True if `truth` is True for any robot."""
    return truth if isinstance(truth, bool) else bool(truth.any())


def not_finite(x: Components[ScalarOrBatch]) -> BoolOrMask:
    """Return True if any component of `x` is infinite or NaN."""
    if isinstance(x, np.ndarray):
        return cast("Mask", ~np.isfinite(x).all(axis=0))
    return not math.isfinite(sum(x))  # because a sum with an infinity or NaN is not finite
