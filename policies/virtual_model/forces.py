"""Contact forces by virtual model control: virtual springs and dampers hold the trunk.

The method is by Pratt et al., "Virtual model control: an intuitive approach for bipedal locomotion", IJRR 2001. The
springs and dampers define a wanted acceleration of the trunk with six components, linear and angular. The stance feet
produce this acceleration with contact forces of minimum norm. Two stance feet can produce only five of the six
components. Weights determine the distribution of the remaining error over the components.
"""

import numpy as np

from policies.contact.motion_state import MotionState
from policies.gait_cycle import Floats
from policies.mpc.footing import TerrainPlane
from policies.mpc.plans import min_norm_forces
from policies.mpc.rigid_body import Friction
from policies.virtual_model.parameters import VirtualParameters
from quad_env.columns import Mask
from quad_env.config import GRAVITY
from quad_env.physics.rotations import skew

MAX_ACCELERATION = np.array([5.0, 5.0, 9.0, 60.0, 60.0, 60.0])
"""Upper limits of the trunk acceleration that the virtual springs and dampers define.

The items are the linear acceleration (x, y, z), m/s², and the angular acceleration (x, y, z), rad/s². They are in the
level frame (x along the heading, z up)."""
MIN_ACCELERATION = np.array([-5.0, -5.0, -4.0, -60.0, -60.0, -60.0])
"""Lower limits of the trunk acceleration that the virtual springs and dampers define.

The items are the linear acceleration (x, y, z), m/s², and the angular acceleration (x, y, z), rad/s². They are in the
level frame (x along the heading, z up). The vertical limit is above -9.81 m/s², because the feet carry no load if the
trunk falls freely."""
_DAMPING = 1e-5
"""Damping λ of the least-squares solution for the contact forces of minimum norm.

The damping is added to the diagonal of E Eᵀ. The matrix E maps the contact forces to the weighted trunk
accelerations."""


def virtual_acceleration(p: VirtualParameters, state: MotionState, ground: TerrainPlane, height: float) -> Floats:
    """Compute the trunk acceleration that the virtual springs and dampers define for the present motion.

    Args:
        p: Stiffness and damping of the virtual springs and dampers.
        state: Motion state of n robots.
        ground: Ground plane of each robot. The springs keep the trunk parallel to this plane.
        height: Reference height of the trunk centres above the ground, m.

    Returns:
        Linear and angular acceleration between MIN_ACCELERATION and MAX_ACCELERATION, level frame (x along the heading,
        z up), (n, 6), m/s² and rad/s².
    """
    forward, lateral, yaw_rate = state.command.T
    climb = ground.forward * forward + ground.lateral * lateral
    velocity = np.column_stack((state.bodies.com_velocity[:, :2], state.velocity[:, 2]))
    damping = np.array([p.forward_damping, p.lateral_damping, p.height_damping])
    linear = damping * (np.column_stack((forward, lateral, climb)) - velocity)
    linear[:, 2] += p.height_stiffness * (height + ground.height)
    ground_tilt = np.stack((np.arctan(ground.lateral), -np.arctan(ground.forward)), axis=-1)
    tilt = p.tilt_stiffness * (ground_tilt - state.tilt) - p.tilt_damping * state.angular_velocity[:, :2]
    yaw = p.yaw_damping * (yaw_rate - state.angular_velocity[:, 2])
    return np.column_stack((linear, tilt, yaw)).clip(MIN_ACCELERATION, MAX_ACCELERATION)


def distribute_acceleration(
    p: VirtualParameters, state: MotionState, acceleration: Floats, stance: Mask, friction: Friction
) -> Floats:
    """Compute contact forces of the stance feet that produce a wanted acceleration of the trunk.

    Args:
        p: Parameters with the weights of the components of the acceleration. Weights are needed because two stance feet
            cannot produce all six components.
        state: Motion state of n robots.
        acceleration: Wanted linear and angular acceleration of the trunk, level frame (x along the heading, z up), m/s²
            and rad/s², (n, 6).
        stance: True for stance feet, (n, 4).
        friction: Friction coefficient and largest normal force of each robot.

    Returns:
        Contact forces of minimum norm, level frame (x along the heading, z up), (n, 4, 3), N. Horizontal forces are
        scaled down so that they lie in the friction cone.
    """
    bodies = state.bodies
    moment_arms = skew(bodies.feet - bodies.com_position[:, None])
    linear = np.broadcast_to(np.eye(3), moment_arms.shape) / bodies.mass[:, None, None, None]
    angular = np.linalg.solve(bodies.rotational_inertia[:, None], moment_arms)
    priorities = (p.planar_priority, p.planar_priority, 1.0, p.tilt_priority, p.tilt_priority, p.yaw_priority)
    weights = np.array(priorities)
    effects = np.concatenate((linear, angular), axis=2) * weights[:, None]
    wanted = weights * (acceleration + np.array([0.0, 0.0, GRAVITY, 0.0, 0.0, 0.0]))
    forces = min_norm_forces(effects, wanted, stance, _DAMPING)
    normal = np.clip(forces[..., 2], 0.0, friction.max_normal_force[:, None])
    tangential = np.hypot(forces[..., 0], forces[..., 1])
    scale = np.minimum(1.0, friction.coefficient[:, None] * normal / np.maximum(tangential, 1e-9))
    return np.concatenate((forces[..., :2] * scale[..., None], normal[..., None]), axis=-1)
