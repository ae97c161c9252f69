"""Plans of each robot, and the fallback of a robot without a plan."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from policies.contact.motion_state import MotionState, compute_motion_state
from policies.mpc.footing import TerrainPlane
from policies.mpc.policy import Mpc, MpcWbc
from policies.mpc.quadratic_program import QpBatch, Solutions, solve
from policies.mpc.rigid_body import CondensedMpc, Friction
from policies.mpc.whole_body import WholeBodyReference, leg_torques
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.policies.readings import reading

COMMAND = np.array([[0.0, 0.0, 0.0], [0.5, -0.2, 0.3]])
GROUND = TerrainPlane(np.array([-0.4, -0.45]), np.array([0.0, 0.2]), np.array([0.0, -0.1]))
"""The ground is level under the first robot; under the second it rises ahead and falls to the left."""
PUSHED = np.array([[0.0] * 6, [0.1, 0.2, 0.3, 1.0, 2.0, 3.0]])
"""Disturbance accelerations: linear, m/s², then angular, rad/s²."""
FRICTION = Friction(np.array([0.4, 0.7]), np.array([100.0, 170.0]))
STANDS = np.array([[True, False, False, True], [False, True, True, False]])


def two() -> MotionState:
    """Return the motion of two robots; the second robot is tilted and moves."""
    rows = reading(2)
    rows[1] = reading(1, projected_gravity=(0.1, -0.05, -0.99), linear_velocity=(0.3, 0.1, 0.0), command=COMMAND[1])
    return compute_motion_state(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), rows)


class Seen(CondensedMpc):
    """Horizon that stores the arguments of its programs."""

    asked: tuple[Any, ...] = ()

    def make_programs(self, *asked: Any) -> Iterator[Any]:
        self.asked = asked
        yield from super().make_programs(*asked)


def planned(policy: Mpc, due: list[bool]) -> tuple[Any, ...]:
    """Plan for the robots that are due, and return the arguments that the horizon got."""
    policy._horizon = Seen(policy._horizon.steps, policy._horizon.period, policy._horizon.weights)
    places = np.random.default_rng(0).uniform(-0.3, 0.3, (2, 10, 4, 3))
    stands = np.repeat(STANDS[:, None], 10, axis=1)
    failed = policy._plan(np.array(due), two(), GROUND, PUSHED, places, stands, FRICTION)
    assert not failed.any()
    np.testing.assert_array_equal(policy._horizon.asked[1], places[due])
    np.testing.assert_array_equal(policy._horizon.asked[2], stands[due])
    return policy._horizon.asked


def policy_of(kind: type[Mpc] = Mpc) -> Mpc:
    policy = kind()
    policy.reset(num_envs=2)
    return policy


@pytest.mark.parametrize("due", [[True, True], [False, True]])
def test_a_plan_leads_from_where_the_body_is_over_the_slope_to_the_command(due: list[bool]) -> None:
    """The plan goes from the body's pose relative to the slope to the command.

    The pose is the plane's roll, arctan of the rise to the left, and pitch, minus arctan of the rise ahead. The
    vertical velocity up the slope is 0.2 · 0.5 + 0.1 · 0.2 m/s.
    """
    policy, now = policy_of(), two()
    body, _, _, wanted, friction = planned(policy, due)
    tilt = now.tilt[1]
    pose = [tilt[0] + np.arctan(0.1), tilt[1] + np.arctan(0.2), 0.0, 0.0, 0.0, 0.45 - policy._trunk_height]
    np.testing.assert_allclose(body.pose[-1], pose)
    np.testing.assert_allclose(body.rate[-1], [*now.angular_velocity[1], *now.bodies.com_velocity[1]])
    np.testing.assert_allclose(body.acceleration[-1], [1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    rate = [0.0, 0.0, 0.3, 0.5, -0.2, 0.2 * 0.5 + 0.1 * 0.2]
    np.testing.assert_allclose(wanted.rate[-1, 0], rate)
    np.testing.assert_allclose(wanted.pose[-1, 4], 5 * policy._horizon.period * np.array(rate))
    assert (friction.coefficient[-1], friction.max_normal_force[-1]) == (0.7, 170.0)
    if all(due):
        np.testing.assert_allclose(body.pose[0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.4 - policy._trunk_height], atol=1e-7)


def test_only_plans_that_are_due_are_renewed() -> None:
    policy = policy_of()
    before = policy._plans.forces.copy()
    planned(policy, [False, True])
    assert policy._plans.age.tolist() == [np.inf, 0.0]
    np.testing.assert_array_equal(policy._plans.forces[0], before[0])
    np.testing.assert_array_equal(policy._plans.forces[1, :, [0, 3]], 0.0)


def refusing(programs: QpBatch) -> Solutions:
    return Solutions(np.zeros_like(programs.gradient), np.zeros(len(programs.gradient), np.bool_))


def test_a_robot_without_a_plan_goes_on_with_the_one_before_and_is_counted() -> None:
    policy = policy_of()
    before = policy._plans.forces.copy()
    policy._solver = refusing
    stands, places = np.repeat(STANDS[:, None], 10, axis=1), np.full((2, 10, 4, 3), 0.1)
    for _ in range(2):
        failed = policy._plan(np.array([False, True]), two(), GROUND, PUSHED, places, stands, FRICTION)
        assert failed.tolist() == [False, True]
    assert policy.failures.tolist() == [0, 2]
    np.testing.assert_array_equal(policy._plans.forces, before)
    policy.reset_where(np.array([False, True]))
    assert policy.failures.tolist() == [0, 0]


def test_feet_stand_over_the_horizon_now_as_they_do_and_then_by_the_gait() -> None:
    """At 2 Hz and steps of 40 ms, a step is 0.08 cycles and the first middle 0.04 cycles ahead.

    The first leg stands from the end of its swing on.
    """
    policy = policy_of()
    policy._frequencies = np.full(2, 2.0)
    policy._phase = 2.0 * np.pi * np.array([0.3, 0.3])
    gait = policy._gait
    assert gait.offsets[0] == 0.0
    swing = 1.0 - policy.parameters.duty
    stands, since = policy._make_schedule(np.array([[True] * 4, [False] * 4]))
    at = 0.3 + 2.0 * policy._horizon.step_middles
    by_gait = at % 1.0 >= swing
    np.testing.assert_array_equal(stands[0, 1:, 0], by_gait[1:])
    assert stands[0, 0].all()
    assert not stands[1, 0].any()
    np.testing.assert_allclose(since[0, by_gait, 0], (at[by_gait] % 1.0 - swing) / 2.0, atol=1e-9)


def test_without_a_solution_each_leg_goes_by_itself_and_the_other_robots_by_their_program() -> None:
    policy, now = policy_of(MpcWbc), two()
    standing = np.ones((2, 4), np.bool_)
    forces = np.zeros((2, 4, 3))
    forces[..., 2] = SIMPLE_QUAD.mass * 9.81 / 4.0
    wish, push = WholeBodyReference(np.zeros((2, 3)), np.zeros((2, 4, 3)), forces, standing), np.zeros((2, 6))
    whole = policy._solve_torques(now, wish, push, FRICTION)
    assert whole.has_solution.all()
    assert not policy.failures.any()

    def half(programs: QpBatch) -> Solutions:
        found = solve(programs)
        return found._replace(solved=found.solved & np.array([False, True]))

    policy._solver = half
    found = policy._solve_torques(now, wish, push, FRICTION)
    by_leg = leg_torques(now.bodies, wish, push, policy._torque_limits(now))
    assert found.has_solution.tolist() == [False, True]
    assert policy.failures.tolist() == [1, 0]
    np.testing.assert_array_equal(found.torque[0], by_leg.torque[0])
    np.testing.assert_array_equal(found.acceleration[0], by_leg.acceleration[0])
    np.testing.assert_array_equal(found.torque[1], whole.torque[1])
