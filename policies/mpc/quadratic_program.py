"""Small dense quadratic programs of one shape: minimise ½ xᵀHx + gᵀx where lower ≤ Ax ≤ upper."""

from collections.abc import Callable
from typing import NamedTuple

import daqp
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

EQUALITY = 5
"""How DAQP marks a row that holds with equality."""
SOLVED = 1
"""DAQP's answer where it has found the optimum."""
LARGEST_RESIDUAL = 1e-4
"""Up to which a solution is one: any of `Residuals`."""
MOST_ITERATIONS = 300
"""Of DAQP, ten times what a robot's programs take: one that needs more comes too late. Every machine counts alike."""


class Programs(NamedTuple):
    """g quadratic programs of k variables and m rows; the first `equalities` rows have lower = upper."""

    hessian: Floats
    """(g, k, k), positive definite."""
    gradient: Floats
    """(g, k)."""
    rows: Floats
    """(g, m, k)."""
    lower: Floats
    """(g, m)."""
    upper: Floats
    """(g, m)."""
    equalities: int = 0


class Residuals(NamedTuple):
    """How far g answers are from the conditions of Karush, Kuhn and Tucker; (g,) each, NaN where an answer is."""

    stationarity: Floats
    """Largest entry of Hx + g + Aᵀλ, relative to the largest of g or 1."""
    violation: Floats
    """Of the worst row, relative to the largest finite bound or 1."""
    sign: Floats
    """Largest multiplier that pulls where there is no bound, relative to the largest multiplier or 1."""
    slackness: Floats
    """Largest product of a multiplier and its row's distance from the bound, relative to |gᵀx| or 1."""

    @property
    def worst(self) -> Floats:
        """The largest of all, (g,)."""
        worst: Floats = np.max(self, axis=0)
        return worst


class Solutions(NamedTuple):
    """What came of g programs."""

    value: Floats
    """(g, k)."""
    multipliers: Floats
    """λ of each row, positive at its upper bound and negative at its lower one, (g, m)."""
    solved: NDArray[np.bool_]
    """Whether the solver says so, and the residuals too; (g,)."""
    residuals: Residuals


Solver = Callable[[Programs], Solutions]


def solve(programs: Programs) -> Solutions:
    """The minima, by DAQP's dual active-set method, program by program; the residuals are worked out here.

    A program without an answer within `MOST_ITERATIONS` is not solved.
    """
    hessian, gradient, rows, lower, upper = (np.ascontiguousarray(part) for part in programs[:5])
    value, multipliers = np.empty_like(gradient), np.empty_like(lower)
    sense = np.zeros(lower.shape[1], dtype=np.intc)
    sense[: programs.equalities] = EQUALITY
    answers = np.empty(len(gradient), np.int64)
    for i in range(len(gradient)):
        value[i], _, answers[i], info = daqp.solve(
            hessian[i], gradient[i], rows[i], upper[i], lower[i], sense.copy(), iter_limit=MOST_ITERATIONS
        )
        # DAQP leaves them unset where there is no minimum.
        multipliers[i] = info["lam"] if answers[i] == SOLVED else 0.0
    found = residuals(programs, value, multipliers)
    return Solutions(value, multipliers, (answers == SOLVED) & (found.worst < LARGEST_RESIDUAL), found)


def residuals(programs: Programs, value: Floats, multipliers: Floats) -> Residuals:
    """Residuals of these answers, (g, k), with these multipliers, (g, m)."""
    hessian, gradient, rows, lower, upper, _ = programs
    reached = np.matmul(rows, value[..., None])[..., 0]
    pulled = np.matmul(multipliers[:, None], rows)[:, 0]
    slope = np.matmul(hessian, value[..., None])[..., 0] + gradient + pulled
    above, below = np.isfinite(upper), np.isfinite(lower)
    up, down = np.maximum(multipliers, 0.0), np.maximum(-multipliers, 0.0)
    bounds = np.maximum(_largest(np.where(above, upper, 0.0)), _largest(np.where(below, lower, 0.0)))
    loose = np.maximum(up * np.where(above, upper - reached, 0.0), down * np.where(below, reached - lower, 0.0))
    return Residuals(
        _largest(slope) / np.maximum(_largest(gradient), 1.0),
        _largest(np.maximum(np.maximum(reached - upper, lower - reached), 0.0)) / np.maximum(bounds, 1.0),
        _largest(np.where(above, 0.0, up) + np.where(below, 0.0, down)) / np.maximum(_largest(multipliers), 1.0),
        _largest(loose) / np.maximum(np.abs((gradient * value).sum(axis=1)), 1.0),
    )


def _largest(values: Floats) -> Floats:
    """Largest magnitude of each program's, (g,)."""
    largest: Floats = np.abs(values).max(axis=1, initial=0.0)
    return largest
