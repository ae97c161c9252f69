"""Arithmetic for formulas that give identical bits for floats (one robot) and arrays (n robots).

NumPy and Python round + - * / and sqrt equally, so results do not depend on the number of robots or on the type. The
function `ordered_sum` adds in order, because NumPy's sum adds pairwise, and Python's sum compensates rounding errors.
The environment of one robot uses floats, because arrays of length one would make it about three times as slow.
"""

import math
import operator
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Type of NumPy arrays with double precision, of any shape."""
Mask = NDArray[np.bool_]
"""Type of NumPy arrays of bool, such as one bool per robot."""
EnvIndices = NDArray[np.intp]
"""Type of arrays with the indices of k robots that are selected from the n simulated robots, (k,)."""
EnvSelection = slice | EnvIndices
"""Type of a selection from the n simulated robots: a slice, or an array with indices, (k,)."""
ScalarOrBatch = TypeVar("ScalarOrBatch", float, Array)
"""Type of one quantity: a float for one robot, or an array (n,) for n robots."""
Components = Sequence[ScalarOrBatch]
"""Type of a vector with k components: k floats for one robot, or k arrays (n,) for n robots.

The vector is a tuple, or an array (k, n).
"""
ComponentReader = Callable[[Array], Components[ScalarOrBatch]]
"""Type of functions that select robots from an array with one row per robot.

The function takes the array of all robots, (n, k), and returns the k components of the selected robots.
"""
BoolOrMask = bool | Mask
"""Type of a condition: a bool for one robot, or a mask (n,) for n robots; both support `&` and `|`."""


def to_components(rows: Array) -> Components[Array]:
    """Transpose `rows`, one row per robot, (n, k), to a new array with one row per component, (k, n)."""
    return cast("Components[Array]", rows.T.copy())


def to_scalars(rows: Array) -> Components[float]:
    """Convert an array with the row of a single robot, `rows`, (1, k), to a tuple of k floats."""
    return tuple(rows.tolist()[0])


def component_reader(env_ids: EnvSelection | None) -> ComponentReader[Any]:
    """Return a function that reads the components of the selected robots `env_ids` from an array.

    The function takes an array with one row per robot, (n, k), and returns the components as an array, (k, m), of m
    selected robots, or as k floats of the only robot if `env_ids` is None.
    """
    return to_scalars if env_ids is None else lambda rows: to_components(rows[env_ids])


def clipped_rows(
    vectors: Sequence[Components[ScalarOrBatch]], limits: tuple[NDArray[np.float32], NDArray[np.float32]]
) -> NDArray[np.float32]:
    """Concatenate the components of all `vectors` to a new array of float32 with one row per robot, and clip them.

    Args:
        vectors: Vectors with k components together.
        limits: Lower and upper bound of each component, (k,) each.

    Returns:
        Clipped components, (k,) for one robot, or (n, k) for n robots.
    """
    if isinstance(vectors[0][0], float):
        flat: list[Any] = []
        for vector in vectors:
            flat += vector
        rows = np.array(flat, np.float32)
    else:
        rows = np.concatenate(vectors, dtype=np.float32, casting="same_kind").T
    lower, upper = limits
    np.minimum(rows, upper, out=rows)
    return np.maximum(rows, lower, out=rows)


def ordered_sum(columns: Iterable[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the sum of the quantities `columns`, each a float or an array (n,), added in order.

    The fixed order of the additions makes the rounding the same for floats and arrays.
    """
    out: Any = 0.0
    for column in columns:
        out += column  # `columns` stays unchanged, because the first sum, 0.0 + column, is a new array.
    return out  # type: ignore[no-any-return]


def zeros_by_key(keys: Iterable[str], like: ScalarOrBatch) -> dict[str, ScalarOrBatch]:
    """Return a dictionary with each key of `keys`; each value is 0.0, or a new array of zeros, (n,), as `like` is."""
    if isinstance(like, float):
        return dict.fromkeys(keys, 0.0)
    return {key: np.zeros_like(like) for key in keys}


def differences(
    x: Components[ScalarOrBatch], y: Components[ScalarOrBatch] | Sequence[float]
) -> Components[ScalarOrBatch]:
    """Return the difference of the vectors, `x` - `y`, by component; `y` may be k floats for all robots."""
    return np.subtract(x.T, np.transpose(y)).T if isinstance(x, np.ndarray) else tuple(map(operator.sub, x, y))


def sum_of_squares(x: Components[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the sum of squares Σ xᵢ² over the components of the vector `x`, for each robot."""
    out: Any = 0.0
    for value in x:
        out += value * value
    return out  # type: ignore[no-any-return]


def sum_of_squared_differences(x: Components[ScalarOrBatch], y: Components[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the sum of squares Σ (xᵢ - yᵢ)² of the differences of the vectors `x` and `y`, for each robot."""
    out: Any = 0.0
    for difference in map(operator.sub, x, y):
        out += difference * difference
    return out  # type: ignore[no-any-return]


def sum_of_magnitudes(x: Components[ScalarOrBatch], y: Components[ScalarOrBatch]) -> ScalarOrBatch:
    """Return the sum of magnitudes Σ |xᵢ yᵢ| over the components of the vectors `x` and `y`, for each robot."""
    out: Any = 0.0
    for product in map(operator.mul, x, y):
        out += abs(product)
    return out  # type: ignore[no-any-return]


def fraction_above(x: Components[ScalarOrBatch], bound: float) -> ScalarOrBatch:
    """Return the fraction, 0 to 1, of the components of the vector `x` with a magnitude above `bound`."""
    if isinstance(x, np.ndarray):
        return cast("ScalarOrBatch", np.count_nonzero(np.abs(x) > bound, axis=0) / len(x))
    # The comparison with the bound is the usual case, and faster than the count.
    is_within = max(x) <= bound and min(x) >= -bound
    fraction: Any = 0.0 if is_within else sum(abs(value) > bound for value in x) / len(x)
    return fraction  # type: ignore[no-any-return]


def sqrt(x: ScalarOrBatch) -> ScalarOrBatch:
    """Return the square root of `x`, a float or an array (n,)."""
    return math.sqrt(x) if isinstance(x, float) else np.sqrt(x)


def exp(x: ScalarOrBatch) -> ScalarOrBatch:
    """Return the exponential of `x`, a float or an array (n,).

    NumPy also computes the exponential of a float, because the result of `math.exp` differs in the last bit.
    """
    return float(np.exp(x)) if isinstance(x, float) else np.exp(x)


def sin(x: ScalarOrBatch) -> ScalarOrBatch:
    """Return the sine of the angle `x`, rad, a float or an array (n,).

    NumPy also computes the sine of a float, so that floats and arrays give the same bits.
    """
    return float(np.sin(x)) if isinstance(x, float) else np.sin(x)


def clip(x: ScalarOrBatch, low: float, high: float) -> ScalarOrBatch:
    """Return `x`, a float or an array (n,), limited to the range from `low` to `high`."""
    return min(max(x, low), high) if isinstance(x, float) else np.clip(x, low, high)


def clipped_index(x: ScalarOrBatch, last: int) -> Any:
    """Return the integer part of a non-negative `x`, at most `last`, as an index or as indices (n,)."""
    return min(int(x), last) if isinstance(x, float) else np.minimum(x.astype(np.intp), last)


def where(truth: Any, x: Any, y: Any) -> Any:
    """Return `x` if the bool `truth` is True, else `y`; for a mask `truth`, (n,), choose for each robot."""
    if isinstance(truth, np.ndarray):
        return np.where(truth, x, y)
    return x if truth else y


def any_true(truth: BoolOrMask) -> bool:
    """Return True if the bool `truth` is True, or the mask `truth`, (n,), is True for any robot."""
    return truth if isinstance(truth, bool) else bool(truth.any())


def all_true(truth: BoolOrMask) -> bool:
    """Return True if the bool `truth` is True, or the mask `truth`, (n,), is True for all robots."""
    return truth if isinstance(truth, bool) else bool(truth.all())


def not_finite(x: Components[ScalarOrBatch]) -> BoolOrMask:
    """Return True if any component of the vector `x` is infinite or NaN; a mask (n,) for n robots."""
    if isinstance(x, np.ndarray):
        return cast("Mask", ~np.isfinite(x).all(axis=0))
    return not math.isfinite(sum(x))  # A sum with an infinite or NaN summand is not finite.
