"""Small dense quadratic programs: minimise ½ xᵀHx + gᵀx where lower ≤ Ax ≤ upper."""

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
"""Violation and stationarity, relative to the largest figure of the program's, up to which a solution is one."""


class Program(NamedTuple):
    """A quadratic program of k variables and m rows; the first `equalities` rows have lower = upper."""

    hessian: Floats
    """(k, k), positive definite."""
    gradient: Floats
    """(k,)."""
    rows: Floats
    """(m, k)."""
    lower: Floats
    """(m,)."""
    upper: Floats
    """(m,)."""
    equalities: int = 0


class Solution(NamedTuple):
    """What came of a program."""

    value: Floats
    """(k,)."""
    solved: bool
    """Whether the solver says so, and the residuals too."""
    violation: float
    """Of the worst row, relative to the largest bound or 1."""
    stationarity: float
    """Largest entry of Hx + g + Aᵀλ, relative to the largest of g or 1."""


def solve(program: Program) -> Solution:
    """The minimum, by DAQP's dual active-set method; the residuals are worked out from the program itself."""
    hessian, gradient, rows, lower, upper, equalities = program
    sense = np.zeros(len(rows), dtype=np.intc)
    sense[:equalities] = EQUALITY
    value, _, answer, info = daqp.solve(hessian, gradient, rows, upper, lower, sense)
    reached = rows @ value
    beyond = np.maximum(np.maximum(reached - upper, lower - reached), 0.0)
    slope = hessian @ value + gradient + rows.T @ info["lam"]
    bounds = np.abs(np.concatenate((upper, lower)))
    violation = float(beyond.max(initial=0.0) / max(1.0, bounds[np.isfinite(bounds)].max(initial=0.0)))
    stationarity = float(np.abs(slope).max() / max(1.0, np.abs(gradient).max()))
    good = answer == SOLVED and max(violation, stationarity) < LARGEST_RESIDUAL
    return Solution(value, good, violation, stationarity)
