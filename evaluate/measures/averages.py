"""Sums and means over control steps; an episode's result is bit-identical alone and in any batch."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Recorded = NDArray[np.float32]
Numbers = NDArray[np.floating[Any]] | NDArray[np.integer[Any]]
Entry = TypeVar("Entry", bound=np.generic)


def upright_steps(fall_step: NDArray[np.int64], steps: int) -> Bools:
    """Return the mask of the control steps before each episode's fall.

    Args:
        fall_step: First control step after which the robot had fallen, (n,).
        steps: Number of control steps.

    Returns:
        True for upright steps, (steps, n).
    """
    return np.asarray(np.arange(steps)[:, None] < fall_step)


def total(values: Floats) -> Floats:
    """Return the sum of `values`, (steps, n, …), over the steps, (n, …).

    The values are first made contiguous, because the memory layout determines the order of the additions.
    """
    return np.asarray(np.ascontiguousarray(np.moveaxis(values, 0, -1)).sum(axis=-1))


def count(mask: Bools) -> NDArray[np.int64]:
    """Count the true steps of each episode in `mask`, (steps, n, …), as integers, (n, …)."""
    return np.asarray(np.count_nonzero(mask, axis=0))


def upright_mean(values: Floats, upright: Bools) -> Floats:
    """Return the mean over the upright steps.

    Args:
        values: Values of each step, (steps, n, …).
        upright: True for upright steps, (steps, n).

    Returns:
        Means, (n, …); NaN if an episode has no upright step.
    """
    sums = total(np.where(over_steps(upright, values), values, 0.0))
    return quotient(sums, over_steps(count(upright), values[0]))


def upright_share(mask: Bools, upright: Bools) -> Floats:
    """Return the fraction of true entries of `mask` in the upright steps.

    Args:
        mask: Boolean values of each step, (steps, n, …).
        upright: True for upright steps, (steps, n).

    Returns:
        Fraction over the steps and all further array axes, (n,); NaN if an episode has no upright step.
    """
    entries = mask[0, 0].size
    counts = count(mask & over_steps(upright, mask))
    return quotient(counts.reshape(len(counts), -1).sum(axis=1), count(upright) * entries)


def quotient(sums: Numbers, counts: Numbers) -> Floats:
    """Return `sums` / `counts`, with NaN where the count is 0."""
    return np.where(counts > 0, sums / np.where(counts > 0, counts, 1), np.nan)


def planar(vectors: Floats) -> Floats:
    """Return the horizontal length, (…), of `vectors`, (…, k), from the first two entries."""
    return np.asarray(np.hypot(vectors[..., 0], vectors[..., 1]))


def over_steps(mask: NDArray[Entry], values: NDArray[Any]) -> NDArray[Entry]:
    """Append axes of length 1 to `mask`, so that the mask broadcasts with `values`."""
    return mask.reshape(mask.shape + (1,) * (values.ndim - mask.ndim))
