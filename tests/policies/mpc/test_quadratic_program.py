"""Programs are solved, and what is no solution is not taken for one, whatever the solver says."""

from typing import Any

import numpy as np
import pytest

import policies.mpc.quadratic_program as quadratic_program
from policies.mpc.quadratic_program import LARGEST_RESIDUAL, SOLVED, Programs, residuals, solve


def programs(count: int = 3, size: int = 8) -> Programs:
    """Random ones of which bounds bind: two equalities, rows with both bounds, and rows with an upper one alone."""
    random = np.random.default_rng(4)
    root = random.normal(size=(count, size, size))
    rows = random.normal(size=(count, 12, size))
    lower, upper = np.full((2, count, 12), -0.1)
    upper[:, 2:] = 0.1
    lower[:, 7:] = -np.inf
    hessian = np.matmul(root, root.transpose(0, 2, 1)) + 0.1 * np.eye(size)
    return Programs(hessian, 10.0 * random.normal(size=(count, size)), rows, lower, upper, equalities=2)


def test_a_solution_meets_the_conditions_of_karush_kuhn_and_tucker() -> None:
    found = solve(programs())
    assert found.solved.all()
    assert found.residuals.worst.max() < 1e-8
    assert (np.abs(found.multipliers[:, 2:]) > 1e-3).sum(axis=1).min() >= 1  # bounds bind, else this tells little


def wrong(kind: str) -> tuple[Programs, np.ndarray, np.ndarray]:
    """An answer that is wrong in one way: with its program, (1, k) and (1, m)."""
    whole, found = programs(1), solve(programs(1))
    value, multipliers = found.value.copy(), found.multipliers.copy()
    if kind == "stationarity":  # a multiplier is missing
        multipliers[0, np.argmax(np.abs(multipliers[0]))] = 0.0
    elif kind == "violation":  # the minimum without bounds
        free = np.linalg.solve(whole.hessian[0], -whole.gradient[0])
        value, multipliers = free[None], np.zeros_like(multipliers)
    elif kind == "sign":  # the minimum where a row that binds holds with equality, though it should let go
        whole, value, multipliers = pulled(upper=1.0, lower=-np.inf, at=1.0)
    elif kind == "slackness":  # the same between two bounds
        whole, value, multipliers = pulled(upper=2.0, lower=-2.0, at=1.0)
    return whole, value, multipliers


def pulled(upper: float, lower: float, at: float) -> tuple[Programs, np.ndarray, np.ndarray]:
    """½ (x + 1)² - ½, with x held at a place by a multiplier though its minimum is at -1."""
    bounds = np.array([[lower]]), np.array([[upper]])
    whole = Programs(np.ones((1, 1, 1)), np.ones((1, 1)), np.ones((1, 1, 1)), *bounds)
    return whole, np.full((1, 1), at), np.full((1, 1), -at - 1.0)


@pytest.mark.parametrize("kind", ["stationarity", "violation", "sign", "slackness"])
def test_each_kind_of_wrong_answer_shows_in_its_residual(kind: str) -> None:
    found = residuals(*wrong(kind))
    assert getattr(found, kind)[0] > 100.0 * LARGEST_RESIDUAL
    others = {name: each[0] for name, each in found._asdict().items() if name != kind}
    assert max(others.values()) < 1e-8, others


@pytest.mark.parametrize("kind", ["stationarity", "violation", "sign", "slackness"])
def test_a_solver_that_is_content_with_a_wrong_answer_is_not_believed(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, value, multipliers = wrong(kind)
    monkeypatch.setattr(
        quadratic_program.daqp, "solve", lambda *_, **__: (value[0], 0.0, SOLVED, {"lam": multipliers[0]})
    )
    assert not solve(whole).solved.any()


def test_nan_is_no_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    def answer(hessian: Any, gradient: np.ndarray, rows: np.ndarray, *_: Any, **__: Any) -> Any:
        return np.full(len(gradient), np.nan), 0.0, SOLVED, {"lam": np.zeros(len(rows))}

    monkeypatch.setattr(quadratic_program.daqp, "solve", answer)
    assert not solve(programs()).solved.any()


def test_one_without_a_solution_leaves_the_others_theirs() -> None:
    whole = programs()
    whole.upper[1, 3] = -1.0  # below its lower bound
    found = solve(whole)
    assert found.solved.tolist() == [True, False, True]
    np.testing.assert_array_equal(found.value[::2], solve(programs()).value[::2])


def test_a_program_beyond_the_limit_of_iterations_is_not_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quadratic_program, "MOST_ITERATIONS", 2)
    assert not solve(programs()).solved.any()
