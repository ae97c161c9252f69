"""Writer of Unitree's deployment files: `params/deploy.yaml` and `exported/policy.onnx`.

The C++ controllers of unitree_rl_lab and unitree_rl_mjlab read them. The servo gains are in the order of Unitree's
motors, all other values per joint in the order of the policy. The controllers clip an observation term, then scale it,
and keep its history term by term, oldest step first, filled with the first value.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.external.joint_mapping import map_joints
from policies.external.readers.joint_orders import UNITREE_MOTORS
from policies.external.spec import SpecTerm
from train.export.export_format import ExportFormat, check_terms, command_ranges, to_list, write_yaml
from train.export.network_files import write_onnx
from train.export.plain_network import PlainNetwork, with_clock_gate

TERMS = {
    "angular_velocity": "base_ang_vel",
    "projected_gravity": "projected_gravity",
    "command": "velocity_commands",
    "joint_position": "joint_pos_rel",
    "joint_velocity": "joint_vel_rel",
    "previous_action": "last_action",
    "gait_clock": "gait_phase",
}
"""Name of an observation term -> name of its function in Unitree's controllers."""
REASONS = {"linear_velocity": "Unitree's controllers have no estimate of it"}
"""Name of an observation term -> reason why Unitree's controllers lack it."""


def write(network: PlainNetwork, folder: Path) -> PlainNetwork:
    """Write a network for Unitree's controllers, and return it.

    PolicyError is raised for a term that the controllers lack.

    Args:
        network: Plain network.
        folder: Folder of the export.

    Returns:
        The network as written.
    """
    written = with_clock_gate(network)
    check_terms(written, TERMS, FORMAT.name, REASONS)
    write_onnx(written, folder / FORMAT.onnx)
    write_yaml(_settings(written), folder / FORMAT.settings)
    return written


def motors_of_joints(network: PlainNetwork) -> NDArray[np.intp]:
    """Return the index of Unitree's motor that moves each joint of the policy, (12,)."""
    return np.argsort(map_joints(UNITREE_MOTORS, network.robot).joint_ids)


def _settings(network: PlainNetwork) -> dict[str, Any]:
    """Return the content of `deploy.yaml`."""
    spec = network.spec
    motors = motors_of_joints(network)
    joint_of_motor = np.argsort(motors)
    default = list(spec.default_position)
    action = {
        "clip": None,
        "joint_names": [".*"],
        "scale": list(spec.action_scale),
        "offset": default,
        "joint_ids": None,
    }
    return {
        "joint_ids_map": motors.tolist(),
        "step_dt": 1.0 / spec.control_rate,
        "stiffness": to_list(np.array(spec.stiffness)[joint_of_motor]),
        "damping": to_list(np.array(spec.damping)[joint_of_motor]),
        "default_joint_pos": list(default),
        "commands": {"base_velocity": {"ranges": command_ranges(network.robot) | {"heading": None}}},
        "actions": {"JointPositionAction": action},
        "observations": {TERMS[term.name]: _term(term) for term in spec.terms},
    }


def _term(term: SpecTerm) -> dict[str, Any]:
    """Return the settings of an observation term."""
    params: dict[str, Any] = {"command_name": "base_velocity"} if term.name == "command" else {}
    if term.name == "gait_clock":
        params = {"period": 1.0 / term.clock}
    scale = to_list(np.broadcast_to(term.scale, term.width))
    return {"params": params, "clip": None, "scale": scale, "history_length": term.history}


FORMAT = ExportFormat(
    name="unitree",
    summary="params/deploy.yaml and exported/policy.onnx, for the C++ of unitree_rl_lab and unitree_rl_mjlab",
    settings="params/deploy.yaml",
    onnx="exported/policy.onnx",
    usage=(
        "`cp -r . deploy/robots/{robot}/config/policy/velocity/v0` in unitree_rl_mjlab or unitree_rl_lab, name this"
        " folder as policy_dir of Velocity in config/config.yaml, then `./{robot}_ctrl --network lo`"
    ),
    write=write,
)
"""Format of unitree_rl_lab and unitree_rl_mjlab."""
