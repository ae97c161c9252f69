"""Scalar-or-batch arithmetic: one formula runs on floats (one robot) and on arrays (n,), with the same bits.

NumPy and Python round + - * / and sqrt equally, so the bits of a robot are the same either way, in a batch of any size.
Sums are taken in order by `ordered_sum`: NumPy's own adds pairwise, and Python's compensates. Floats make the single
environment about three times as fast as a batch of one.
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
"""Selection of robots in a batch."""
ScalarOrBatch = TypeVar("ScalarOrBatch", float, Array)
"""Float of one robot, or array (n,) of n robots."""
Components = Sequence[ScalarOrBatch]
"""k scalars or arrays (n,): a tuple, or an array (k, n)."""
ComponentReader = Callable[[Array], Components[ScalarOrBatch]]
"""Takes the components of the selected robots out of the rows of all, (n, k)."""
BoolOrMask = bool | Mask
"""Bool of one robot, or mask (n,); combine them with `&` and `|`."""


def to_components(rows: Array) -> Components[Array]:
    """Return the components of the `rows`, (n, k), of n robots, as a new array (k, n)."""
    return cast("Components[Array]", rows.T.copy())


def to_scalars(rows: Array) -> Components[float]:
    """Return the components of the only row of `rows`, (1, k), as floats."""
    return tuple(rows.tolist()[0])


def component_reader(env_ids: EnvSelection | None) -> ComponentReader[Any]:
    """Return the reader of the components of the robots `env_ids`; None: floats of the only robot."""
    return to_scalars if env_ids is None else lambda rows: to_components(rows[env_ids])


def in_single_precision(vectors: Sequence[Components[ScalarOrBatch]]) -> NDArray[np.float32]:
    """Return all components of the `vectors` as one new array, (k,) or (k, n)."""
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
        out += column  # 0.0 + column is a new array: none of `columns` changes
    return out  # type: ignore[no-any-return]


def differences(
    x: Components[ScalarOrBatch], y: Components[ScalarOrBatch] | Sequence[float]
) -> Components[ScalarOrBatch]:
    """Return xᵢ - yᵢ of the components of `x` and `y`; `y` may be numbers that hold for all robots."""
    return np.subtract(x.T, np.transpose(y)).T if isinstance(x, np.ndarray) else tuple(map(operator.sub, x, y))


def sum_of_squares(x: Components[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ xᵢ² of the components of `x`."""
    products: Iterable[ScalarOrBatch] = map(operator.mul, x, x)
    return ordered_sum(products)


def sum_of_magnitudes(x: Components[ScalarOrBatch], y: Components[ScalarOrBatch]) -> ScalarOrBatch:
    """Return Σ |xᵢ yᵢ| of the components of `x` and `y`."""
    products: Iterable[ScalarOrBatch] = map(operator.mul, x, y)
    return ordered_sum(map(abs, products))


def fraction_above(x: Components[ScalarOrBatch], bound: float) -> ScalarOrBatch:
    """Return the fraction of the |xᵢ| of `x` that exceed `bound`."""
    if isinstance(x, np.ndarray):
        return cast("ScalarOrBatch", np.count_nonzero(np.abs(x) > bound, axis=0) / len(x))
    # A list takes less time than a generator.
    return sum([value > bound or value < -bound for value in x]) / len(x)  # type: ignore[return-value]  # noqa: C419


def sqrt(x: ScalarOrBatch) -> ScalarOrBatch:
    """Return the square root."""
    return math.sqrt(x) if isinstance(x, float) else np.sqrt(x)


def exp(x: ScalarOrBatch) -> ScalarOrBatch:
    """Return the exponential; NumPy's for a float too, since the C library's differs in the last bit."""
    return float(np.exp(x)) if isinstance(x, float) else np.exp(x)


def clip(x: ScalarOrBatch, low: float, high: float) -> ScalarOrBatch:
    """Return `x`, limited to the range from `low` to `high`."""
    return min(max(x, low), high) if isinstance(x, float) else np.clip(x, low, high)


def clipped_index(x: ScalarOrBatch, last: int) -> Any:
    """Return the integer part of `x`, which must not be negative, limited to `last`: an index."""
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
    return not math.isfinite(sum(x))  # a sum with an infinity or NaN is not finite
