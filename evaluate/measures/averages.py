"""Sums and means over the steps of episodes, an episode's bits the same alone and in any batch."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Recorded = NDArray[np.float32]
Numbers = NDArray[np.floating[Any]] | NDArray[np.integer[Any]]
Entry = TypeVar("Entry", bound=np.generic)


def upright_steps(fall_step: NDArray[np.int64], steps: int) -> Bools:
    """Whether each step's reading was taken before the fall, (steps, n)."""
    return np.asarray(np.arange(steps)[:, None] < fall_step)


def total(values: Floats) -> Floats:
    """Sum over the steps of (steps, n, …), each episode's laid out in a row."""
    return np.asarray(np.ascontiguousarray(np.moveaxis(values, 0, -1)).sum(axis=-1))


def count(truth: Bools) -> NDArray[np.int64]:
    """How many of the steps of (steps, n, …) are true, for each episode."""
    return np.asarray(np.count_nonzero(truth, axis=0))


def upright_mean(values: Floats, upright: Bools) -> Floats:
    """Mean of (steps, n, …) over the upright steps alone, (n, …); NaN where there is none."""
    return quotient(total(np.where(over_steps(upright, values), values, 0.0)), over_steps(count(upright), values[0]))


def upright_share(truth: Bools, upright: Bools) -> Floats:
    """Share of upright steps, and of all further axes, in which (steps, n, …) is true, (n,); NaN where none is."""
    entries = truth[0, 0].size
    found = count(truth & over_steps(upright, truth))
    return quotient(found.reshape(len(found), -1).sum(axis=1), count(upright) * entries)


def quotient(sums: Numbers, counts: Numbers) -> Floats:
    """sums / counts; NaN where the count is 0."""
    return np.where(counts > 0, sums / np.where(counts > 0, counts, 1), np.nan)


def planar(vectors: Floats) -> Floats:
    """Length of the first two entries of (…, k)."""
    return np.asarray(np.hypot(vectors[..., 0], vectors[..., 1]))


def over_steps(mask: NDArray[Entry], values: NDArray[Any]) -> NDArray[Entry]:
    """`mask` with trailing axes, so that it goes with `values`."""
    return mask.reshape(mask.shape + (1,) * (values.ndim - mask.ndim))
