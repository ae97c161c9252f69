"""Small dense quadratic programs of one shape: minimise ½ xᵀHx + gᵀx subject to lower ≤ Ax ≤ upper."""

from collections.abc import Callable
from typing import NamedTuple

import daqp
import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats

DAQP_EQUALITY = 5
"""Value in DAQP's array `sense` that marks an equality constraint."""
DAQP_OPTIMAL = 1
"""DAQP's exit flag of an optimum."""
MAX_VIOLATION = 1e-4
"""Largest constraint violation of a valid solution, as a fraction of the largest finite bound (at least 1)."""
MAX_ITERATIONS = 300
"""Iteration limit of DAQP: ten times the iterations that a robot's programs need, because a later solution comes too
late. A limit on iterations gives the same result on every machine; a limit on time would not."""


class QpBatch(NamedTuple):
    """Batch of g quadratic programs, each with k variables and m constraints."""

    hessian: Floats
    """H, positive definite, (g, k, k)."""
    gradient: Floats
    """Gradient of the cost at x = 0, (g, k)."""
    constraint_matrix: Floats
    """A, (g, m, k)."""
    lower: Floats
    """Lower bounds of Ax, (g, m)."""
    upper: Floats
    """Upper bounds of Ax, (g, m)."""
    equalities: int = 0
    """Number of equality constraints, which are the first rows of A and have lower = upper."""


class Solutions(NamedTuple):
    """Solutions of g quadratic programs."""

    x: Floats
    """Variables, (g, k)."""
    solved: NDArray[np.bool_]
    """True if the solver reports an optimum and the solution is finite and within all bounds, (g,)."""


Solver = Callable[[QpBatch], Solutions]


def solve(programs: QpBatch) -> Solutions:
    """Solve the programs one by one with DAQP's dual active-set method, in at most `MAX_ITERATIONS` each."""
    hessian = np.ascontiguousarray(programs.hessian)
    gradient = np.ascontiguousarray(programs.gradient)
    constraint_matrix = np.ascontiguousarray(programs.constraint_matrix)
    lower = np.ascontiguousarray(programs.lower)
    upper = np.ascontiguousarray(programs.upper)
    x = np.empty_like(gradient)
    exit_flags = np.empty(len(gradient), np.int64)
    sense = np.zeros(lower.shape[1], dtype=np.intc)
    sense[: programs.equalities] = DAQP_EQUALITY
    for i in range(len(gradient)):
        x[i], _, exit_flags[i], _ = daqp.solve(
            hessian[i], gradient[i], constraint_matrix[i], upper[i], lower[i], sense.copy(), iter_limit=MAX_ITERATIONS
        )
    return Solutions(x, (exit_flags == DAQP_OPTIMAL) & _is_feasible(programs, x))


def _is_feasible(programs: QpBatch, x: Floats) -> NDArray[np.bool_]:
    """Return True where `x`, (g, k), is finite and violates no bound by more than `MAX_VIOLATION`, (g,)."""
    values = np.matmul(programs.constraint_matrix, x[..., None])[..., 0]
    violation: Floats = np.maximum(values - programs.upper, programs.lower - values).max(axis=1, initial=0.0)
    is_small = violation < MAX_VIOLATION
    if is_small.all():
        return is_small
    bounds = np.concatenate((programs.lower, programs.upper), axis=1)
    largest: Floats = np.abs(np.where(np.isfinite(bounds), bounds, 0.0)).max(axis=1, initial=1.0)
    return violation < MAX_VIOLATION * largest
