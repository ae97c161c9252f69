"""Operations on motion states: position feedback, load on the trunk, and selection of robots."""

from typing import Any, NamedTuple, TypeVar

import numpy as np

from policies.contact.motion_state import MotionState
from policies.gait_cycle import Floats
from policies.memory import PerRobotState, per_robot
from quad_env.columns import EnvIndices
from quad_env.config import GRAVITY
from quad_env.physics.rotations import cross, skew

P = TypeVar("P", bound=Any)

MAX_LOAD = 40.0
"""Largest load that the estimate accepts, kg."""
MAX_LOAD_OFFSET = 0.25
"""Largest forward or lateral distance of a load from the trunk centre, m."""
MIN_LOAD = 0.5
"""Smallest load that counts, kg; a smaller one is taken as an error of the model."""


def select_robots(state: P, robots: EnvIndices) -> P:
    """Return the entries of `robots`, (g,) indices or mask, of every array in a nested tuple `state`."""
    if isinstance(state, tuple):
        return type(state)(*(select_robots(part, robots) for part in state))
    selected: P = state[robots]
    return selected


def replace_robots(state: P, robots: EnvIndices, replacement: P) -> P:
    """Return a nested tuple of arrays in which some robots are replaced.

    Args:
        state: Nested tuple of arrays of n robots.
        robots: Indices of the robots to replace, (g,).
        replacement: Tuple with the same structure, of g robots.

    Returns:
        Copy of `state` with the entries of `replacement`.
    """
    if isinstance(state, tuple):
        pairs = zip(state, replacement, strict=True)
        return type(state)(*(replace_robots(old, robots, new) for old, new in pairs))
    replaced: P = state.copy()
    replaced[robots] = replacement
    return replaced


class PositionErrorIntegrator(PerRobotState):
    """Integrates the velocity error in the heading frame into a position error.

    The position error replaces the position set point of `ConvexMPCLocomotion` in MIT's Cheetah-Software. A new command
    resets the integral to zero.

    Args:
        max_error: Largest position error, m, and yaw error, rad.
        period: Control period, s.
        max_return_speed: Largest speed of the corrected command, m/s. A command that is faster keeps its own speed.
    """

    position_error: Floats = per_robot(np.zeros(3))
    """Forward and lateral position error, m, and yaw error, rad, (n, 3)."""
    _command: Floats = per_robot(np.zeros(3))
    """Last command, (n, 3), m/s and rad/s."""

    def __init__(self, max_error: float, period: float, max_return_speed: float = np.inf) -> None:
        self._max_error = max_error
        self._period = period
        self._max_return_speed = max_return_speed
        super().__init__()

    def with_position_feedback(self, state: MotionState, gain: float) -> MotionState:
        """Return the state with a command that also corrects the position error.

        Args:
            state: State of n robots.
            gain: Velocity per position error, 1/s.

        Returns:
            The state with the corrected command.
        """
        velocity = np.concatenate((state.velocity[:, :2], state.angular_velocity[:, 2:]), axis=1)
        position_error = self.position_error + self._period * (state.command - velocity)
        is_same_command = (state.command == self._command).all(axis=1, keepdims=True)
        bounded_error = position_error.clip(-self._max_error, self._max_error)
        self.position_error = np.where(is_same_command, bounded_error, 0.0)
        self._command = state.command
        command = state.command + gain * self.position_error
        speed = np.hypot(command[:, 0], command[:, 1])
        commanded_speed = np.hypot(state.command[:, 0], state.command[:, 1])
        max_speed = np.maximum(commanded_speed, self._max_return_speed)
        command[:, :2] *= np.minimum(1.0, max_speed / np.maximum(speed, 1e-9))[:, None]
        return state._replace(command=command)


class PointLoad(NamedTuple):
    """Loads of n robots, each a point mass fixed to the trunk."""

    mass: Floats
    """Mass of the load, (n,), kg."""
    position: Floats
    """Position of the load relative to the trunk centre, base frame, (n, 3), m."""

    def gravity_wrench(self, rotation: Floats) -> Floats:
        """Return the weight of the loads as a wrench on the trunk.

        Args:
            rotation: Rotation from the base to the level frame, (n, 3, 3).

        Returns:
            Force in the level frame, N, and moment about the trunk centre in the base frame, N·m, (n, 6).
        """
        if not self.mass.any():
            return np.zeros((len(self.mass), 6))
        force = np.zeros_like(self.position)
        force[:, 2] = -GRAVITY * self.mass
        moment = cross(self.position, np.einsum("nji,nj->ni", rotation, force))
        return np.concatenate((force, moment), axis=1)


def estimate_load(wrench: Floats, height: float) -> PointLoad:
    """Estimate the load from a lasting wrench: the weight of the load is the downward force.

    Args:
        wrench: External wrench on the trunk, (n, 6), N and N·m.
        height: Assumed height of the load above the trunk centre, m.

    Returns:
        Loads of n robots; their horizontal positions follow from the moments.
    """
    mass = (-wrench[:, 2] / GRAVITY).clip(0.0, MAX_LOAD)
    mass = np.where(mass < MIN_LOAD, 0.0, mass)
    weight = GRAVITY * np.maximum(mass, MIN_LOAD)
    position = np.full((len(mass), 3), height)
    position[:, 0] = wrench[:, 4] / weight
    position[:, 1] = -wrench[:, 3] / weight
    position[:, :2] = position[:, :2].clip(-MAX_LOAD_OFFSET, MAX_LOAD_OFFSET)
    return PointLoad(mass, position)


def add_load(motion: MotionState, load: PointLoad) -> MotionState:
    """Add the loads to the dynamics of the robots.

    A load of mass m with the Jacobian J adds m Jᵀ J to the inertia matrix and m Jᵀ (a + g) to the bias force; a is the
    acceleration of the load at zero generalised acceleration.

    Args:
        motion: State of n robots.
        load: Loads of the robots.

    Returns:
        The state with the dynamics of the loaded robots; `motion` itself if no robot has a load.
    """
    if not load.mass.any():
        return motion
    bodies = motion.bodies
    added_mass = load.mass[:, None]
    arm = np.einsum("nij,nj->ni", motion.rotation, load.position)
    jacobian = _load_jacobian(motion, load)
    acceleration = _load_bias_acceleration(motion, load) + np.array([0.0, 0.0, GRAVITY])
    velocity = np.einsum("nxk,nk->nx", jacobian, motion.generalised_velocity)
    mass = bodies.mass[:, None]
    mass_fraction = added_mass / (mass + added_mass)
    com_to_load = skew(arm - bodies.com_position)
    reduced_mass = (mass_fraction * mass)[..., None]
    loaded_bodies = bodies._replace(
        mass=bodies.mass + load.mass,
        inertia=bodies.inertia + added_mass[..., None] * np.einsum("nxi,nxj->nij", jacobian, jacobian),
        bias_force=bodies.bias_force + added_mass * np.einsum("nxk,nx->nk", jacobian, acceleration),
        com_position=bodies.com_position + mass_fraction * (arm - bodies.com_position),
        com_velocity=bodies.com_velocity + mass_fraction * (velocity - bodies.com_velocity),
        rotational_inertia=bodies.rotational_inertia - reduced_mass * (com_to_load @ com_to_load),
    )
    return motion._replace(bodies=loaded_bodies)


def _load_jacobian(motion: MotionState, load: PointLoad) -> Floats:
    """Return the Jacobian of the load position, level frame, (n, 3, 18)."""
    count, size = motion.generalised_velocity.shape
    jacobian = np.zeros((count, 3, size))
    jacobian[:, :, :3] = np.eye(3)
    jacobian[:, :, 3:6] = -motion.rotation @ skew(load.position)
    return jacobian


def _load_bias_acceleration(motion: MotionState, load: PointLoad) -> Floats:
    """Return the centripetal acceleration of the load, level frame, (n, 3), m/s²."""
    angular_velocity_base = motion.generalised_velocity[:, 3:6]
    centripetal = cross(angular_velocity_base, cross(angular_velocity_base, load.position))
    acceleration: Floats = np.einsum("nij,nj->ni", motion.rotation, centripetal)
    return acceleration
