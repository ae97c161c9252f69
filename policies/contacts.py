"""Contacts of the feet over time, commanded and measured, and what they say of the gait."""

import numpy as np
from numpy.typing import NDArray

from policies.gait import TURN, Floats
from policies.kinematics import foot_positions
from quad_env.robot import FOOT_RADIUS, HIP_POSITIONS

Contacts = NDArray[np.bool_]


def on_flat_ground(height: Floats, projected_gravity: Floats, joints: Floats) -> Contacts:
    """Which feet touch the plane z = 0, (..., 4).

    By the trunk's height (...), m, gravity in the base frame (..., 3) and joint angles (..., 12), rad: the feet are
    spheres, and their centres come from the leg's kinematics.
    """
    feet = foot_positions(joints.reshape(*joints.shape[:-1], 4, 3)) + HIP_POSITIONS
    centre = height[..., None] - (feet * projected_gravity[..., None, :]).sum(axis=-1)
    touching: Contacts = centre < FOOT_RADIUS
    return touching


def duty_factors(contacts: Contacts) -> Floats:
    """Share of the time that each foot is on the ground, (..., 4), for contacts (steps, ..., 4)."""
    shares: Floats = contacts.mean(axis=0)
    return shares


def stance_offsets(contacts: Contacts, phase: Floats) -> Floats:
    """Phase of each leg ahead of the first one's by the middle of its stance, cycles from -1/2 to 1/2, (..., 4).

    From contacts (steps, ..., 4) and the clock (steps, ...), rad: the first harmonic of a contact over the cycle points
    to its middle, wherever touch-down and lift-off chatter.
    """
    middle = np.angle((contacts * np.exp(1j * phase)[..., None]).sum(axis=0))
    return wrapped((middle[..., :1] - middle) / TURN)


def wrapped(cycles: Floats) -> Floats:
    """The same share of a cycle, from -1/2 up to 1/2."""
    shares: Floats = (cycles + 0.5) % 1.0 - 0.5
    return shares
