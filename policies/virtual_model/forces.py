"""Forces of the stance feet by virtual model control: the trunk as if it hung on springs and dampers.

Pratt et al., "Virtual model control: an intuitive approach for bipedal locomotion", IJRR 2001. The wanted acceleration
of the trunk is shared by the feet that stand as the smallest weighted forces; with two of them one of its six parts is
out of reach, and the weights say which.
"""

import numpy as np

from policies.gait_cycle import Floats
from policies.mpc.footing import TerrainPlane
from policies.mpc.motion import MotionState
from policies.mpc.plans import min_norm_forces
from policies.mpc.rigid_body import Friction
from policies.virtual_model.parameters import VirtualParameters
from quad_env.columns import Mask
from quad_env.config import GRAVITY
from quad_env.physics.rotations import skew

LARGEST = np.array([5.0, 5.0, 9.0, 60.0, 60.0, 60.0])
"""Largest acceleration that springs and dampers ask for, m/s² and rad/s²..."""
LEAST = np.array([-5.0, -5.0, -4.0, -60.0, -60.0, -60.0])
"""... and the least: a trunk that falls freely has no feet to stand on."""
_DAMPING = 1e-5
"""Added to the squared accelerations per force."""


def virtual_acceleration(p: VirtualParameters, now: MotionState, ground: TerrainPlane, height: float) -> Floats:
    """Accelerations by the virtual springs and dampers, level frame, (n, 6), m/s² and rad/s².

    `height`: that the trunks are to have above the ground, to which they keep parallel, m.
    """
    forward, lateral, yaw_rate = now.command.T
    climb = ground.forward * forward + ground.lateral * lateral
    velocity = np.column_stack((now.bodies.com_velocity[:, :2], now.velocity[:, 2]))
    damping = np.array([p.forward_damping, p.lateral_damping, p.height_damping])
    linear = damping * (np.column_stack((forward, lateral, climb)) - velocity)
    linear[:, 2] += p.height_stiffness * (height + ground.height)
    level = np.stack((np.arctan(ground.lateral), -np.arctan(ground.forward)), axis=-1)
    tilt = p.tilt_stiffness * (level - now.tilt) - p.tilt_damping * now.angular_velocity[:, :2]
    yaw = p.yaw_damping * (yaw_rate - now.angular_velocity[:, 2])
    return np.column_stack((linear, tilt, yaw)).clip(LEAST, LARGEST)


def distribute_wrench(
    p: VirtualParameters, now: MotionState, wanted: Floats, stance: Mask, friction: Friction
) -> Floats:
    """Forces of the stance feet, level frame, (n, 4, 3), N, that together give the wanted acceleration, (n, 6), m/s²
    and rad/s², as near as may be; then drawn into the friction's cone."""
    bodies = now.bodies
    arms = skew(bodies.feet - bodies.com_position[:, None])
    linear = np.broadcast_to(np.eye(3), arms.shape) / bodies.mass[:, None, None, None]
    angular = np.linalg.solve(bodies.rotational_inertia[:, None], arms)
    planar, tilt, yaw = p.planar_priority, p.tilt_priority, p.yaw_priority
    weights = np.array([planar, planar, 1.0, tilt, tilt, yaw])
    effects = np.concatenate((linear, angular), axis=2) * weights[:, None]
    borne = weights * (wanted + np.array([0.0, 0.0, GRAVITY, 0.0, 0.0, 0.0]))
    forces = min_norm_forces(effects, borne, stance, _DAMPING)
    up = np.clip(forces[..., 2], 0.0, friction.max_normal_force[:, None])
    across = np.hypot(forces[..., 0], forces[..., 1])
    drawn = np.minimum(1.0, friction.coefficient[:, None] * up / np.maximum(across, 1e-9))
    return np.concatenate((forces[..., :2] * drawn[..., None], up[..., None]), axis=-1)
