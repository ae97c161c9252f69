"""Forces of the standing feet by virtual model control: the trunk as if it hung on springs and dampers.

Pratt et al., "Virtual model control: an intuitive approach for bipedal locomotion", IJRR 2001. The wanted acceleration
of the trunk is shared by the feet that stand as the smallest weighted forces; with two of them one of its six parts is
out of reach, and the weights say which.
"""

from typing import NamedTuple

import numpy as np

from policies.gait_cycle import Floats, LegCycle
from policies.mpc.motion import Motion
from policies.mpc.rigid_body import Friction
from policies.virtual_model.parameters import VirtualParameters
from quad_env.config import GRAVITY
from quad_env.physics.rotations import skew

LARGEST = np.array([5.0, 5.0, 9.0, 60.0, 60.0, 60.0])
"""Largest acceleration that springs and dampers ask for, m/s² and rad/s²..."""
LEAST = np.array([-5.0, -5.0, -4.0, -60.0, -60.0, -60.0])
"""... and the least: a trunk that falls freely has no feet to stand on."""
_SINGULAR = 1e-5
"""Added to the squared accelerations per force."""


class Aim(NamedTuple):
    """How n trunks are to be and to move now, level frame."""

    velocity: Floats
    """Forward, lateral and vertical, (n, 3), m/s."""
    yaw_rate: Floats
    """(n,), rad/s."""
    height: Floats
    """Above the ground, (n,), m."""
    tilt: Floats
    """Roll and pitch, (n, 2), rad."""


def pulled(p: VirtualParameters, now: Motion, aim: Aim, height: Floats) -> Floats:
    """Accelerations by the virtual springs and dampers, level frame, (n, 6), m/s² and rad/s².

    `height`: of the trunks above the ground, (n,), m.
    """
    velocity = aim.velocity - np.column_stack((now.bodies.centre_velocity[:, :2], now.velocity[:, 2]))
    linear = velocity * (p.forward_damping, p.lateral_damping, p.height_damping)
    linear[:, 2] += p.height_stiffness * (aim.height - height)
    tilt = p.tilt_stiffness * (aim.tilt - now.tilt) - p.tilt_damping * now.turning[:, :2]
    yaw = p.yaw_damping * (aim.yaw_rate - now.turning[:, 2])
    return np.clip(np.column_stack((linear, tilt, yaw)), LEAST, LARGEST)


def load(p: VirtualParameters, cycle: LegCycle, stance_time: Floats, period: float) -> Floats:
    """Share of its load that each foot bears, (n, 4): none in swing, and little just after landing and before lift-off.

    `stance_time`: (n,), s.
    """
    stance = stance_time[:, None]
    ramp = max(p.load_time, 1e-9)
    since, rest = cycle.progress * stance + period, (1.0 - cycle.progress) * stance
    return np.where(cycle.swing, 0.0, np.clip(since / ramp, 0.0, 1.0) * np.clip(rest / ramp, 0.05, 1.0))


def shared(p: VirtualParameters, now: Motion, wanted: Floats, load: Floats, friction: Friction) -> Floats:
    """Forces of the feet, level frame, (n, 4, 3), N, that together give the wanted acceleration, (n, 6), m/s² and
    rad/s², as near as may be, each by its share of load, (n, 4); then drawn into the friction's cone."""
    bodies, count = now.bodies, len(load)
    arms = skew(bodies.feet - bodies.centre[:, None])
    linear = np.broadcast_to(np.eye(3), arms.shape) / bodies.mass[:, None, None, None]
    angular = np.linalg.solve(bodies.rotational_inertia[:, None], arms)
    flat, upright, turn = p.planar_priority, p.tilt_priority, p.yaw_priority
    weights = np.array([flat, flat, 1.0, upright, upright, turn])
    per_force = np.concatenate((linear, angular), axis=2) * load[..., None, None] * weights[:, None]
    per_force = np.ascontiguousarray(per_force.transpose(0, 2, 1, 3)).reshape(count, 6, 12)
    square = np.matmul(per_force, per_force.transpose(0, 2, 1)) + _SINGULAR * np.eye(6)
    wanted = wanted + np.array([0.0, 0.0, GRAVITY, 0.0, 0.0, 0.0])
    share = np.linalg.solve(square, (weights * wanted)[..., None])
    forces = np.matmul(per_force.transpose(0, 2, 1), share).reshape(count, 4, 3) * load[..., None]
    up = np.clip(forces[..., 2], 0.0, friction.most[:, None])
    across = np.hypot(forces[..., 0], forces[..., 1])
    drawn = np.minimum(1.0, friction.share[:, None] * up / np.maximum(across, 1e-9))
    return np.concatenate((forces[..., :2] * drawn[..., None], up[..., None]), axis=-1)
