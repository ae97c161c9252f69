"""Batches of small dense quadratic programs, solved by DAQP.

A program minimises ½ xᵀHx + gᵀx subject to lower ≤ Ax ≤ upper. The programs of a batch have the same size.
"""

from collections.abc import Callable
from typing import NamedTuple

import daqp
import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats

DAQP_EQUALITY = 5
"""Value in DAQP's constraint array `sense` that marks an equality constraint."""
DAQP_OPTIMAL = 1
"""Exit flag that DAQP returns if it has found the optimum."""
MAX_VIOLATION = 1e-4
"""Largest constraint violation of a valid solution.

It is relative to the largest absolute finite bound of the program, or absolute if this bound is below 1."""
MAX_ITERATIONS = 300
"""Iteration limit of DAQP for each program; ten times the number of iterations that the controllers' programs need.

A limit is needed because a solution that takes longer comes too late for the control step. A limit on iterations gives
the same result on every machine, whereas a limit on time does not."""


class QpBatch(NamedTuple):
    """Batch of g quadratic programs, each with k variables and m constraints.

    Each program minimises ½ xᵀHx + gᵀx subject to lower ≤ Ax ≤ upper.
    """

    hessian: Floats
    """Hessian matrices H of the cost, positive definite, (g, k, k)."""
    gradient: Floats
    """Gradients g of the cost at x = 0, (g, k)."""
    constraint_matrix: Floats
    """Constraint matrices A, (g, m, k)."""
    lower: Floats
    """Lower bounds of A x, (g, m)."""
    upper: Floats
    """Upper bounds of A x, (g, m)."""
    equalities: int = 0
    """Number of equality constraints (lower = upper); they are the first rows of A."""


class Solutions(NamedTuple):
    """Solutions of g quadratic programs with k variables each."""

    x: Floats
    """Optimal variables, (g, k); valid where `solved` is True."""
    solved: NDArray[np.bool_]
    """True for programs with a valid solution: optimal, finite and within all bounds, (g,)."""


Solver = Callable[[QpBatch], Solutions]


def solve(programs: QpBatch) -> Solutions:
    """Solve the programs of a batch one by one with DAQP's dual active-set method.

    A program that needs more than `MAX_ITERATIONS` iterations counts as not solved.
    """
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
    """Return the mask of programs, (g,), with an `x`, (g, k), that is finite and within the bounds.

    A violation of the bounds up to `MAX_VIOLATION` is accepted.
    """
    values = np.matmul(programs.constraint_matrix, x[..., None])[..., 0]
    violation: Floats = np.maximum(values - programs.upper, programs.lower - values).max(axis=1, initial=0.0)
    is_small = violation < MAX_VIOLATION
    if is_small.all():
        return is_small
    bounds = np.concatenate((programs.lower, programs.upper), axis=1)
    largest: Floats = np.abs(np.where(np.isfinite(bounds), bounds, 0.0)).max(axis=1, initial=1.0)
    return violation < MAX_VIOLATION * largest
