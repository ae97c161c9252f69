"""Torques of the whole body and of single legs satisfy the equations of motion and track their reference."""

import numpy as np

from policies.mpc.parameters import MpcParameters
from policies.mpc.quadratic_program import solve
from policies.mpc.rigid_body import Friction
from policies.mpc.whole_body import Torques, WholeBodyReference, leg_torques, make_programs, solve_whole_body
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import Dynamics, DynamicsTerms
from quad_env.robots.simple_quad import SIMPLE_QUAD as ROBOT

COUNT = 6
LIMITS = np.full((COUNT, 12), -60.0), np.full((COUNT, 12), 60.0)
WEIGHT = ROBOT.mass * GRAVITY
PRIORITIES = MpcParameters(turning_priority=1.0, standing_priority=10.0, swinging_priority=0.2, force_priority=0.01)
FRICTION = Friction(np.full(COUNT, 0.6), np.full(COUNT, 1.5 * WEIGHT))
NOTHING = np.zeros((COUNT, 6))


def bodies(speed: float = 0.5) -> DynamicsTerms:
    """Return the dynamics of robots near the home pose with small velocities."""
    random = np.random.default_rng(7)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (COUNT, 1))
    angles = ROBOT.home_pose + 0.1 * random.normal(size=(COUNT, 12))
    velocity, turning = speed * random.normal(size=(2, COUNT, 3))
    return Dynamics(ROBOT).compute(level, velocity, turning, angles, speed * random.normal(size=(COUNT, 12)))


def wish(of: DynamicsTerms) -> WholeBodyReference:
    """Return a reference: some robots stand on four feet, some on two, one on three, and standing feet rest."""
    standing = np.ones((COUNT, 4), np.bool_)
    standing[1:4, 1:3] = standing[4, 0] = False
    random = np.random.default_rng(8)
    feet = np.where(standing[..., None], 0.0, 5.0 * random.normal(size=(COUNT, 4, 3)))
    forces = np.zeros((COUNT, 4, 3))
    forces[..., 2] = WEIGHT / standing.sum(axis=1, keepdims=True)
    return WholeBodyReference(0.5 * random.normal(size=(COUNT, 3)), feet, forces * standing[..., None], standing)


def whole(
    of: DynamicsTerms, wished: WholeBodyReference, wrench: np.ndarray = NOTHING, friction: Friction = FRICTION
) -> Torques:
    return solve_whole_body(of, wished, wrench, friction, LIMITS, PRIORITIES)


def test_the_torques_are_those_of_the_equations_of_motion() -> None:
    """The solution of each program satisfies M q̈ + h = Sᵀτ + Jᵀf + w."""
    of, wrench = bodies(), np.random.default_rng(9).normal(0.0, 5.0, (COUNT, 6))
    wished = wish(of)
    found = whole(of, wished, wrench)
    assert found.has_solution.all()
    for robots, each in make_programs(of, wished, wrench, FRICTION, LIMITS, PRIORITIES):
        for robot, x in zip(robots, solve(each).x, strict=True):
            forces = np.zeros((4, 3))
            forces[wished.stance[robot]] = x[18:].reshape(-1, 3)
            pushed = np.concatenate((wrench[robot], found.torque[robot]))
            pushed += np.einsum("lxk,lx->k", of.jacobians[robot], forces)
            np.testing.assert_allclose(of.inertia[robot] @ x[:18] + of.bias_force[robot], pushed, atol=1e-6)
            np.testing.assert_array_equal(found.acceleration[robot], x[6:18])
            assert (np.abs(forces[:, :2]) <= 0.6 * forces[:, 2:] + 1e-6).all()


def test_the_program_s_cost_is_what_is_missed_of_the_wish_by_its_priorities() -> None:
    """The cost is ½ Σ priority · |J q̈ + J̇ q̇ - reference|² of feet, trunk rotation and forces, up to a constant.

    Each robot has its own cost, including the two terms that make it definite.
    """
    of, random = bodies(), np.random.default_rng(11)
    wished, p = wish(of), PRIORITIES
    wished = wished._replace(contact_force=wished.contact_force + random.normal(0.0, 5.0, (COUNT, 4, 3)))
    seen = []
    for robots, each in make_programs(of, wished, NOTHING, FRICTION, LIMITS, p):
        for number, robot in enumerate(robots):
            stands = wished.stance[robot]

            def cost(x: np.ndarray, robot: int = robot, stands: np.ndarray = stands) -> float:
                feet = of.jacobians[robot] @ x[:18] + of.foot_bias_acceleration[robot] - wished.foot_acceleration[robot]
                priority = np.where(stands, p.standing_priority, p.swinging_priority)
                turning = x[3:6] - wished.base_angular_acceleration[robot]
                forces = x[18:].reshape(-1, 3) - wished.contact_force[robot, stands]
                missed = (priority * (feet**2).sum(axis=1)).sum() + p.turning_priority * turning @ turning
                definite = 1e-6 * x[:6] @ x[:6] + 1e-5 * x[6:18] @ x[6:18]
                return 0.5 * float(missed + definite + p.force_priority * (forces**2).sum())

            rest = cost(np.zeros(18 + 3 * stands.sum()))
            for _ in range(3):
                x = random.normal(0.0, 10.0, 18 + 3 * stands.sum())
                value = 0.5 * x @ each.hessian[number] @ x + each.gradient[number] @ x
                np.testing.assert_allclose(value, cost(x) - rest, rtol=1e-9)
            seen.append(int(robot))
    assert sorted(seen) == list(range(COUNT))


def test_each_robot_s_forces_are_held_within_its_own_friction() -> None:
    of = bodies()
    bounds = Friction(0.2 + 0.1 * np.arange(COUNT), WEIGHT * (1.0 + np.arange(COUNT)))
    for robots, each in make_programs(of, wish(of), NOTHING, bounds, LIMITS, PRIORITIES):
        for number, robot in enumerate(robots):
            assert set(each.upper[number, 18 + 4 :: 5]) == {WEIGHT * (1.0 + robot)}
            assert set(-each.constraint_matrix[number, 18, 18:][[2]]) == {0.2 + 0.1 * robot}


def test_torques_stay_within_the_limits_of_each_joint() -> None:
    """The limits are asymmetric, as for moving motors with less torque in the direction of motion."""
    of = bodies()
    wished, free = wish(of), whole(of, wish(of)).torque
    most = np.where(free > 0.7 * free.max(), 0.9 * free, 60.0)
    least = np.where(free < 0.7 * free.min(), 0.9 * free, -60.0)
    found = solve_whole_body(of, wished, NOTHING, FRICTION, (least, most), PRIORITIES)
    assert found.has_solution.all()
    assert ((least - 1e-6 <= found.torque) & (found.torque <= most + 1e-6)).all()
    assert (np.abs(found.torque - free).max(axis=1) > 0.1).any()


def test_a_robot_without_torques_gets_none_and_the_others_theirs() -> None:
    of = bodies()
    wished, most = wish(of), FRICTION.max_normal_force.copy()
    most[2] = -1.0  # below the minimum normal force
    found = whole(of, wished, friction=FRICTION._replace(max_normal_force=most))
    assert found.has_solution.tolist() == [True, True, False, True, True, True]
    assert (found.torque[2] == 0.0).all()
    assert (found.acceleration[2] == 0.0).all()
    np.testing.assert_array_equal(found.torque[3], whole(of, wished).torque[3])


def test_legs_move_the_feet_as_wished() -> None:
    """The trunk accelerates as the contact forces and the wrench move it."""
    of, wrench = bodies(), np.random.default_rng(9).normal(0.0, 5.0, (COUNT, 6))
    wished = wish(of)
    found = leg_torques(of, wished, wrench, LIMITS)
    trunk = (wished.contact_force.sum(axis=1) + wrench[:, :3]) / ROBOT.mass - [0.0, 0.0, GRAVITY]
    motion = np.concatenate((trunk, wished.base_angular_acceleration, found.acceleration), axis=1)
    feet = np.einsum("nlxk,nk->nlx", of.jacobians, motion) + of.foot_bias_acceleration
    np.testing.assert_allclose(feet, wished.foot_acceleration, atol=0.3)  # nearly straight legs have a small error


def test_a_swinging_leg_bears_no_force_and_a_leg_without_a_finite_wish_leaves_its_robot_without_torques() -> None:
    of = bodies()
    wished = wish(of)
    found = leg_torques(of, wished, NOTHING, LIMITS)
    pressed = wished._replace(contact_force=np.where(wished.stance[..., None], wished.contact_force, 30.0))
    np.testing.assert_array_equal(leg_torques(of, pressed, NOTHING, LIMITS).torque, found.torque)
    feet = wished.foot_acceleration.copy()
    feet[3, 2, 0] = np.nan
    broken = leg_torques(of, wished._replace(foot_acceleration=feet), NOTHING, LIMITS)
    assert broken.has_solution.tolist() == [True, True, True, False, True, True]
    np.testing.assert_array_equal(broken.torque[broken.has_solution], found.torque[broken.has_solution])


def test_legs_hold_a_robot_that_stands() -> None:
    """The torques are -Jᵀf for the contact forces plus h for gravity."""
    of = bodies(0.0)
    wished = wish(of)._replace(stance=np.ones((COUNT, 4), np.bool_), base_angular_acceleration=np.zeros((COUNT, 3)))
    forces = np.zeros((COUNT, 4, 3))
    forces[..., 2] = WEIGHT / 4.0
    wished = wished._replace(contact_force=forces, foot_acceleration=np.zeros((COUNT, 4, 3)))
    found = leg_torques(of, wished, NOTHING, LIMITS)
    held = of.bias_force[:, 6:] - np.einsum("nlxk,nlx->nk", of.jacobians, forces)[:, 6:]
    np.testing.assert_allclose(found.torque, held, atol=1e-9)
    np.testing.assert_allclose(found.acceleration, 0.0, atol=1e-9)


def test_legs_ask_for_no_more_than_the_motors_give() -> None:
    """The limits differ between joints and directions; the reference accelerates feet with 500 m/s²."""
    of, random = bodies(), np.random.default_rng(10)
    limits = -random.uniform(20.0, 40.0, (COUNT, 12)), random.uniform(41.0, 60.0, (COUNT, 12))
    hasty = wish(of)._replace(foot_acceleration=500.0 * random.choice((-1.0, 1.0), (COUNT, 4, 3)))
    found = leg_torques(of, hasty, NOTHING, limits)
    free = leg_torques(of, hasty, NOTHING, (np.full((COUNT, 12), -np.inf), np.full((COUNT, 12), np.inf))).torque
    below, above = free < limits[0], free > limits[1]
    assert min(below.sum(), above.sum()) > COUNT
    np.testing.assert_array_equal(found.torque[below], limits[0][below])
    np.testing.assert_array_equal(found.torque[above], limits[1][above])
    np.testing.assert_array_equal(found.torque[~below & ~above], free[~below & ~above])
    assert found.has_solution.all()
