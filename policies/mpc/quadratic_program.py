"""Small dense quadratic programs of one shape: minimise ½ xᵀHx + gᵀx where lower ≤ Ax ≤ upper."""

from collections.abc import Callable
from typing import NamedTuple

import daqp
import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats

EQUALITY = 5
"""How DAQP marks a row that holds with equality."""
SOLVED = 1
"""DAQP's answer where it has found the optimum."""
LARGEST_VIOLATION = 1e-4
"""Of a row by a solution, relative to the largest of the program's finite bounds or 1."""
MOST_ITERATIONS = 300
"""Of DAQP, ten times what a robot's programs take: one that needs more comes too late. Every machine counts alike."""


class QpBatch(NamedTuple):
    """g quadratic programs of k variables and m rows; the first `equalities` rows have lower = upper."""

    hessian: Floats
    """(g, k, k), positive definite."""
    gradient: Floats
    """(g, k)."""
    constraint_matrix: Floats
    """(g, m, k)."""
    lower: Floats
    """(g, m)."""
    upper: Floats
    """(g, m)."""
    equalities: int = 0


class Solutions(NamedTuple):
    """What came of g programs."""

    x: Floats
    """(g, k)."""
    solved: NDArray[np.bool_]
    """Whether the solver says so, and the value is finite and within all bounds; (g,)."""


Solver = Callable[[QpBatch], Solutions]


def solve(programs: QpBatch) -> Solutions:
    """The minima, by DAQP's dual active-set method, program by program.

    A program without an answer within `MOST_ITERATIONS` is not solved.
    """
    hessian, gradient, constraint_matrix, lower, upper = (np.ascontiguousarray(part) for part in programs[:5])
    x, answers = np.empty_like(gradient), np.empty(len(gradient), np.int64)
    sense = np.zeros(lower.shape[1], dtype=np.intc)
    sense[: programs.equalities] = EQUALITY
    for i in range(len(gradient)):
        x[i], _, answers[i], _ = daqp.solve(
            hessian[i], gradient[i], constraint_matrix[i], upper[i], lower[i], sense.copy(), iter_limit=MOST_ITERATIONS
        )
    return Solutions(x, (answers == SOLVED) & _within(programs, x))


def _within(programs: QpBatch, value: Floats) -> NDArray[np.bool_]:
    """Whether these values, (g, k), are within the bounds but for `LARGEST_VIOLATION`, and finite; (g,)."""
    reached = np.matmul(programs.constraint_matrix, value[..., None])[..., 0]
    beyond: Floats = np.maximum(reached - programs.upper, programs.lower - reached).max(axis=1, initial=0.0)
    within = beyond < LARGEST_VIOLATION
    if within.all():
        return within
    bounds = np.concatenate((programs.lower, programs.upper), axis=1)
    largest: Floats = np.abs(np.where(np.isfinite(bounds), bounds, 0.0)).max(axis=1, initial=1.0)
    return beyond < LARGEST_VIOLATION * largest
