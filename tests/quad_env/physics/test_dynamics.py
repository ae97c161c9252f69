"""Dynamics of the bodies, compared with finite differences, energies and sums over the bodies."""

import mujoco
import numpy as np
import pytest

from quad_env.config import GRAVITY
from quad_env.physics.dynamics import Dynamics, DynamicsTerms
from quad_env.robots.simple_quad import SIMPLE_QUAD

DYNAMICS = Dynamics(SIMPLE_QUAD)
STEP = 1e-6


class State:
    """A robot with motion in every coordinate."""

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        turn = random.normal(size=4)
        self.orientation = turn / np.linalg.norm(turn)
        self.velocity, self.turning = random.normal(size=3), random.normal(size=3)
        self.angles = SIMPLE_QUAD.home_pose + 0.3 * random.normal(size=12)
        self.speeds = 2.0 * random.normal(size=12)
        self.position = np.zeros(3)

    def bodies(self) -> DynamicsTerms:
        """Return the dynamics of the state, without the batch axis."""
        parts = (self.orientation, self.velocity, self.turning, self.angles, self.speeds)
        return DynamicsTerms(*(each[0] for each in DYNAMICS.compute(*(part[None] for part in parts))))

    def moved(self, step: float) -> "State":
        """Return the state a time step later, at constant generalised velocity."""
        later = State.__new__(State)
        later.__dict__.update(self.__dict__)
        later.orientation = self.orientation.copy()
        mujoco.mju_quatIntegrate(later.orientation, self.turning, step)
        later.position, later.angles = self.position + step * self.velocity, self.angles + step * self.speeds
        return later

    def difference(self, name: str) -> np.ndarray:
        """Return the rate of change of a position, world frame."""
        before, after = self.moved(-STEP), self.moved(STEP)
        change = getattr(after.bodies(), name) - getattr(before.bodies(), name)
        return (change + (after.position - before.position)) / (2.0 * STEP)

    @property
    def generalised(self) -> np.ndarray:
        return np.concatenate((self.velocity, self.turning, self.speeds))


@pytest.fixture(params=range(2))
def state(request: pytest.FixtureRequest) -> State:
    return State(request.param)


def test_jacobians_give_the_velocities_of_the_feet(state: State) -> None:
    np.testing.assert_allclose(state.bodies().jacobians @ state.generalised, state.difference("feet"), atol=1e-7)


def test_drift_is_the_change_of_the_feet_s_velocities_at_a_constant_generalised_one(state: State) -> None:
    after, before = (state.moved(step).bodies().jacobians @ state.generalised for step in (STEP, -STEP))
    np.testing.assert_allclose(state.bodies().foot_bias_acceleration, (after - before) / (2.0 * STEP), atol=1e-6)


def test_the_centre_of_mass_moves_as_it_says(state: State) -> None:
    np.testing.assert_allclose(state.bodies().com_velocity, state.difference("com_position"), atol=1e-7)


def test_the_bias_at_rest_is_the_weight(state: State) -> None:
    state.velocity, state.turning, state.speeds = np.zeros(3), np.zeros(3), np.zeros(12)
    bias = state.bodies().bias_force

    def height(index: int, step: float) -> float:
        other = State.__new__(State)
        other.__dict__.update(state.__dict__)
        rates = np.eye(18)[index]
        other.velocity, other.turning, other.speeds = rates[:3], rates[3:6], rates[6:]
        later = other.moved(step)
        return float(later.bodies().com_position[2] + later.position[2])

    slope = [(height(index, STEP) - height(index, -STEP)) / (2.0 * STEP) for index in range(18)]
    np.testing.assert_allclose(bias, SIMPLE_QUAD.mass * GRAVITY * np.array(slope), atol=1e-4)


def test_the_inertia_is_that_of_the_bodies(state: State) -> None:
    """The momentum of the whole robot follows the centre of mass; the locked robot has the rotational inertia."""
    bodies = state.bodies()
    momentum = bodies.inertia @ state.generalised
    np.testing.assert_allclose(momentum[:3], SIMPLE_QUAD.mass * bodies.com_velocity, atol=1e-9)
    state.speeds = np.zeros(12)
    locked, rotation = state.bodies(), np.empty(9)
    mujoco.mju_quat2Mat(rotation, state.orientation)
    turn = rotation.reshape(3, 3)
    about_centre = locked.rotational_inertia @ (turn @ state.turning)
    carried = np.cross(locked.com_position, SIMPLE_QUAD.mass * locked.com_velocity)
    angular = turn.T @ (about_centre + carried)
    np.testing.assert_allclose((locked.inertia @ state.generalised)[3:6], angular, atol=1e-9)


def test_joint_damping_is_part_of_the_bias(state: State) -> None:
    """Only the damping, 0.2 N·m·s/rad in the MJCF, changes the bias with the sign of the velocity."""
    bias = state.bodies().bias_force[6:]
    state.velocity, state.turning, state.speeds = -state.velocity, -state.turning, -state.speeds
    np.testing.assert_allclose(0.5 * (bias - state.bodies().bias_force[6:]), -0.2 * state.speeds, atol=1e-9)
