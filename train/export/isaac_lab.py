"""Writer of Isaac Lab's deployment files: `params/env.yaml`, `exported/policy.onnx` and `exported/policy.pt`.

`env.yaml` has the keys that Isaac Lab's `dump_yaml` writes and that Isaac Sim's `PolicyController` reads. The joints
are listed by name with `preserve_order`, so that their order does not depend on the simulator. Isaac Lab clips an
observation term, then scales it, and keeps its history term by term, oldest step first, filled with the first value.
"""

from pathlib import Path
from typing import Any

import numpy as np

from policies.external.spec import SpecTerm
from quad_env.robots.robot import Robot
from train.export.export_format import ExportFormat, check_terms, command_ranges, decimation_of, write_yaml
from train.export.network_files import write_onnx, write_torchscript
from train.export.plain_network import PlainNetwork, with_clock_gate

_OBSERVATIONS = "isaaclab.envs.mdp.observations"
TERMS = {
    "linear_velocity": f"{_OBSERVATIONS}:base_lin_vel",
    "angular_velocity": f"{_OBSERVATIONS}:base_ang_vel",
    "projected_gravity": f"{_OBSERVATIONS}:projected_gravity",
    "command": f"{_OBSERVATIONS}:generated_commands",
    "joint_position": f"{_OBSERVATIONS}:joint_pos_rel",
    "joint_velocity": f"{_OBSERVATIONS}:joint_vel_rel",
    "previous_action": f"{_OBSERVATIONS}:last_action",
    "gait_clock": "unitree_rl_lab.tasks.locomotion.mdp.observations:gait_phase",
}
"""Name of an observation term -> module and function that compute it in Isaac Lab."""
TORCHSCRIPT = "exported/policy.pt"
"""Path of the network as TorchScript."""
ARTICULATION = {
    "enabled_self_collisions": False,
    "solver_position_iteration_count": 4,
    "solver_velocity_iteration_count": 0,
}
"""Settings of PhysX for the robot, as in Isaac Lab's configurations of quadrupeds; `PolicyController` needs them."""


def write(network: PlainNetwork, folder: Path) -> PlainNetwork:
    """Write a network for Isaac Lab, and return it.

    PolicyError is raised for a term that Isaac Lab lacks.

    Args:
        network: Plain network.
        folder: Folder of the export.

    Returns:
        The network as written.
    """
    written = with_clock_gate(network)
    check_terms(written, TERMS, FORMAT.name)
    write_onnx(written, folder / FORMAT.onnx)
    write_torchscript(written, folder / TORCHSCRIPT)
    write_yaml(_settings(written), folder / FORMAT.settings)
    return written


def _settings(network: PlainNetwork) -> dict[str, Any]:
    """Return the content of `env.yaml`."""
    spec = network.spec
    period = 1.0 / spec.control_rate
    decimation = decimation_of(network)
    action = {
        "class_type": "isaaclab.envs.mdp.actions.joint_actions:JointPositionAction",
        "asset_name": "robot",
        "joint_names": list(spec.joints),
        "scale": dict(zip(spec.joints, spec.action_scale, strict=True)),
        "offset": 0.0,
        "preserve_order": True,
        "use_default_offset": True,
        "clip": None,
    }
    command = {
        "class_type": "isaaclab.envs.mdp.commands.velocity_command:UniformVelocityCommand",
        "asset_name": "robot",
        "heading_command": False,
        "ranges": command_ranges(network.robot) | {"heading": None},
    }
    return {
        "sim": {"dt": period / decimation, "render_interval": decimation, "gravity": [0.0, 0.0, -9.81]},
        "decimation": decimation,
        "scene": {"robot": _robot(network)},
        "observations": {"policy": _observations(network)},
        "actions": {"joint_pos": action},
        "commands": {"base_velocity": command},
    }


def _robot(network: PlainNetwork) -> dict[str, Any]:
    """Return the settings of the robot: default position, servo gains and torque limits."""
    spec = network.spec
    position = dict(zip(spec.joints, spec.default_position, strict=True))
    torque = np.broadcast_to(network.robot.rated_torque, len(spec.joints)).tolist()
    legs = {
        "class_type": "isaaclab.actuators.actuator_pd:IdealPDActuator",
        "joint_names_expr": list(spec.joints),
        "effort_limit": dict(zip(spec.joints, torque, strict=True)),
        "velocity_limit": None,
        "stiffness": dict(zip(spec.joints, spec.stiffness, strict=True)),
        "damping": dict(zip(spec.joints, spec.damping, strict=True)),
        "armature": _armature(network.robot),
    }
    return {
        "spawn": {"usd_path": f"{network.robot.name}.usd", "articulation_props": ARTICULATION},
        "init_state": {
            "pos": [0.0, 0.0, float(network.robot.home_height)],
            "joint_pos": position,
            "joint_vel": {".*": 0.0},
        },
        "actuators": {"legs": legs},
    }


def _armature(robot: Robot) -> dict[str, float]:
    """Return the armature of each joint: name -> kg·m². `PolicyController` sets it to 0 if the file has none."""
    model = robot.model
    return {name: float(model.dof_armature[model.joint(name).dofadr[0]]) for name in robot.joint_names}


def _observations(network: PlainNetwork) -> dict[str, Any]:
    """Return the settings of the observation group `policy`."""
    terms = {TERMS[term.name].rpartition(":")[2]: _term(network, term) for term in network.spec.terms}
    return {"concatenate_terms": True, "enable_corruption": False, "history_length": None, **terms}


def _term(network: PlainNetwork, term: SpecTerm) -> dict[str, Any]:
    """Return the settings of an observation term."""
    params: dict[str, Any] = {}
    match term.name:
        case "command":
            params = {"command_name": "base_velocity"}
        case "gait_clock":
            params = {"period": 1.0 / term.clock}
        case "joint_position" | "joint_velocity":
            joints = {"name": "robot", "joint_names": list(network.spec.joints), "preserve_order": True}
            params = {"asset_cfg": joints}
    return {
        "func": TERMS[term.name],
        "params": params,
        "modifiers": None,
        "noise": None,
        "clip": None,
        "scale": term.scale[0] if len(term.scale) == 1 else list(term.scale),
        "history_length": term.history if term.history > 1 else 0,
        "flatten_history_dim": True,
    }


FORMAT = ExportFormat(
    name="isaac-lab",
    summary="params/env.yaml with exported/policy.onnx and exported/policy.pt, for Isaac Lab and Isaac Sim",
    settings="params/env.yaml",
    onnx="exported/policy.onnx",
    usage="`controller.load_policy('exported/policy.pt', 'params/env.yaml')` of Isaac Sim's PolicyController",
    write=write,
)
"""Format of Isaac Lab."""
