"""QPs are solved, and invalid results are rejected, independent of the solver's status."""

from typing import Any

import numpy as np
import pytest

import policies.mpc.quadratic_program as quadratic_program
from policies.mpc.quadratic_program import DAQP_OPTIMAL, QpBatch, solve


def programs(count: int = 3, size: int = 8) -> QpBatch:
    """Return random programs with active bounds: two equalities, rows with both bounds, rows with an upper bound."""
    random = np.random.default_rng(4)
    root = random.normal(size=(count, size, size))
    rows = random.normal(size=(count, 12, size))
    lower, upper = np.full((2, count, 12), -0.1)
    upper[:, 2:] = 0.1
    lower[:, 7:] = -np.inf
    hessian = np.matmul(root, root.transpose(0, 2, 1)) + 0.1 * np.eye(size)
    return QpBatch(hessian, 10.0 * random.normal(size=(count, size)), rows, lower, upper, equalities=2)


def small(rows: list, lower: list, upper: list, equalities: int = 0) -> QpBatch:
    """Return the program of ½ |x|² over two variables."""
    parts = (np.eye(2), np.zeros(2), np.array(rows), np.array(lower), np.array(upper))
    return QpBatch(*(part[None] for part in parts), equalities=equalities)


def test_equalities_and_one_sided_bounds_hold() -> None:
    found = solve(small([[1.0, 1.0], [1.0, 0.0]], [2.0, -np.inf], [2.0, 0.5], equalities=1))
    assert found.solved.all()
    np.testing.assert_allclose(found.x, [[0.5, 1.5]], atol=1e-9)


def test_a_program_that_contradicts_itself_is_not_solved() -> None:
    assert not solve(small([[1.0, 0.0], [1.0, 0.0]], [1.0, -np.inf], [np.inf, 0.0])).solved.any()


@pytest.mark.parametrize("kind", ["nan", "beyond a bound"])
def test_a_solver_that_is_content_with_a_wrong_answer_is_not_believed(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def answer(hessian: np.ndarray, gradient: np.ndarray, *_: Any, **__: Any) -> Any:
        free = np.linalg.solve(hessian, -gradient)
        return np.full_like(free, np.nan) if kind == "nan" else free, 0.0, DAQP_OPTIMAL, {}

    monkeypatch.setattr(quadratic_program.daqp, "solve", answer)
    assert not solve(programs()).solved.any()


def test_a_program_beyond_the_limit_of_iterations_is_not_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quadratic_program, "MAX_ITERATIONS", 2)
    assert not solve(programs()).solved.any()


def test_of_two_answers_only_the_one_beyond_its_bounds_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    """A violation is relative to the largest bound: 0.05 is accepted for 1000 N and rejected for 1 N."""
    answer = np.array([1000.05, 0.0]), 0.0, DAQP_OPTIMAL, {}
    monkeypatch.setattr(quadratic_program.daqp, "solve", lambda *_, **__: answer)
    parts = [np.repeat(part, 3, axis=0) for part in small([[1.0, 0.0]], [-np.inf], [1000.0])[:5]]
    parts[4][:, 0] = 1000.0, 2000.0, 999.0
    assert solve(QpBatch(*parts)).solved.tolist() == [True, True, False]


def test_each_program_has_its_own_bounds_and_an_answer_below_one_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    """The solutions of ½ |x|² with x₁ of at least 1, 2 and -5, then of at most -3, are 1, 2, 0 and -3."""
    parts = [np.repeat(part, 4, axis=0) for part in small([[1.0, 0.0]], [1.0], [9.0])[:5]]
    parts[3][:, 0], parts[4][:, 0] = (1.0, 2.0, -5.0, -9.0), (9.0, 9.0, 9.0, -3.0)
    found = solve(QpBatch(*parts))
    assert found.solved.all()
    np.testing.assert_allclose(found.x, [[1.0, 0.0], [2.0, 0.0], [0.0, 0.0], [-3.0, 0.0]], atol=1e-9)
    answer = np.array([1.5, 0.0]), 0.0, DAQP_OPTIMAL, {}
    monkeypatch.setattr(quadratic_program.daqp, "solve", lambda *_, **__: answer)
    assert solve(QpBatch(*parts)).solved.tolist() == [True, False, True, False]
