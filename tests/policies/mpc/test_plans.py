"""A plan continues at its present step, with any stance feet."""

import numpy as np
import pytest

from policies.mpc.plans import ForcePlans, distribute_wrench
from policies.mpc.rigid_body import Friction

STEPS, PERIOD, WEIGHT = 5, 0.04, 140.0
FEET = np.array([[0.25, 0.25, -0.4], [0.25, -0.25, -0.4], [-0.25, 0.25, -0.4], [-0.25, -0.25, -0.4]])
FIRST = np.array([True, False, False, True])
FRICTION = Friction(np.array([0.6]), np.array([170.0]))


def planned() -> tuple[ForcePlans, np.ndarray]:
    """Return one robot's plan, two steps on a pair of feet and three on the other pair, and its forces, (5, 4, 3)."""
    plans = ForcePlans(STEPS, PERIOD, WEIGHT)
    stands = np.array([[FIRST] * 2 + [~FIRST] * 3])
    forces = np.random.default_rng(5).normal([5.0, -3.0, 70.0], 3.0, (1, STEPS, 4, 3)) * stands[..., None]
    plans.renew(np.array([0]), forces, stands, np.tile(FEET, (1, STEPS, 1, 1)))
    return plans, forces[0]


@pytest.mark.parametrize(("time", "step"), [(0.0, 0), (0.03, 0), (0.08, 2), (3.0, 4)])
def test_a_plan_is_followed_at_its_age(time: float, step: int) -> None:
    plans, forces = planned()
    for _ in range(round(time / 0.01)):
        plans.advance(0.01)
    standing = FIRST if step < 2 else ~FIRST
    np.testing.assert_array_equal(plans.present_forces(standing[None], FEET[None], FRICTION)[0], forces[step])


def test_a_plan_is_due_where_other_feet_stand_than_planned() -> None:
    plans, _ = planned()
    assert not plans.due(FIRST[None], 0.1)
    assert plans.due(np.array([[True, True, False, True]]), 0.1)
    for _ in range(8):
        plans.advance(0.01)
    assert plans.due(FIRST[None], 0.1)
    assert not plans.due(~FIRST[None], 0.1)


def test_plans_are_due_by_their_age_and_by_their_feet_each_robot_s_alone() -> None:
    plans, standing = ForcePlans(STEPS, PERIOD, WEIGHT), np.ones((3, 4), np.bool_)
    plans.reset(3)
    plans.age[:], standing[1, 0] = (0.2, 0.0, 0.0), False
    assert plans.due(standing, 0.1).tolist() == [True, True, False]


def test_other_feet_share_the_wrench_that_was_planned() -> None:
    plans, forces = planned()
    standing = np.ones((1, 4), np.bool_)
    found = plans.present_forces(standing, FEET[None], FRICTION)[0]
    np.testing.assert_allclose(found.sum(axis=0), forces[0].sum(axis=0), atol=0.05)
    moment, other = np.cross(FEET, found).sum(axis=0), np.cross(FEET, forces[0]).sum(axis=0)
    np.testing.assert_allclose(moment, other, atol=0.05)
    assert (found[:, 2] > 10.0).all()


def test_a_wrench_is_that_of_the_feet_where_they_were_planned_to_be_and_each_robot_s_own() -> None:
    """The first of two robots stands as planned; the second stands on all feet, which have moved since."""
    plans = ForcePlans(STEPS, PERIOD, WEIGHT)
    plans.reset(2)
    stands = np.array([[FIRST] * STEPS] * 2)
    forces = np.zeros((2, STEPS, 4, 3))
    forces[:, :, FIRST] = (5.0, -3.0, 70.0), (-2.0, 1.0, 60.0)
    plans.renew(np.arange(2), forces, stands, np.tile(FEET, (2, STEPS, 1, 1)))
    moved, standing = FEET + np.array([0.06, -0.04, 0.0]), np.array([FIRST, np.ones(4, np.bool_)])
    friction = Friction(np.full(2, 0.6), np.full(2, 170.0))
    found = plans.present_forces(standing, np.stack((moved, moved)), friction)
    np.testing.assert_array_equal(found[0], forces[0, 0])
    np.testing.assert_allclose(found[1].sum(axis=0), forces[1, 0].sum(axis=0), atol=0.05)
    moment, planned_one = np.cross(moved, found[1]).sum(axis=0), np.cross(FEET, forces[1, 0]).sum(axis=0)
    np.testing.assert_allclose(moment, planned_one, atol=0.05)


def test_at_first_every_foot_bears_a_quarter_of_the_weight() -> None:
    plans = ForcePlans(STEPS, PERIOD, WEIGHT)
    plans.reset(2)
    all_four = np.ones((2, 4), np.bool_)
    assert plans.due(all_four, 0.1).all()
    found = plans.present_forces(all_four, np.stack((FEET, FEET)), Friction(np.full(2, 0.6), np.full(2, 170.0)))
    np.testing.assert_allclose(found, np.tile([0.0, 0.0, 35.0], (2, 4, 1)))


def test_shared_forces_stay_within_friction() -> None:
    wrench = np.array([[300.0, 0.0, 100.0, 200.0, 0.0, 0.0]])
    found = distribute_wrench(wrench, FIRST[None], FEET[None], FRICTION)[0]
    assert (found[~FIRST] == 0.0).all()
    assert (found[:, 2] >= 0.0).all()
    assert (np.abs(found[:, :2]) <= 0.6 * found[:, 2:] + 1e-9).all()
    assert found[:, 0].max() > 1.0
    heavy = np.array([[0.0, 0.0, 1000.0, 0.0, 0.0, 0.0]])
    np.testing.assert_allclose(distribute_wrench(heavy, FIRST[None], FEET[None], FRICTION)[0, FIRST, 2], 170.0)
