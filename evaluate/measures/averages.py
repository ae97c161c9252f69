"""Sums and means over control steps; results are bit-identical for an episode alone and in a batch."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Recorded = NDArray[np.float32]
Numbers = NDArray[np.floating[Any]] | NDArray[np.integer[Any]]
Entry = TypeVar("Entry", bound=np.generic)


def upright_steps(fall_step: NDArray[np.int64], steps: int) -> Bools:
    """Return True for the upright steps, which are the control steps before the fall in each episode.

    Args:
        fall_step: First control step after which the robot had fallen, (n,).
        steps: Number of control steps.

    Returns:
        True for steps before the fall, (steps, n).
    """
    return np.asarray(np.arange(steps)[:, None] < fall_step)


def total(values: Floats) -> Floats:
    """Return the sum of `values`, (steps, n, …), over the control steps of each of n episodes, (n, …).

    The values are first copied to contiguous memory, because the memory layout determines the order of the additions,
    and the order changes the last bits of the sum.
    """
    return np.asarray(np.ascontiguousarray(np.moveaxis(values, 0, -1)).sum(axis=-1))


def count(mask: Bools) -> NDArray[np.int64]:
    """Count the control steps of each of n episodes in which `mask`, (steps, n, …), is True, (n, …)."""
    return np.asarray(np.count_nonzero(mask, axis=0))


def upright_mean(values: Floats, upright: Bools) -> Floats:
    """Return the mean of `values` over the upright steps (control steps before a fall) of each episode.

    Args:
        values: Value in each control step, (steps, n, …).
        upright: True for upright steps, (steps, n).

    Returns:
        Means, (n, …); NaN if an episode has no upright step.
    """
    sums = total(np.where(over_steps(upright, values), values, 0.0))
    return quotient(sums, over_steps(count(upright), values[0]))


def upright_share(mask: Bools, upright: Bools) -> Floats:
    """Return the fraction of the upright steps (before a fall) of each episode in which a condition holds.

    Args:
        mask: True if the condition holds, in each control step and for each foot or joint, (steps, n, …).
        upright: True for upright steps, (steps, n).

    Returns:
        Fraction of the true elements over the upright steps and all further array axes, (n,); NaN if an episode has no
        upright step.
    """
    entries = mask[0, 0].size
    counts = count(mask & over_steps(upright, mask))
    return quotient(counts.reshape(len(counts), -1).sum(axis=1), count(upright) * entries)


def quotient(sums: Numbers, counts: Numbers) -> Floats:
    """Return `sums` divided by `counts`, element by element; the result is NaN for a count of 0."""
    return np.where(counts > 0, sums / np.where(counts > 0, counts, 1), np.nan)


def planar(vectors: Floats) -> Floats:
    """Return the horizontal length, (…), of `vectors`, (…, k): the first two of k components are x and y."""
    return np.asarray(np.hypot(vectors[..., 0], vectors[..., 1]))


def over_steps(mask: NDArray[Entry], values: NDArray[Any]) -> NDArray[Entry]:
    """Append axes of length 1 to `mask`, (steps, n), so that it broadcasts with `values`, (steps, n, …)."""
    return mask.reshape(mask.shape + (1,) * (values.ndim - mask.ndim))
