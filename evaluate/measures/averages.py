"""Sums and means over the steps of episodes, with the same bits for an episode alone and in any batch."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Recorded = NDArray[np.float32]
Numbers = NDArray[np.floating[Any]] | NDArray[np.integer[Any]]
Entry = TypeVar("Entry", bound=np.generic)


def upright_steps(fall_step: NDArray[np.int64], steps: int) -> Bools:
    """Return True for readings taken before the fall, (steps, n), of `steps` steps and `fall_step`, (n,)."""
    return np.asarray(np.arange(steps)[:, None] < fall_step)


def total(values: Floats) -> Floats:
    """Return the sum over the steps of (steps, n, …); contiguous memory fixes the order of the additions."""
    return np.asarray(np.ascontiguousarray(np.moveaxis(values, 0, -1)).sum(axis=-1))


def count(mask: Bools) -> NDArray[np.int64]:
    """Return the number of true steps of (steps, n, …) for each episode, (n, …)."""
    return np.asarray(np.count_nonzero(mask, axis=0))


def upright_mean(values: Floats, upright: Bools) -> Floats:
    """Return the mean over the upright steps.

    Args:
        values: (steps, n, …).
        upright: True for upright steps, (steps, n).

    Returns:
        Means, (n, …); NaN without an upright step.
    """
    sums = total(np.where(over_steps(upright, values), values, 0.0))
    return quotient(sums, over_steps(count(upright), values[0]))


def upright_share(mask: Bools, upright: Bools) -> Floats:
    """Return the fraction of the entries of the upright steps that are true.

    Args:
        mask: (steps, n, …).
        upright: True for upright steps, (steps, n).

    Returns:
        Fraction over the steps and all further axes, (n,); NaN without an upright step.
    """
    entries = mask[0, 0].size
    counts = count(mask & over_steps(upright, mask))
    return quotient(counts.reshape(len(counts), -1).sum(axis=1), count(upright) * entries)


def quotient(sums: Numbers, counts: Numbers) -> Floats:
    """Return `sums` / `counts`, NaN if the count is 0."""
    return np.where(counts > 0, sums / np.where(counts > 0, counts, 1), np.nan)


def planar(vectors: Floats) -> Floats:
    """Return the length of the first two entries of (…, k)."""
    return np.asarray(np.hypot(vectors[..., 0], vectors[..., 1]))


def over_steps(mask: NDArray[Entry], values: NDArray[Any]) -> NDArray[Entry]:
    """Return `mask` with trailing axes of length 1, so that it broadcasts with `values`."""
    return mask.reshape(mask.shape + (1,) * (values.ndim - mask.ndim))
