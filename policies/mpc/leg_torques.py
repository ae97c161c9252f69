"""Joint torques without a program: each leg bears its planned force and follows its path, the trunk as planned.

What the whole body's program is for, limits and what one leg's motion does to the others, is left out: friction is the
plan's, torques are clipped. τ = M q̈ + h - Jᵀf, with q̈ of the trunk by the planned forces and of each leg so that its
foot accelerates as it should.
"""

import numpy as np

from policies.mpc.whole_body import Floats, Torques, Wish
from quad_env.config import GRAVITY
from quad_env.physics.dynamics import RigidBodies

_SINGULAR = 1e-4
"""Added to the squared Jacobian of a leg, m²: a straight one does not accelerate along itself."""


def leg_torques(bodies: RigidBodies, wish: Wish, wrench: Floats, limit: float) -> Torques:
    """Torques of robots whose trunks a wrench pushes, (n, 6), N and N·m; `limit`: N·m."""
    forces = np.where(wish.standing[..., None], wish.forces, 0.0)
    linear = (forces.sum(axis=1) + wrench[:, :3]) / bodies.mass[:, None] - (0.0, 0.0, GRAVITY)
    trunk = np.concatenate((linear, wish.turning), axis=1)
    carried = np.einsum("nlxk,nk->nlx", bodies.jacobians[..., :6], trunk)
    legs = bodies.leg_jacobians
    across = legs.swapaxes(2, 3)
    squares = np.matmul(across, legs) + _SINGULAR * np.eye(3)
    asked = np.matmul(across, (wish.feet - bodies.drift - carried)[..., None])
    joints = np.linalg.solve(squares, asked)[..., 0].reshape(len(trunk), 12)
    motion = np.concatenate((trunk, joints), axis=1)
    needed = np.einsum("nij,nj->ni", bodies.inertia[:, 6:], motion) + bodies.bias[:, 6:]
    borne = np.matmul(across, forces[..., None])[..., 0].reshape(joints.shape)
    torque = np.clip(needed - borne, -limit, limit)
    return Torques(torque, joints, np.isfinite(torque).all(axis=1))
