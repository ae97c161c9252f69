"""Prediction of the rigid body, its QP, and the solver."""

import numpy as np
import pytest

from policies.mpc.quadratic_program import QpBatch, solve
from policies.mpc.rigid_body import (
    MAX_GROUP_SIZE,
    CondensedMpc,
    Friction,
    MpcReference,
    MpcWeights,
    RigidBodyState,
    friction_constraints,
    group_by_stance_count,
)
from quad_env.config import GRAVITY

STEPS, PERIOD, MASS = 6, 0.04, 14.2
WEIGHTS = MpcWeights(np.array([10.0, 9.0, 2.0, 1.0, 2.0, 100.0]), np.array([0.1, 0.2, 0.3, 2.0, 3.0, 0.5]), 1e-5)
HORIZON = CondensedMpc(STEPS, PERIOD, WEIGHTS)
FRICTION = Friction(np.array([0.6]), np.array([170.0]))


def body() -> RigidBodyState:
    return RigidBodyState(
        pose=np.array([[0.05, -0.04, 0.01, 0.01, -0.02, -0.03]]),
        rate=np.array([[0.3, 0.2, -0.1, 0.5, 0.1, -0.05]]),
        mass=np.array([MASS]),
        inertia=np.array([[[0.97, 0.01, -0.07], [0.01, 1.17, 0.02], [-0.07, 0.02, 1.2]]]),
        acceleration=np.array([[0.3, -0.1, 0.05, 0.5, -0.2, 0.1]]),
    )


def arms() -> np.ndarray:
    feet = np.array([[0.29, 0.25], [0.29, -0.25], [-0.21, 0.25], [-0.21, -0.25]])
    moved = feet - np.arange(STEPS)[:, None, None] * 0.02
    return np.concatenate((moved, np.full((STEPS, 4, 1), -0.35)), axis=-1)[None]


def standing() -> np.ndarray:
    first = np.array([True, False, False, True])
    return np.array([[first] * 3 + [~first] * 3])


def wanted() -> MpcReference:
    return MpcReference(*(np.tile(aim, (1, STEPS, 1)) for aim in ([0, 0, 0.01, 0.02, 0, 0], [0, 0, 0.2, 0.6, 0, 0])))


def of_one() -> QpBatch:
    """Return the QP of the robot."""
    ((robots, programs),) = HORIZON.make_programs(body(), arms(), standing(), wanted(), FRICTION)
    assert robots.tolist() == [0]
    return programs


def predicted(forces: np.ndarray) -> MpcReference:
    """Return the predicted motion of the body under the given contact forces, (1, N, 4, 3), N."""
    free, linear = HORIZON.free_response(body()), forces.sum(axis=2) / MASS
    angular = np.linalg.solve(body().inertia, np.cross(arms(), forces).sum(axis=2)[..., None])[..., 0]
    acceleration = np.concatenate((angular, linear), axis=-1)
    return MpcReference(
        free.pose + HORIZON.position_response @ acceleration, free.rate + HORIZON.velocity_response @ acceleration
    )


def test_the_prediction_is_what_steps_of_newton_s_and_euler_s_laws_give() -> None:
    now, forces = body(), np.random.default_rng(0).normal(50.0, 20.0, (1, STEPS, 4, 3)) * standing()[..., None]
    pose, rate = now.pose[0], now.rate[0]
    for step, (arm, force) in enumerate(zip(arms()[0], forces[0], strict=True)):
        linear = force.sum(axis=0) / MASS - [0.0, 0.0, GRAVITY]
        angular = np.linalg.solve(now.inertia[0], np.cross(arm, force).sum(axis=0))
        acceleration = np.concatenate((angular, linear)) + now.acceleration[0]
        pose, rate = pose + PERIOD * rate + 0.5 * PERIOD**2 * acceleration, rate + PERIOD * acceleration
        found = predicted(forces)
        np.testing.assert_allclose(found.pose[0, step], pose, atol=1e-10)
        np.testing.assert_allclose(found.rate[0, step], rate, atol=1e-10)


def cost(forces: np.ndarray) -> float:
    found, goal = predicted(forces), wanted()
    missed = sum(
        float((getattr(WEIGHTS, name) * (getattr(found, name) - getattr(goal, name)) ** 2).sum())
        for name in ("pose", "rate")
    )
    weight = np.zeros_like(forces)
    weight[..., 2] = standing() * 0.5 * MASS * GRAVITY
    return 0.5 * (missed + WEIGHTS.force * float(((forces - weight) ** 2).sum()))


def test_the_program_s_cost_is_that_of_the_prediction() -> None:
    program, random = of_one(), np.random.default_rng(1)
    rest = cost(np.zeros((1, STEPS, 4, 3)))
    for _ in range(5):
        x = random.normal(0.0, 50.0, program.gradient.shape[1])
        value = 0.5 * x @ program.hessian[0] @ x + program.gradient[0] @ x
        assert value == pytest.approx(cost(HORIZON.scatter_forces(x, standing())) - rest, rel=1e-9)


def test_friction_holds_a_force_within_its_pyramid() -> None:
    rows, lower, upper = (part[0] for part in friction_constraints(2, FRICTION))

    def allowed(first: list[float], second: list[float]) -> bool:
        reached = rows @ np.array([*first, *second])
        return bool((reached <= upper + 1e-9).all() and (reached >= lower - 1e-9).all())

    held = [0.0, 0.0, 10.0]
    assert allowed([6.0, -6.0, 10.0], held)
    assert not allowed([6.1, 0.0, 10.0], held)
    assert not allowed(held, [0.0, -6.1, 10.0])
    assert not allowed([0.0, 0.0, -0.1], held)
    assert not allowed(held, [0.0, 0.0, 170.1])


def test_no_foot_pulls_where_pulling_would_be_best() -> None:
    """The body is commanded down at 30 m/s, on ground with and without friction; the pyramid has no upper bound."""
    rows, lower, upper = (part[0] for part in friction_constraints(1, Friction(np.zeros(1), np.array([170.0]))))
    assert (rows @ [0.0, 0.0, -0.1] < lower - 0.05).any()
    assert ((rows @ [0.0, 0.0, 0.1] >= lower) & (rows @ [0.0, 0.0, 0.1] <= upper)).all()
    down = MpcReference(wanted().pose, np.tile([0.0, 0.0, 0.0, 0.0, 0.0, -30.0], (1, STEPS, 1)))
    for share in (0.0, 0.6):
        bounds = Friction(np.array([share]), np.array([170.0]))
        ((_, programs),) = HORIZON.make_programs(body(), arms(), standing(), down, bounds)
        solutions = solve(programs)
        assert solutions.solved.all()
        forces = HORIZON.scatter_forces(solutions.x, standing())
        np.testing.assert_allclose(forces[..., 2].min(), 0.0, atol=1e-6)
        assert (forces[..., 2].max(axis=(1, 2)) < 1.0).all()


def test_programs_of_many_robots_are_those_of_each() -> None:
    """Five robots, some with different stance feet, have the same programs together as alone."""
    random, shape = np.random.default_rng(3), (5, STEPS, 4, 3)
    bodies = [np.repeat(part, 5, axis=0) for part in body()]
    bodies = [part * (1.0 + 0.2 * random.random((5, *(1,) * (part.ndim - 1)))) for part in bodies]
    feet, stands = arms() + 0.02 * random.normal(size=shape), np.repeat(standing(), 5, axis=0)
    stands[1, 0] = stands[4, 0] = True
    stands[2, 0, 0] = False
    goal = [np.repeat(part, 5, axis=0) for part in wanted()]
    bounds = Friction(0.3 + 0.5 * random.random(5), 150.0 + 50.0 * random.random(5))
    seen = []
    for robots, together in HORIZON.make_programs(RigidBodyState(*bodies), feet, stands, MpcReference(*goal), bounds):
        for place, robot in enumerate(robots):
            one = slice(robot, robot + 1)
            of_one, goal_of_one = (
                RigidBodyState(*(part[one] for part in bodies)),
                MpcReference(*(part[one] for part in goal)),
            )
            ((_, alone),) = HORIZON.make_programs(of_one, feet[one], stands[one], goal_of_one, bounds.select(one))
            for name in ("hessian", "gradient", "constraint_matrix", "lower", "upper"):
                np.testing.assert_array_equal(getattr(together, name)[place], getattr(alone, name)[0], err_msg=name)
            seen.append(robot)
    assert sorted(seen) == [0, 1, 2, 3, 4]


def test_programs_are_made_of_few_robots_at_once_and_of_each_robot_once() -> None:
    counts = np.random.default_rng(0).integers(3, 5, 3 * MAX_GROUP_SIZE)
    groups = list(group_by_stance_count(counts))
    assert sorted(np.concatenate(groups)) == list(range(len(counts)))
    for robots in groups:
        assert len(robots) <= MAX_GROUP_SIZE
        assert len(set(counts[robots])) == 1
