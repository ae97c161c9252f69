"""Measurements for the evaluator, not for policies: motion, contacts and motors in a control step."""

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array
from quad_env.physics.simulation import Simulation
from quad_env.physics.state import QuadState
from quad_env.robots.kinematics import feet_in_world, foot_depths

Readings = dict[str, NDArray[np.generic]]
_NO_COMMAND = (np.zeros(1), np.zeros(1), np.zeros(1))
"""Zero velocity command, with which `compute_readings` computes a state; measurements do not depend on it."""
_VECTORS = ("position", "angular_velocity", "joint_position", "joint_velocity", "joint_torque", "action")
"""Names of the measurements that are copied from the vector fields of `QuadState` with the same names."""


def compute_readings(simulation: Simulation, state: QuadState[Array] | None = None) -> Readings:
    """Return the measurements of all n robots in the last control step, for the evaluator.

    Contacts and `joint_torque` are values of the last physics step. `joint_torque` does not include the damping torque
    that MuJoCo integrates implicitly. Measurements "over the control step" include all its physics steps, with the
    torques that the joints received, see `quad_env.physics.energy`.

    =================  ==========  =====================================================================
    position           (n, 3)      trunk centre, world frame, m
    quaternion         (n, 4)      trunk orientation, from base to world frame, w x y z
    angular_velocity   (n, 3)      trunk angular velocity, base frame, rad/s
    height             (n,)        height of the trunk centre above the terrain below it, m
    vertical_velocity  (n,)        vertical velocity of the trunk, world frame, m/s
    tilt               (n,)        angle between the trunk's z axis and the vertical, rad
    joint_position     (n, 12)     joint angles, rad
    joint_velocity     (n, 12)     joint velocities, rad/s
    joint_torque       (n, 12)     servo torques, N·m
    action             (n, 12)     joint targets after clipping, rad
    foot_position      (n, 4, 3)   centres of the foot spheres, world frame, m
    foot_height        (n, 4)      height of the lowest point of each foot above the terrain below it, m
    foot_contact       (n, 4)      bool, True if the foot is on the ground
    leg_contact        (n,)        bool, True if a thigh or calf is on the ground
    trunk_contact      (n,)        bool, True if the trunk is on the ground
    push               (n, 2)      pushing force on the trunk, world frame, N
    positive_work      (n, 12)     work that the motors delivered over the control step, J
    regeneration       (n, 12)     work that the motors absorbed over the control step, J
    joule_heat         (n, 12)     heat of the windings over the control step, J; NaN for motors without a curve
    mean_torque        (n, 12)     mean torque magnitude over the control step, N·m
    peak_torque        (n, 12)     maximum torque magnitude over the control step, N·m
    peak_speed         (n, 12)     maximum joint speed magnitude over the control step, rad/s
    torque_change      (n, 12)     magnitude of the change of the mean torque since the last control step, N·m
    foot_impulse       (n, 4)      impulse of the ground force on each foot over the control step, N·s
    =================  ==========  =====================================================================

    Motors with a thermal model add `winding_temperature`, (n, 12), °C.

    Args:
        simulation: Simulation of the robots. If it has no motor meter, the measurements "over the control step" are
            absent.
        state: Present state of all robots; None to compute the state from the simulation.

    Returns:
        Name of each measurement -> values, (n, ...), as in the table.
    """
    state = simulation.state(_NO_COMMAND) if state is None else state
    readings: Readings = {name: np.transpose(getattr(state, name)).copy() for name in _VECTORS}
    if simulation.meter is not None:
        readings |= {name: values.copy() for name, values in simulation.meter.readings.items()}
    readings |= {
        "quaternion": simulation.quaternion,
        "height": state.height,
        "vertical_velocity": state.vertical_velocity,
        "tilt": np.arccos(np.clip(state.rotation[2][2], -1.0, 1.0)),
    }
    readings |= _foot_readings(simulation, state)
    readings |= {"trunk_contact": np.asarray(state.trunk_contact), "push": simulation.push}
    temperature = simulation.winding_temperature
    if temperature is not None:
        readings["winding_temperature"] = temperature
    return readings


def _foot_readings(simulation: Simulation, state: QuadState[Array]) -> Readings:
    """Return the measurements of foot positions, foot heights and ground contacts: name -> values, (n, ...)."""
    robot = simulation.robot
    position = np.transpose(state.position)
    joints = np.transpose(state.joint_position)
    rotation = np.moveaxis(np.array(state.rotation), -1, 0)
    feet = feet_in_world(robot, position, rotation, joints)
    depth = foot_depths(robot, rotation, joints)
    foot_contact, leg_contact = simulation.ground_contacts()
    return {
        "foot_position": feet,
        "foot_height": feet[..., 2] - simulation.terrain.height(feet[..., 0], feet[..., 1]) - depth,
        "foot_contact": foot_contact,
        "leg_contact": leg_contact,
    }
