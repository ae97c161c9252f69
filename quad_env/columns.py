"""Columns: a quantity as a float for one robot, or as an array (n,) for n robots; one formula serves both.

NumPy and Python round + - * / and sqrt alike, so a robot's bits are the same either way, in a batch of any size. Sums
are taken in order, by `total`: NumPy's own adds pairwise, and Python's compensates.
"""

import math
import operator
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
EnvIndices = NDArray[np.intp]
"""Places of some robots in a batch, (k,)."""
EnvSelection = slice | EnvIndices
ScalarOrBatch = TypeVar("ScalarOrBatch", float, Array)
Components = Sequence[ScalarOrBatch]
"""k columns: a tuple, or an array (k, n) of n robots'."""
ComponentReader = Callable[[Array], Components[ScalarOrBatch]]
"""Takes the components of the selected robots out of the rows of all, (n, k)."""
BoolOrMask = bool | Mask
"""A column of truth values; combine them with `&` and `|`."""


def to_components(rows: Array) -> Components[Array]:
    """The columns in the rows (n, k) of n robots, as a new array (k, n)."""
    return cast("Components[Array]", rows.T.copy())


def to_scalars(rows: Array) -> Components[float]:
    """The columns in the only row (1, k) of one robot."""
    return tuple(rows.tolist()[0])


def component_reader(env_ids: EnvSelection | None) -> ComponentReader[Any]:
    """Return the reader of the components of the robots `env_ids`; None: floats of the only robot."""
    return to_scalars if env_ids is None else lambda rows: to_components(rows[env_ids])


def in_single_precision(vectors: Sequence[Components[ScalarOrBatch]]) -> NDArray[np.float32]:
    """All columns of the vectors as one new array, (k,) or (k, n)."""
    if isinstance(vectors[0][0], float):
        flat: list[Any] = []
        for vector in vectors:
            flat += vector
        return np.array(flat, np.float32)
    return np.concatenate(vectors, dtype=np.float32, casting="same_kind")


def ordered_sum(columns: Iterable[ScalarOrBatch]) -> ScalarOrBatch:
    """Sum, from the first to the last."""
    out: Any = 0.0
    for column in columns:
        out += column  # 0.0 + column is a new array: none of `columns` changes
    return out  # type: ignore[no-any-return]


def differences(
    x: Components[ScalarOrBatch], y: Components[ScalarOrBatch] | Sequence[float]
) -> Components[ScalarOrBatch]:
    """xᵢ - yᵢ; `y` may be numbers."""
    return np.subtract(x.T, np.transpose(y)).T if isinstance(x, np.ndarray) else tuple(map(operator.sub, x, y))


def sum_of_squares(x: Components[ScalarOrBatch]) -> ScalarOrBatch:
    """Σ xᵢ²"""
    products: Iterable[ScalarOrBatch] = map(operator.mul, x, x)
    return ordered_sum(products)


def sum_of_magnitudes(x: Components[ScalarOrBatch], y: Components[ScalarOrBatch]) -> ScalarOrBatch:
    """Σ |xᵢ yᵢ|"""
    products: Iterable[ScalarOrBatch] = map(operator.mul, x, y)
    return ordered_sum(map(abs, products))


def fraction_above(x: Components[ScalarOrBatch], bound: float) -> ScalarOrBatch:
    """Share of the |xᵢ| above a bound."""
    if isinstance(x, np.ndarray):
        return cast("ScalarOrBatch", np.count_nonzero(np.abs(x) > bound, axis=0) / len(x))
    # A list takes less time than a generator.
    return sum([value > bound or value < -bound for value in x]) / len(x)  # type: ignore[return-value]  # noqa: C419


def sqrt(x: ScalarOrBatch) -> ScalarOrBatch:
    """Square root."""
    return math.sqrt(x) if isinstance(x, float) else np.sqrt(x)


def exp(x: ScalarOrBatch) -> ScalarOrBatch:
    """Exponential; NumPy's for the float too, since the C library's differs in the last bit."""
    return float(np.exp(x)) if isinstance(x, float) else np.exp(x)


def clip(x: ScalarOrBatch, low: float, high: float) -> ScalarOrBatch:
    """`x`, but at least `low` and at most `high`."""
    return min(max(x, low), high) if isinstance(x, float) else np.clip(x, low, high)


def clipped_index(x: ScalarOrBatch, last: int) -> Any:
    """The whole part of `x`, which is not negative, but at most `last`: an index."""
    return min(int(x), last) if isinstance(x, float) else np.minimum(x.astype(np.intp), last)


def where(truth: Any, x: Any, y: Any) -> Any:
    """`x` where it is true, else `y`."""
    if isinstance(truth, np.ndarray):
        return np.where(truth, x, y)
    return x if truth else y


def any_true(truth: BoolOrMask) -> bool:
    """Whether it is true of some robot."""
    return truth if isinstance(truth, bool) else bool(truth.any())


def not_finite(x: Components[ScalarOrBatch]) -> BoolOrMask:
    """Whether some xᵢ is infinite or NaN."""
    if isinstance(x, np.ndarray):
        return cast("Mask", ~np.isfinite(x).all(axis=0))
    return not math.isfinite(sum(x))  # which no infinity and no NaN leaves finite
