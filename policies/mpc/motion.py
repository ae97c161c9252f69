"""What a robot is doing now, from its observation, with the dynamics of its bodies there and of the load it carries."""

from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.legs.level_frame import level_frame
from policies.memory import PerRobotState, per_robot
from quad_env import OBSERVATION
from quad_env.columns import EnvIndices
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import Dynamics, DynamicsTerms
from quad_env.physics.rotations import cross, skew
from quad_env.robots.robot import Robot

P = TypeVar("P", bound=Any)

LARGEST_LOAD = 40.0
"""Largest load that is believed, kg."""
LOAD_REACH = 0.25
"""Farthest from the trunk's centre, forward or lateral, that a load is taken to be, m."""
LEAST_LOAD = 0.5
"""kg from which a load is believed to be one; less is what the model is wrong by."""


class MotionState(NamedTuple):
    """Motion of n robots, in the level frame at the trunk's centre with x ahead."""

    tilt: Floats
    """Roll and pitch, (n, 2), rad."""
    rotation: Floats
    """From the base to the level frame, (n, 3, 3)."""
    velocity: Floats
    """Of the trunk's centre, (n, 3), m/s."""
    angular_velocity: Floats
    """Angular velocity, (n, 3), rad/s."""
    generalised_velocity: Floats
    """Generalised velocity, (n, 18), as `quad_env.physics.dynamics` has it."""
    joint_position: Floats
    """Of the joints, (n, 12), rad."""
    targets: Floats
    """Joint targets of the control period that has passed, (n, 12), rad."""
    command: Floats
    """(n, 3), m/s, m/s and rad/s."""
    bodies: DynamicsTerms
    foot_velocity: Floats
    """(n, 4, 3), m/s."""


def compute_motion_state(robot: Robot, dynamics: Dynamics, observation: NDArray[np.float32] | Floats) -> MotionState:
    """Motion of observations (n, k)."""
    rows = observation.astype(np.float64)
    frame = level_frame(rows[:, OBSERVATION["projected_gravity"]].T)
    tilt = np.array((frame.roll, frame.pitch))
    orientation, rotation = _attitude(tilt)
    turning = rows[:, OBSERVATION["angular_velocity"]]
    velocity = np.matmul(rotation, rows[:, OBSERVATION["linear_velocity"], None])[..., 0]
    angles = rows[:, OBSERVATION["joint_position"]] + robot.home_pose
    speeds = rows[:, OBSERVATION["joint_velocity"]]
    generalised = np.concatenate((velocity, turning, speeds), axis=1)
    bodies = dynamics.compute(orientation, velocity, turning, angles, speeds)
    return MotionState(
        tilt=tilt.T,
        rotation=rotation,
        velocity=velocity,
        angular_velocity=np.matmul(rotation, turning[..., None])[..., 0],
        generalised_velocity=generalised,
        joint_position=angles,
        targets=rows[:, OBSERVATION["previous_action"]] + robot.home_pose,
        command=rows[:, OBSERVATION["command"]],
        bodies=bodies,
        foot_velocity=np.matmul(bodies.jacobians, generalised[:, None, :, None])[..., 0],
    )


def select_robots(whole: P, rows: EnvIndices) -> P:
    """The parts of a motion of those rows."""
    if isinstance(whole, tuple):
        return type(whole)(*(select_robots(each, rows) for each in whole))
    found: P = whole[rows]
    return found


def replace_robots(whole: P, rows: EnvIndices, part: P) -> P:
    """The parts of a motion with those rows, (g,), of another's."""
    if isinstance(whole, tuple):
        return type(whole)(*(replace_robots(old, rows, new) for old, new in zip(whole, part, strict=True)))
    out: P = whole.copy()
    out[rows] = part
    return out


def _attitude(tilt: Floats) -> tuple[Floats, Floats]:
    """Quaternion (w, x, y, z), (n, 4), and rotation matrix, (n, 3, 3), from the base to the level frame, of roll and
    pitch, (2, n): a turn by roll about x, then by pitch about y."""
    (cr, cp), (sr, sp) = np.cos(0.5 * tilt), np.sin(0.5 * tilt)
    quaternion = np.array((cp * cr, cp * sr, sp * cr, -sp * sr)).T
    (cr, cp), (sr, sp) = np.cos(tilt), np.sin(tilt)
    # In one layout for any number of robots: the last bits of a product depend on it.
    rotation = np.zeros((tilt.shape[1], 3, 3))
    rotation[:, 0] = np.array((cp, sp * sr, sp * cr)).T
    rotation[:, 1, 1], rotation[:, 1, 2] = cr, -sr
    rotation[:, 2] = np.array((-sp, cp * sr, cp * cr)).T
    return quaternion, rotation


class PositionErrorIntegrator(PerRobotState):
    """How far n robots are behind their commands since these were given: the integral of the velocity error, in the
    heading frame, as the position set point of convex MPC on robots; see `ConvexMPCLocomotion` of MIT's
    Cheetah-Software.

    Args:
        farthest: distance, m, and angle, rad, that is counted at most.
        period: of control, s.
        fastest: speed that is asked for at most to catch up, m/s; a faster command keeps its own.
    """

    position_error: Floats = per_robot(np.zeros(3))
    """Forward, lateral, m, and yaw, rad, (n, 3)."""
    _command: Floats = per_robot(np.zeros(3))

    def __init__(self, farthest: float, period: float, fastest: float = np.inf) -> None:
        self._farthest, self._period, self._fastest = farthest, period, fastest
        super().__init__()

    def with_position_feedback(self, now: MotionState, gain: float) -> MotionState:
        """The motion with a command that also makes up for the way lost; `gain`: velocity per distance, 1/s."""
        velocity = np.concatenate((now.velocity[:, :2], now.angular_velocity[:, 2:]), axis=1)
        position_error = self.position_error + self._period * (now.command - velocity)
        same = (now.command == self._command).all(axis=1, keepdims=True)
        self.position_error = np.where(same, position_error.clip(-self._farthest, self._farthest), 0.0)
        self._command = now.command
        wished = now.command + gain * self.position_error
        speed, own = (np.hypot(each[:, 0], each[:, 1]) for each in (wished, now.command))
        wished[:, :2] *= np.minimum(1.0, np.maximum(own, self._fastest) / np.maximum(speed, 1e-9))[:, None]
        return now._replace(command=wished)


class PointLoad(NamedTuple):
    """Loads of n robots, each a point of mass fixed to the trunk."""

    mass: Floats
    """(n,), kg."""
    position: Floats
    """From the trunk's centre, base frame, (n, 3), m."""

    def gravity_wrench(self, rotation: Floats) -> Floats:
        """Its weight as a wrench, (n, 6): force in the level frame, N, moment about the trunk's centre in the base
        frame, N·m. `rotation`: from the base to the level frame, (n, 3, 3)."""
        if not self.mass.any():
            return np.zeros((len(self.mass), 6))
        force = np.zeros_like(self.position)
        force[:, 2] = -GRAVITY * self.mass
        moment = cross(self.position, np.einsum("nji,nj->ni", rotation, force))
        return np.concatenate((force, moment), axis=1)


def estimate_load(wrench: Floats, height: float) -> PointLoad:
    """The load whose weight is the downward force of a lasting wrench, (n, 6), `height` m above the trunk's centre."""
    mass = (-wrench[:, 2] / GRAVITY).clip(0.0, LARGEST_LOAD)
    mass = np.where(mass < LEAST_LOAD, 0.0, mass)
    weight, place = GRAVITY * np.maximum(mass, LEAST_LOAD), np.full((len(mass), 3), height)
    place[:, 0], place[:, 1] = wrench[:, 4] / weight, -wrench[:, 3] / weight
    place[:, :2] = place[:, :2].clip(-LOAD_REACH, LOAD_REACH)
    return PointLoad(mass, place)


def add_load(motion: MotionState, load: PointLoad) -> MotionState:
    """The same motion of robots whose bodies have these loads.

    A load is a point fixed to the trunk: with J its Jacobian and a its acceleration at zero generalised acceleration,
    the inertia matrix gains m Jᵀ J and the bias m Jᵀ (a + g).
    """
    if not load.mass.any():
        return motion
    bodies, rotation, generalised = motion.bodies, motion.rotation, motion.generalised_velocity
    turning, mass, added = generalised[:, 3:6], bodies.mass[:, None], load.mass[:, None]
    arm = np.einsum("nij,nj->ni", rotation, load.position)
    drift = np.einsum("nij,nj->ni", rotation, cross(turning, cross(turning, load.position)))
    jacobian = np.zeros((len(arm), 3, generalised.shape[1]))
    jacobian[:, :, :3] = np.eye(3)
    jacobian[:, :, 3:6] = -rotation @ skew(load.position)
    velocity = np.einsum("nxk,nk->nx", jacobian, generalised)
    held = drift + np.array([0.0, 0.0, GRAVITY])
    share = added / (mass + added)
    apart = skew(arm - bodies.com_position)
    reduced = (share * mass)[..., None]
    loaded_bodies = bodies._replace(
        mass=bodies.mass + load.mass,
        inertia=bodies.inertia + added[..., None] * np.einsum("nxi,nxj->nij", jacobian, jacobian),
        bias_force=bodies.bias_force + added * np.einsum("nxk,nx->nk", jacobian, held),
        com_position=bodies.com_position + share * (arm - bodies.com_position),
        com_velocity=bodies.com_velocity + share * (velocity - bodies.com_velocity),
        rotational_inertia=bodies.rotational_inertia - reduced * (apart @ apart),
    )
    return motion._replace(bodies=loaded_bodies)
