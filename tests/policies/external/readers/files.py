"""Settings files of other projects in the format of their exporters, with values that differ between joints.

The files are variants of the samples of the fuzzing study, `research.fuzzing.samples`.
"""

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from research.fuzzing import samples

LEGS = ("FR", "FL", "RR", "RL")
KINDS = ("hip_joint", "thigh_joint", "calf_joint")
MOTORS = tuple(samples.JOINTS)
"""Joint names in the order of Unitree's SDK."""
ISAAC = tuple(f"{leg}_{kind}" for kind in KINDS for leg in sorted(LEGS))
"""Joint names in the order of Isaac Lab."""
JOINT_VALUES = {name: 1.0 + number / 8 for number, name in enumerate(MOTORS)}
"""Joint name -> a value that is different for every joint."""
TERMS = ("base_ang_vel", "projected_gravity", "velocity_commands", "joint_pos_rel", "joint_vel_rel", "last_action")
"""Names of the observation terms in Isaac Lab."""


def permutation(seed: int) -> list[int]:
    """Return a random permutation of the numbers from 0 to 11."""
    return [int(each) for each in np.random.default_rng(seed).permutation(12)]


def joint_values(names: tuple[str, ...], factor: float = 1.0) -> list[float]:
    """Return the value of each named joint, times a factor."""
    return [factor * JOINT_VALUES[name] for name in names]


def network(folder: Path, name: str = "exported/policy.onnx") -> Path:
    """Create an empty network file in a folder, and return its path."""
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).touch()
    return folder / name


def write_settings(file: Path, settings: Any) -> Path:
    """Write settings into a JSON or YAML file, and return its path."""
    file.parent.mkdir(parents=True, exist_ok=True)
    dump = json.dumps if file.suffix == ".json" else lambda each: yaml.safe_dump(each, sort_keys=False)
    file.write_text(dump(settings), encoding="utf-8")
    return file


def deploy(ids: list[int]) -> dict[str, Any]:
    """Return Unitree's `deploy.yaml` of a policy with the motor ids[i] as joint i."""
    joints = tuple(MOTORS[motor] for motor in ids)
    action = {
        "clip": None,
        "joint_names": [".*"],
        "scale": joint_values(joints, 0.25),
        "offset": joint_values(joints),
        "joint_ids": None,
    }
    return {
        "joint_ids_map": ids,
        "step_dt": 0.02,
        "stiffness": joint_values(MOTORS, 20.0),
        "damping": joint_values(MOTORS, 0.5),
        "default_joint_pos": joint_values(joints),
        "commands": {"base_velocity": {"ranges": {"lin_vel_x": [-1.0, 1.0], "heading": None}}},
        "actions": {"JointPositionAction": action},
        "observations": {name: {"params": {}, "clip": None, "scale": None, "history_length": 1} for name in TERMS},
    }


def env() -> dict[str, Any]:
    """Return Isaac Lab's `env.yaml` of a Go2, without a height scan and with all keys of a term."""
    settings = copy.deepcopy(samples.ISAAC_LAB)
    scene: dict[str, Any] = settings["scene"]
    del scene["height_scanner"]
    for actuator in scene["robot"]["actuators"].values():
        actuator["class_type"] = "isaaclab.actuators.actuator_pd:DCMotor"
    functions = {name: f"isaaclab.envs.mdp.observations:{name}" for name in TERMS}
    functions["velocity_commands"] = "isaaclab.envs.mdp.observations:generated_commands"
    term = {"modifiers": None, "noise": None, "clip": None, "scale": None, "history_length": 0}
    policy = {name: {"func": function, "params": {}, **term} for name, function in functions.items()}
    policy["velocity_commands"]["params"] = {"command_name": "base_velocity"}
    settings["observations"] = {"policy": {"concatenate_terms": True, "history_length": None, **policy}}
    settings["actions"]["joint_pos"] |= {
        "class_type": "isaaclab.envs.mdp.actions.joint_actions:JointPositionAction",
        "clip": None,
        "preserve_order": False,
    }
    settings["commands"]["base_velocity"]["class_type"] = "isaaclab.envs.mdp.commands:UniformVelocityCommand"
    return settings


def rl_sar(mapping: list[int]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return rl_sar's `config.yaml` and `base.yaml` of a policy with the motor mapping[i] as joint i."""
    joints = tuple(MOTORS[motor] for motor in mapping)
    config, base = copy.deepcopy(samples.RL_SAR)
    changes = {
        "model_name": "policy.pt",
        "num_observations": 45,
        "observations_history_priority": "time",
        "rl_kp": joint_values(joints, 20.0),
        "rl_kd": joint_values(joints, 0.5),
        "action_scale": joint_values(joints, 0.25),
        "default_dof_pos": joint_values(joints),
        "joint_mapping": mapping,
    }
    return {"go2/robot_lab": config["go2/lab"] | changes}, {"go2": base["go2"] | {"rl_kp": [1.0] * 12}}


def legged_gym() -> dict[str, Any]:
    """Return the settings of legged_gym, with the joints in reverse order."""
    settings = copy.deepcopy(samples.LEGGED_GYM)
    settings["init_state"]["default_joint_angles"] = {name: JOINT_VALUES[name] for name in reversed(MOTORS)}
    return settings


def mjlab(names: tuple[str, ...]) -> dict[str, str]:
    """Return the metadata that mjlab's exporter writes, with the joints `names`."""

    def format_list(values: list[Any]) -> str:
        return ",".join(f"{each:.3f}" if isinstance(each, int | float) else str(each) for each in values)

    return {
        "run_path": "someone/mjlab/run",
        "joint_names": format_list([*names]),
        "joint_stiffness": format_list(joint_values(names, 20.0)),
        "joint_damping": format_list(joint_values(names)),
        "default_joint_pos": format_list(joint_values(names)),
        "command_names": samples.MJLAB["command_names"],
        "observation_names": samples.MJLAB["observation_names"],
        "action_scale": format_list(joint_values(names, 2.0)),
    }


def onnx_file(file: Path, metadata: dict[str, str], outside: bool = False) -> Path:
    """Write an ONNX file with metadata and a 12 × 12 layer; `outside` stores the weights in a second file."""
    import onnx

    weights = onnx.numpy_helper.from_array(np.eye(12, dtype=np.float32), "weights")
    if outside:
        onnx.external_data_helper.set_external_data(weights, "weights.data")
        weights.ClearField("raw_data")
    kind = onnx.TensorProto.FLOAT
    values = [onnx.helper.make_tensor_value_info(name, kind, [1, 12]) for name in ("seen", "action")]
    node = onnx.helper.make_node("MatMul", ["seen", "weights"], ["action"])
    model = onnx.helper.make_model(onnx.helper.make_graph([node], "g", values[:1], values[1:], [weights]))
    for key, value in metadata.items():
        model.metadata_props.add(key=key, value=value)
    file.write_bytes(model.SerializeToString())
    return file
