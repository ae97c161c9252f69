"""The rigid body's prediction, its program, and the solver."""

import numpy as np
import pytest
from scipy.optimize import minimize

from policies.mpc.quadratic_program import Program, solve
from policies.mpc.rigid_body import Body, Friction, Horizon, Reference, Weights, friction_rows
from quad_env.config import GRAVITY

STEPS, PERIOD, MASS = 6, 0.04, 14.2
HORIZON = Horizon(STEPS, PERIOD)
FRICTION = Friction(0.6, 0.0, 170.0)
WEIGHTS = Weights(
    np.array([10.0, 9.0, 2.0]), np.array([1.0, 2.0, 100.0]), np.array([0.1, 0.2, 0.3]), np.array([2.0, 3.0, 0.5]), 1e-5
)


def body() -> Body:
    return Body(
        angles=np.array([0.05, -0.04, 0.01]),
        position=np.array([0.01, -0.02, -0.03]),
        turning=np.array([0.3, 0.2, -0.1]),
        velocity=np.array([0.5, 0.1, -0.05]),
        mass=MASS,
        inertia=np.array([[0.97, 0.01, -0.07], [0.01, 1.17, 0.02], [-0.07, 0.02, 1.2]]),
        acceleration=np.array([0.5, -0.2, 0.1, 0.3, -0.1, 0.05]),
    )


def arms() -> np.ndarray:
    feet = np.array([[0.29, 0.25], [0.29, -0.25], [-0.21, 0.25], [-0.21, -0.25]])
    moved = feet - np.arange(STEPS)[:, None, None] * 0.02
    return np.concatenate((moved, np.full((STEPS, 4, 1), -0.35)), axis=-1)


def standing() -> np.ndarray:
    first = np.array([True, False, False, True])
    return np.array([first] * 3 + [~first] * 3)


def wanted() -> Reference:
    rows = np.ones((STEPS, 1))
    return Reference(0.01 * rows * [0, 0, 1], 0.02 * rows * [1, 0, 0], rows * [0, 0, 0.2], rows * [0.6, 0.0, 0.0])


def test_the_prediction_is_what_steps_of_newton_s_and_euler_s_laws_give() -> None:
    now, forces = body(), np.random.default_rng(0).normal(50.0, 20.0, (STEPS, 4, 3)) * standing()[..., None]
    angles, position, turning, velocity = now.angles, now.position, now.turning, now.velocity
    for step, (arm, force) in enumerate(zip(arms(), forces, strict=True)):
        linear = force.sum(axis=0) / MASS - [0.0, 0.0, GRAVITY] + now.acceleration[:3]
        angular = np.linalg.solve(now.inertia, np.cross(arm, force).sum(axis=0)) + now.acceleration[3:]
        position = position + PERIOD * velocity + 0.5 * PERIOD**2 * linear
        angles = angles + PERIOD * turning + 0.5 * PERIOD**2 * angular
        velocity, turning = velocity + PERIOD * linear, turning + PERIOD * angular
        found = HORIZON.predicted(now, arms(), forces)
        for name, value in (("angles", angles), ("position", position), ("turning", turning), ("velocity", velocity)):
            np.testing.assert_allclose(getattr(found, name)[step], value, atol=1e-10, err_msg=name)


def test_a_force_under_the_fore_feet_lifts_the_nose_and_one_under_the_left_feet_the_left_side() -> None:
    up = np.array([0.0, 0.0, 100.0])
    turning = HORIZON.moments(body().inertia, arms())[0] @ up
    roll, pitch = turning[:, 0], turning[:, 1]
    assert (pitch[:2] < 0.0).all()
    assert (pitch[2:] > 0.0).all()  # the trunk's pitch is positive with the nose down
    assert (roll[[0, 2]] > 0.0).all()
    assert (roll[[1, 3]] < 0.0).all()


def cost(forces: np.ndarray) -> float:
    found, goal = HORIZON.predicted(body(), arms(), forces), wanted()
    missed = sum(
        float((getattr(WEIGHTS, name) * (getattr(found, name) - getattr(goal, name)) ** 2).sum())
        for name in ("angles", "position", "turning", "velocity")
    )
    return 0.5 * (missed + WEIGHTS.force * float((forces**2).sum()))


def test_the_program_s_cost_is_that_of_the_prediction() -> None:
    program = HORIZON.program(body(), arms(), standing(), wanted(), WEIGHTS, FRICTION)
    random = np.random.default_rng(1)
    rest = cost(np.zeros((STEPS, 4, 3)))
    for _ in range(5):
        x = random.normal(0.0, 50.0, len(program.gradient))
        value = 0.5 * x @ program.hessian @ x + program.gradient @ x
        assert value == pytest.approx(cost(HORIZON.spread(x, standing())) - rest, rel=1e-9)


def test_the_forces_found_are_the_best_within_friction() -> None:
    """Against SciPy's SLSQP on the cost of the prediction itself."""
    program = HORIZON.program(body(), arms(), standing(), wanted(), WEIGHTS, FRICTION._replace(share=0.05))
    found = solve(program)
    assert found.solved
    assert found.violation < 1e-6
    assert found.stationarity < 1e-6
    reached = program.rows @ found.value
    assert (reached <= program.upper + 1e-6).all()
    assert (reached >= program.lower - 1e-6).all()
    assert np.isclose(reached, program.upper, atol=1e-6).any()  # friction binds, else this tells little
    other = minimize(
        lambda x: 0.5 * x @ program.hessian @ x + program.gradient @ x,
        np.tile([0.0, 0.0, 70.0], len(found.value) // 3),
        jac=lambda x: program.hessian @ x + program.gradient,
        constraints=[
            {"type": "ineq", "fun": lambda x, row=row, most=most: most - row @ x, "jac": lambda x, row=row: -row}
            for row, most in zip(*_one_sided(program), strict=True)
        ],
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    value = 0.5 * found.value @ program.hessian @ found.value + program.gradient @ found.value
    assert value <= other.fun + 1e-6 * abs(other.fun)


def _one_sided(program: Program) -> tuple[np.ndarray, np.ndarray]:
    low = np.isfinite(program.lower)
    return np.concatenate((program.rows, -program.rows[low])), np.concatenate((program.upper, -program.lower[low]))


def test_friction_holds_a_force_within_its_pyramid() -> None:
    rows, lower, upper = friction_rows(2, FRICTION)

    def allowed(first: list[float], second: list[float]) -> bool:
        reached = rows @ np.array([*first, *second])
        return bool((reached <= upper + 1e-9).all() and (reached >= lower - 1e-9).all())

    held = [0.0, 0.0, 10.0]
    assert allowed([6.0, -6.0, 10.0], held)
    assert not allowed([6.1, 0.0, 10.0], held)
    assert not allowed(held, [0.0, -6.1, 10.0])
    assert not allowed([0.0, 0.0, -0.1], held)
    assert not allowed(held, [0.0, 0.0, 170.1])


def test_a_program_that_contradicts_itself_is_not_solved() -> None:
    rows = np.array([[1.0, 0.0], [1.0, 0.0]])
    found = solve(Program(np.eye(2), np.zeros(2), rows, np.array([1.0, -np.inf]), np.array([np.inf, 0.0])))
    assert not found.solved


def test_equalities_hold() -> None:
    rows = np.array([[1.0, 1.0], [1.0, 0.0]])
    program = Program(np.eye(2), np.zeros(2), rows, np.array([2.0, -np.inf]), np.array([2.0, 0.5]), equalities=1)
    np.testing.assert_allclose(solve(program).value, [0.5, 1.5], atol=1e-9)
