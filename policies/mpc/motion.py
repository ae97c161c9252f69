"""What a robot is doing now, from its observation, with the dynamics of its bodies there."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.legs.level_frame import level_frame
from quad_env import OBSERVATION
from quad_env.columns import of_robots
from quad_env.physics.dynamics import Dynamics, RigidBodies
from quad_env.physics.state import rotation_matrix
from quad_env.robots.robot import Robot


class Motion(NamedTuple):
    """Motion of n robots, in the level frame at the trunk's centre with x ahead."""

    tilt: Floats
    """Roll and pitch, (n, 2), rad."""
    rotation: Floats
    """From the base to the level frame, (n, 3, 3)."""
    velocity: Floats
    """Of the trunk's centre, (n, 3), m/s."""
    turning: Floats
    """Angular velocity, (n, 3), rad/s."""
    generalised: Floats
    """Generalised velocity, (n, 18), as `quad_env.physics.dynamics` has it."""
    angles: Floats
    """Of the joints, (n, 12), rad."""
    targets: Floats
    """Joint targets of the control period that has passed, (n, 12), rad."""
    command: Floats
    """(n, 3), m/s, m/s and rad/s."""
    bodies: RigidBodies
    feet_velocity: Floats
    """(n, 4, 3), m/s."""


def motion(robot: Robot, dynamics: Dynamics, observation: NDArray[np.float32] | Floats) -> Motion:
    """Motion of observations (n, k)."""
    rows = observation.astype(np.float64)
    frame = level_frame(rows[:, OBSERVATION["projected_gravity"]].T)
    roll, pitch = frame.roll, frame.pitch
    orientation = _quaternion(roll, pitch)
    rotation = np.moveaxis(np.array(rotation_matrix(of_robots(orientation))), -1, 0)
    turning = rows[:, OBSERVATION["angular_velocity"]]
    velocity = np.einsum("nij,nj->ni", rotation, rows[:, OBSERVATION["linear_velocity"]])
    angles = rows[:, OBSERVATION["joint_position"]] + robot.home_pose
    speeds = rows[:, OBSERVATION["joint_velocity"]]
    generalised = np.concatenate((velocity, turning, speeds), axis=1)
    bodies = dynamics.at(orientation, velocity, turning, angles, speeds)
    return Motion(
        tilt=np.stack((roll, pitch), axis=-1),
        rotation=rotation,
        velocity=velocity,
        turning=np.einsum("nij,nj->ni", rotation, turning),
        generalised=generalised,
        angles=angles,
        targets=rows[:, OBSERVATION["previous_action"]] + robot.home_pose,
        command=rows[:, OBSERVATION["command"]],
        bodies=bodies,
        feet_velocity=np.einsum("nlxk,nk->nlx", bodies.jacobians, generalised),
    )


def _quaternion(roll: Floats, pitch: Floats) -> Floats:
    """From the base to the level frame, (w, x, y, z), (n, 4): a turn by `roll` about x, then by `pitch` about y."""
    (cr, sr), (cp, sp) = (np.cos(roll / 2), np.sin(roll / 2)), (np.cos(pitch / 2), np.sin(pitch / 2))
    return np.stack((cp * cr, cp * sr, sp * cr, -sp * sr), axis=-1)
