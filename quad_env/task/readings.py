"""Readings for measurement: what happened to every robot in the last control step, beyond what policies observe."""

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array
from quad_env.physics.simulation import Simulation
from quad_env.physics.state import QuadState
from quad_env.robots.kinematics import feet_in_world, foot_depths

Readings = dict[str, NDArray[np.generic]]
_NO_COMMAND = (np.zeros(1),) * 3
"""Command of the state that is looked at here, which has none."""
_VECTORS = ("position", "angular_velocity", "joint_position", "joint_velocity", "joint_torque", "action")


def readings(simulation: Simulation, state: QuadState[Array] | None = None) -> Readings:
    """Name -> value of all n robots, of the current step; contacts and torques are those of its last substep.

    `state` is that of all robots, where it has been looked at already.

    =================  ==========  =====================================================================
    position           (n, 3)      trunk centre, world, m
    quaternion         (n, 4)      trunk orientation in the world, w x y z
    angular_velocity   (n, 3)      of the trunk, base frame, rad/s
    height             (n,)        trunk centre above the terrain below it, m
    vertical_velocity  (n,)        of the trunk, world, m/s
    tilt               (n,)        between the trunk's z axis and the vertical, rad
    joint_position     (n, 12)     rad
    joint_velocity     (n, 12)     rad/s
    joint_torque       (n, 12)     N·m
    action             (n, 12)     joint targets as clipped, rad
    foot_position      (n, 4, 3)   centres of the foot spheres, world, m
    foot_height        (n, 4)      of each foot's lowest point above the terrain below it, m
    foot_contact       (n, 4)      bool, the foot on the ground
    leg_contact        (n,)        bool, a thigh or calf on the ground
    trunk_contact      (n,)        bool
    push               (n, 2)      force on the trunk, world, N
    =================  ==========  =====================================================================

    Motors with a thermal model add `winding_temperature`, (n, 12), °C.
    """
    robot, state = simulation.robot, simulation.state(_NO_COMMAND) if state is None else state
    position, joints = np.transpose(state.position), np.transpose(state.joint_position)
    rotation = np.moveaxis(np.array(state.rotation), -1, 0)
    feet, depth = feet_in_world(robot, position, rotation, joints), foot_depths(robot, rotation, joints)
    feet_contact, leg_contact = simulation.ground_contacts()
    temperature = simulation.winding_temperature
    return {
        **{name: np.transpose(getattr(state, name)).copy() for name in _VECTORS},
        "quaternion": simulation.quaternion,
        "height": state.height,
        "vertical_velocity": state.vertical_velocity,
        "tilt": np.arccos(np.clip(rotation[:, 2, 2], -1.0, 1.0)),
        "foot_position": feet,
        "foot_height": feet[..., 2] - simulation.terrain.height(feet[..., 0], feet[..., 1]) - depth,
        "foot_contact": feet_contact,
        "leg_contact": leg_contact,
        "trunk_contact": np.asarray(state.trunk_contact),
        "push": simulation.push,
        **({} if temperature is None else {"winding_temperature": temperature}),
    }
