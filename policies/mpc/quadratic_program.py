"""Batches of small dense quadratic programs, solved by the active-set solver DAQP.

A program minimises ½ xᵀHx + gᵀx over the variables x, subject to lower ≤ Ax ≤ upper. All programs of a batch have the
same numbers of variables and constraints.
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
"""Largest constraint violation at which the solution of a quadratic program still counts as valid.

The violation is divided by the largest absolute finite bound of the program if this bound is above 1."""
MAX_ITERATIONS = 300
"""Iteration limit of the solver DAQP for each quadratic program.

It is ten times the number of iterations that the programs of the controllers need. A limit is needed because a solution
that takes longer comes too late for the control step. The number of iterations is limited instead of the time, so that
the result is the same on every machine."""


class QpBatch(NamedTuple):
    """Batch of n quadratic programs, each with k variables and m constraints.

    Each program minimises ½ xᵀHx + gᵀx over the variables x, subject to lower ≤ Ax ≤ upper.
    """

    hessian: Floats
    """Positive definite Hessian H of the cost ½ xᵀHx + gᵀx of each of n programs with k variables, (n, k, k)."""
    gradient: Floats
    """Gradient g of the cost ½ xᵀHx + gᵀx at x = 0 of each of n programs with k variables, (n, k)."""
    constraint_matrix: Floats
    """Matrix A of the m constraints lower ≤ Ax ≤ upper of each of n programs with k variables, (n, m, k)."""
    lower: Floats
    """Lower bounds of the m constraints lower ≤ Ax ≤ upper of each of n programs, (n, m); -inf for no bound."""
    upper: Floats
    """Upper bounds of the m constraints lower ≤ Ax ≤ upper of each of n programs, (n, m); inf for no bound."""
    equalities: int = 0
    """Number of equality constraints (lower = upper) of each program; they are the first rows of A."""


class Solutions(NamedTuple):
    """Solutions of n quadratic programs with k variables each."""

    x: Floats
    """Optimal values of the k variables of each of n programs, (n, k); valid only if `solved` is True."""
    solved: NDArray[np.bool_]
    """True for each of n programs that has a valid solution: optimal, finite and within all bounds, (n,)."""


Solver = Callable[[QpBatch], Solutions]
"""Function that solves a batch of quadratic programs, for example `solve`."""


def solve(programs: QpBatch) -> Solutions:
    """Solve the programs of a batch one by one with DAQP's dual active-set method.

    If a program needs more than `MAX_ITERATIONS` iterations, the result marks it as not solved.
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
    """Return True for programs with a solution `x` that is finite and within the bounds, (n,).

    `x`, (n, k), are the solutions of n `programs` with k variables. A violation of the bounds up to `MAX_VIOLATION` is
    accepted.
    """
    values = np.matmul(programs.constraint_matrix, x[..., None])[..., 0]
    violation: Floats = np.maximum(values - programs.upper, programs.lower - values).max(axis=1, initial=0.0)
    is_small = violation < MAX_VIOLATION
    if is_small.all():
        return is_small
    bounds = np.concatenate((programs.lower, programs.upper), axis=1)
    largest: Floats = np.abs(np.where(np.isfinite(bounds), bounds, 0.0)).max(axis=1, initial=1.0)
    return violation < MAX_VIOLATION * largest
