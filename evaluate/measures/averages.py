"""Sums and means over control steps, with bit-identical results for an episode alone and in a batch."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Recorded = NDArray[np.float32]
Numbers = NDArray[np.floating[Any]] | NDArray[np.integer[Any]]
Entry = TypeVar("Entry", bound=np.generic)


def upright_steps(fall_step: NDArray[np.int64], steps: int) -> Bools:
    """Return the mask of the control steps before each episode's fall (the upright steps).

    Args:
        fall_step: First control step after which the robot had fallen, (n,).
        steps: Number of control steps.

    Returns:
        True for steps before the fall, (steps, n).
    """
    return np.asarray(np.arange(steps)[:, None] < fall_step)


def total(values: Floats) -> Floats:
    """Return the sum of `values`, (steps, n, …), over the steps, (n, …).

    The values are first copied to contiguous memory, because the memory layout determines the order of the additions.
    """
    return np.asarray(np.ascontiguousarray(np.moveaxis(values, 0, -1)).sum(axis=-1))


def count(mask: Bools) -> NDArray[np.int64]:
    """Count the true steps of each episode in `mask`, (steps, n, …); the counts are integers, (n, …)."""
    return np.asarray(np.count_nonzero(mask, axis=0))


def upright_mean(values: Floats, upright: Bools) -> Floats:
    """Return the mean of `values` over the upright steps (the steps before a fall) of each episode.

    Args:
        values: Value in each control step, (steps, n, …).
        upright: True for upright steps, (steps, n).

    Returns:
        Means, (n, …); NaN if an episode has no upright step.
    """
    sums = total(np.where(over_steps(upright, values), values, 0.0))
    return quotient(sums, over_steps(count(upright), values[0]))


def upright_share(mask: Bools, upright: Bools) -> Floats:
    """Return the fraction of true entries of `mask` in the upright steps (before a fall) of each episode.

    Args:
        mask: Condition in each control step, (steps, n, …).
        upright: True for upright steps, (steps, n).

    Returns:
        Fraction over the upright steps and all further array axes, (n,); NaN if an episode has no upright step.
    """
    entries = mask[0, 0].size
    counts = count(mask & over_steps(upright, mask))
    return quotient(counts.reshape(len(counts), -1).sum(axis=1), count(upright) * entries)


def quotient(sums: Numbers, counts: Numbers) -> Floats:
    """Return `sums` / `counts` elementwise, with NaN where the count is 0."""
    return np.where(counts > 0, sums / np.where(counts > 0, counts, 1), np.nan)


def planar(vectors: Floats) -> Floats:
    """Return the horizontal length of `vectors`, (…, k), computed from their first two components, (…)."""
    return np.asarray(np.hypot(vectors[..., 0], vectors[..., 1]))


def over_steps(mask: NDArray[Entry], values: NDArray[Any]) -> NDArray[Entry]:
    """Append array axes of length 1 to `mask`, (steps, n), so that the mask broadcasts with `values`."""
    return mask.reshape(mask.shape + (1,) * (values.ndim - mask.ndim))
