"""Operations on the motion states of robots: position feedback, load on the trunk, and selection of robots."""

from typing import Any, NamedTuple, TypeVar

import numpy as np

from policies.contact.motion_state import MotionState
from policies.gait_cycle import Floats
from policies.velocity_error_integral import VelocityErrorIntegral
from quad_env.columns import EnvIndices
from quad_env.config import GRAVITY
from quad_env.physics.rotations import cross, skew

P = TypeVar("P", bound=Any)

MAX_LOAD = 40.0
"""Upper bound of the mass of a load on the trunk that the controller estimates, kg."""
MAX_LOAD_OFFSET = 0.25
"""Bound of the estimated forward and of the estimated lateral distance of a load from the trunk centre, m."""
MIN_LOAD = 0.5
"""Smallest estimated mass of a load on the trunk that is not set to zero, kg.

A smaller mass is set to zero, because it may come from an error of the robot model."""


def select_robots(state: P, robots: EnvIndices) -> P:
    """Return a copy of the nested tuple `state` in which every array has only the rows of the selected `robots`.

    Args:
        state: Array of n robots, or nested (named) tuple of arrays of n robots, for example a `MotionState`. The first
            axis of each array runs over the robots.
        robots: Indices of the g selected robots, (g,), or mask with True for them, (n,).

    Returns:
        Tuple of the same type, with arrays of g robots.
    """
    if isinstance(state, tuple):
        return type(state)(*(select_robots(part, robots) for part in state))
    selected: P = state[robots]
    return selected


def replace_robots(state: P, robots: EnvIndices, replacement: P) -> P:
    """Return a copy of a nested tuple of arrays in which the rows of some robots are replaced.

    Args:
        state: Nested (named) tuple of arrays of n robots, for example a `MotionState`. The first axis of each array
            runs over the robots.
        robots: Indices of the g robots to replace, (g,).
        replacement: Tuple of the same type with the new rows of the g robots.

    Returns:
        Copy of `state` with the rows of `replacement` for the g robots.
    """
    if isinstance(state, tuple):
        pairs = zip(state, replacement, strict=True)
        return type(state)(*(replace_robots(old, robots, new) for old, new in pairs))
    replaced: P = state.copy()
    replaced[robots] = replacement
    return replaced


class PositionFeedback(VelocityErrorIntegral):
    """Corrects the velocity commands of n robots by their position errors.

    The correction is an additional velocity that reduces the position error.

    Args:
        max_error: Bound of the forward and lateral position error, m, and of the yaw error, rad.
        period: Control period, s.
        max_return_speed: Largest horizontal speed of the corrected command, m/s. If the command without the correction
            is faster, the limit is the speed of this command.
    """

    def __init__(self, max_error: float, period: float, max_return_speed: float = np.inf) -> None:
        self._max_return_speed = max_return_speed
        super().__init__(max_error, period)

    def with_position_feedback(self, state: MotionState, gain: float) -> MotionState:
        """Update the position error, and return the state with a command that also corrects this error.

        Args:
            state: State of n robots with their commands.
            gain: Feedback gain, 1/s: velocity added to the command per position error, and yaw rate per yaw error.

        Returns:
            The state with the corrected command: command + gain × position error, with a limited horizontal speed.
        """
        velocity = np.concatenate((state.velocity[:, :2], state.angular_velocity[:, 2:]), axis=1)
        command = state.command + gain * self.update(state.command, velocity)
        speed = np.hypot(command[:, 0], command[:, 1])
        commanded_speed = np.hypot(state.command[:, 0], state.command[:, 1])
        max_speed = np.maximum(commanded_speed, self._max_return_speed)
        command[:, :2] *= np.minimum(1.0, max_speed / np.maximum(speed, 1e-9))[:, None]
        return state._replace(command=command)


class PointLoad(NamedTuple):
    """Estimated loads on the trunks of n robots, each a point mass fixed to the trunk."""

    mass: Floats
    """Mass of the load on the trunk of each robot, (n,), kg; 0 for a robot that carries no load."""
    position: Floats
    """Position of the load of each robot relative to the trunk centre, base frame, (n, 3), m."""

    def gravity_wrench(self, rotation: Floats) -> Floats:
        """Return the weight of the loads as a wrench (force and moment) on the trunks.

        Args:
            rotation: Rotation from the base to the level frame (yaw only), (n, 3, 3).

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
    """Estimate the load on the trunk of each robot from the low-pass filtered external wrench.

    The downward force is taken as the weight of the load. The lateral position of the load is the roll moment divided
    by the weight. The forward position is the pitch moment divided by the weight.

    Args:
        wrench: External wrench on the trunk, (n, 6): force, level frame (yaw only), N, then moment, base frame, N·m.
        height: Assumed height of the load above the trunk centre, m.

    Returns:
        Loads of n robots.
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
    """Add the loads on the trunks to the dynamics terms of the robots.

    A load of mass m adds m Jᵀ J to the inertia matrix and m Jᵀ (a + g) to the bias force. J is the Jacobian of the load
    position, and a the acceleration of the load at zero generalised acceleration. g is the vector of the acceleration
    of gravity with its sign reversed, so that it points upward.

    Args:
        motion: State of n robots, with the dynamics of the robots alone.
        load: Loads of the robots.

    Returns:
        The state with the dynamics of robots and loads together; `motion` itself if no robot has a load.
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
    """Return the Jacobian of the load position: load velocity, level frame, per generalised velocity, (n, 3, 18).

    The level frame turns only with the yaw of the robot, and its z axis points up.
    """
    count, size = motion.generalised_velocity.shape
    jacobian = np.zeros((count, 3, size))
    jacobian[:, :, :3] = np.eye(3)
    jacobian[:, :, 3:6] = -motion.rotation @ skew(load.position)
    return jacobian


def _load_bias_acceleration(motion: MotionState, load: PointLoad) -> Floats:
    """Return the centripetal acceleration ω × (ω × r) of the load, level frame (yaw only), (n, 3), m/s².

    ω is the angular velocity of the trunk and r the position of the load relative to the trunk centre.
    """
    angular_velocity_base = motion.generalised_velocity[:, 3:6]
    centripetal = cross(angular_velocity_base, cross(angular_velocity_base, load.position))
    acceleration: Floats = np.einsum("nij,nj->ni", motion.rotation, centripetal)
    return acceleration
