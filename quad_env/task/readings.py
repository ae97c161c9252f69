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
    """Name -> value of all n robots, of the current step; contacts and `joint_torque`, without what damping that is
    integrated implicitly adds, are those of its last substep. What is over the control step is of all of its physics
    steps, with torques as the joints received them: see `quad_env.physics.energy`.

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
    positive_work      (n, 12)     of the motors over the control step, J
    regeneration       (n, 12)     work that the motors took up over the control step, J
    joule_heat         (n, 12)     of the windings over the control step, J; NaN of motors without a curve
    mean_torque        (n, 12)     mean of the torque's size over the control step, N·m
    peak_torque        (n, 12)     largest of the control step, N·m
    peak_speed         (n, 12)     largest of the control step, rad/s
    torque_change      (n, 12)     size of the change of the mean torque since the control step before, N·m
    foot_impulse       (n, 4)      of the forces that pressed each foot over the control step, N·s
    =================  ==========  =====================================================================

    Motors with a thermal model add `winding_temperature`, (n, 12), °C.
    """
    robot, state = simulation.robot, simulation.state(_NO_COMMAND) if state is None else state
    position, joints = np.transpose(state.position), np.transpose(state.joint_position)
    rotation = np.moveaxis(np.array(state.rotation), -1, 0)
    feet, depth = feet_in_world(robot, position, rotation, joints), foot_depths(robot, rotation, joints)
    feet_contact, leg_contact = simulation.ground_contacts()
    temperature, metered = simulation.winding_temperature, {} if simulation.meter is None else simulation.meter.readings
    return {
        **{name: np.transpose(getattr(state, name)).copy() for name in _VECTORS},
        **{name: reading.copy() for name, reading in metered.items()},
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
