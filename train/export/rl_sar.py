"""Writer of rl_sar's deployment files: `base.yaml` of the robot, `config.yaml` of the policy, and the network.

rl_sar scales an observation term, then clips the whole observation. Gravity and the previous action have no scale, and
all joints have the same one. The history starts with zeros, so that a policy with a history, which starts with its
first observation, cannot be described. Its linear velocity is always 0, and it has no clock.
"""

from pathlib import Path
from typing import Any

import numpy as np

from policies.external.joint_mapping import map_joints
from policies.external.readers.joint_orders import UNITREE_MOTORS
from train.export.export_format import ExportFormat, check_terms, decimation_of, raise_unsupported, to_list, write_yaml
from train.export.network_files import write_onnx, write_torchscript
from train.export.plain_network import PlainNetwork, with_folded_scales
from train.export.unitree import motors_of_joints

TERMS = {
    "angular_velocity": "ang_vel",
    "projected_gravity": "gravity_vec",
    "command": "commands",
    "joint_position": "dof_pos",
    "joint_velocity": "dof_vel",
    "previous_action": "actions",
}
"""Name of an observation term -> name in rl_sar."""
REASONS = {
    "linear_velocity": "rl_sar's programs never set lin_vel, so that it is always 0",
    "gait_clock": "rl_sar has no clock; RoboMimic_Deploy/phase is time / motion_length, which no settings file sets",
}
"""Name of an observation term -> reason why rl_sar lacks it."""
SCALES = {
    "angular_velocity": "ang_vel_scale",
    "joint_position": "dof_pos_scale",
    "joint_velocity": "dof_vel_scale",
}
"""Name of an observation term -> key of its scale, one number for all its values."""
NO_CLIP = 1e5
"""Limit of observations and actions; larger than any value of a walking robot."""
POLICY = "simple_quad"
"""Name of the folder with the policy, in the folder with the robot's `base.yaml`."""


def write(network: PlainNetwork, folder: Path) -> PlainNetwork:
    """Write a network for rl_sar, and return it.

    PolicyError is raised for a term that rl_sar lacks, and for a policy with a history.

    Args:
        network: Plain network.
        folder: Folder of the export.

    Returns:
        The network as written, with the scales in it that rl_sar lacks.
    """
    check_terms(network, TERMS, FORMAT.name, REASONS)
    history = max(term.history for term in network.spec.terms)
    if history > 1:
        raise_unsupported(FORMAT.name, "history that starts with the first observation", f"{history} steps", "1 step")
    uneven = [term.name for term in network.spec.terms if len(term.scale) > 1 and term.name in SCALES]
    written = with_folded_scales(network, "projected_gravity", "previous_action", *uneven)
    write_onnx(written, folder / FORMAT.onnx)
    write_torchscript(written, folder / POLICY / "policy.pt")
    name = network.robot.name
    write_yaml({name: _base(written)}, folder / "base.yaml")
    write_yaml({f"{name}/{POLICY}": _config(written)}, folder / FORMAT.settings)
    return written


def _base(network: PlainNetwork) -> dict[str, Any]:
    """Return the content of `base.yaml`: the robot, with its joints in the order of Unitree's motors."""
    spec = network.spec
    decimation = decimation_of(network)
    motors = map_joints(UNITREE_MOTORS, network.robot).joint_ids
    names = [spec.joints[joint] for joint in motors]
    return {
        "dt": 1.0 / spec.control_rate / decimation,
        "decimation": decimation,
        "num_of_dofs": len(names),
        "wheel_indices": [],
        "fixed_kp": to_list(np.array(spec.stiffness)[motors]),
        "fixed_kd": to_list(np.array(spec.damping)[motors]),
        "torque_limits": to_list(np.broadcast_to(network.robot.rated_torque, len(names))),
        "default_dof_pos": to_list(np.array(spec.default_position)[motors]),
        "joint_names": names,
        "joint_controller_names": [name.replace("_joint", "_controller") for name in names],
        "joint_mapping": list(range(len(names))),
    }


def _config(network: PlainNetwork) -> dict[str, Any]:
    """Return the content of `config.yaml`: the policy, with its joints in its own order.

    The fixed gains, with which the robot stands up, equal the gains in `base.yaml`, in the order of the policy.
    """
    spec = network.spec
    scale_of = {term.name: term.scale for term in spec.terms}
    joints = len(spec.joints)
    return {
        "model_name": "policy.pt",
        "num_observations": spec.width,
        "observations": [TERMS[term.name] for term in spec.terms],
        "observations_history": [],
        "observations_history_priority": "time",
        "clip_obs": NO_CLIP,
        "clip_actions_lower": [-NO_CLIP] * joints,
        "clip_actions_upper": [NO_CLIP] * joints,
        "rl_kp": list(spec.stiffness),
        "rl_kd": list(spec.damping),
        "fixed_kp": list(spec.stiffness),
        "fixed_kd": list(spec.damping),
        "num_of_dofs": joints,
        "action_scale": list(spec.action_scale),
        **{key: scale_of.get(name, (1.0,))[0] for name, key in SCALES.items()},
        "commands_scale": np.broadcast_to(scale_of.get("command", (1.0,)), 3).tolist(),
        "default_dof_pos": list(spec.default_position),
        "torque_limits": to_list(np.broadcast_to(network.robot.rated_torque, joints)),
        "joint_mapping": motors_of_joints(network).tolist(),
    }


FORMAT = ExportFormat(
    name="rl-sar",
    summary=f"base.yaml, {POLICY}/config.yaml, {POLICY}/policy.pt (and policy.onnx) for rl_sar",
    settings=f"{POLICY}/config.yaml",
    onnx=f"{POLICY}/policy.onnx",
    usage=(
        '`cp -r . rl_sar/policy/{robot}`, set `rl.config_name = "simple_quad"` in'
        " src/rl_sar/fsm_robot/fsm_{robot}.hpp, build, then `./cmake_build/bin/rl_sim_mujoco {robot} scene`"
    ),
    write=write,
)
"""Format of rl_sar."""
