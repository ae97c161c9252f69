"""The load that a robot carries, estimated from the wrench that its feet do not explain, as a mass in its rigid bodies.

A load is a point fixed to the trunk: with J its Jacobian and a its acceleration at zero generalised acceleration, the
inertia matrix gains m Jᵀ J and the bias m Jᵀ (a + g).
"""

from typing import NamedTuple

import numpy as np

from policies.gait_cycle import Floats
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import RigidBodies
from quad_env.physics.rotations import skew

MOST = 40.0
"""Largest load that is believed, kg."""
REACH = 0.25
"""Farthest from the trunk's centre, forward or lateral, that a load is taken to be, m."""
LEAST = 0.5
"""kg from which a load is believed to be one; less is what the model is wrong by."""


class Load(NamedTuple):
    """Loads of n robots, each a point of mass fixed to the trunk."""

    mass: Floats
    """(n,), kg."""
    place: Floats
    """From the trunk's centre, base frame, (n, 3), m."""

    def pressing(self, rotation: Floats) -> Floats:
        """Its weight as a wrench, (n, 6): force in the level frame, N, moment about the trunk's centre in the base
        frame, N·m. `rotation`: from the base to the level frame, (n, 3, 3)."""
        force = np.zeros_like(self.place)
        force[:, 2] = -GRAVITY * self.mass
        moment = np.cross(self.place, np.einsum("nji,nj->ni", rotation, force))
        return np.concatenate((force, moment), axis=1)


def estimated_load(wrench: Floats, height: float) -> Load:
    """The load whose weight is the downward force of a lasting wrench, (n, 6), `height` m above the trunk's centre."""
    mass = np.clip(-wrench[:, 2] / GRAVITY, 0.0, MOST)
    mass = np.where(mass < LEAST, 0.0, mass)
    weight = GRAVITY * np.maximum(mass, LEAST)
    ahead, left = (np.clip(moment / weight, -REACH, REACH) for moment in (wrench[:, 4], -wrench[:, 3]))
    return Load(mass, np.stack((ahead, left, np.full_like(mass, height)), axis=-1))


def loaded(bodies: RigidBodies, rotation: Floats, generalised: Floats, load: Load) -> RigidBodies:
    """The bodies with their loads. `rotation`: from the base to the world frame, (n, 3, 3); `generalised`: velocity,
    (n, 18)."""
    turning, mass, added = generalised[:, 3:6], bodies.mass[:, None], load.mass[:, None]
    arm = np.einsum("nij,nj->ni", rotation, load.place)
    drift = np.einsum("nij,nj->ni", rotation, np.cross(turning, np.cross(turning, load.place)))
    jacobian = np.zeros((len(arm), 3, generalised.shape[1]))
    jacobian[:, :, :3] = np.eye(3)
    jacobian[:, :, 3:6] = -rotation @ skew(load.place)
    velocity = np.einsum("nxk,nk->nx", jacobian, generalised)
    held = drift + np.array([0.0, 0.0, GRAVITY])
    share = added / (mass + added)
    apart = skew(arm - bodies.centre)
    reduced = (share * mass)[..., None]
    return bodies._replace(
        mass=bodies.mass + load.mass,
        inertia=bodies.inertia + added[..., None] * np.einsum("nxi,nxj->nij", jacobian, jacobian),
        bias=bodies.bias + added * np.einsum("nxk,nx->nk", jacobian, held),
        centre=bodies.centre + share * (arm - bodies.centre),
        centre_velocity=bodies.centre_velocity + share * (velocity - bodies.centre_velocity),
        rotational_inertia=bodies.rotational_inertia - reduced * (apart @ apart),
    )
