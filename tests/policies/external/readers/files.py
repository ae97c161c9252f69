"""Files of other projects, as their exporters write them, with settings that differ from joint to joint."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml

LEGS, KINDS = ("FR", "FL", "RR", "RL"), ("hip_joint", "thigh_joint", "calf_joint")
MOTORS = tuple(f"{leg}_{kind}" for leg in LEGS for kind in KINDS)
"""In the order of Unitree's SDK."""
ISAAC = tuple(f"{leg}_{kind}" for kind in KINDS for leg in sorted(LEGS))
"""In Isaac Lab's order."""
OF = {name: 1.0 + number / 8 for number, name in enumerate(MOTORS)}
"""A number for each joint."""
TERMS = ("base_ang_vel", "projected_gravity", "velocity_commands", "joint_pos_rel", "joint_vel_rel", "last_action")


def permuted(seed: int) -> list[int]:
    return [int(each) for each in np.random.default_rng(seed).permutation(12)]


def of(names: tuple[str, ...], factor: float = 1.0) -> list[float]:
    """The number of each joint, times a factor."""
    return [factor * OF[name] for name in names]


def network(folder: Path, name: str = "exported/policy.onnx") -> Path:
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).touch()
    return folder / name


def written(file: Path, settings: Any) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    dump = json.dumps if file.suffix == ".json" else lambda each: yaml.safe_dump(each, sort_keys=False)
    file.write_text(dump(settings), encoding="utf-8")
    return file


def deploy(ids: list[int]) -> dict[str, Any]:
    """Unitree's `deploy.yaml` for a policy with motor ids[i] as joint i."""
    joints = tuple(MOTORS[motor] for motor in ids)
    action = {"clip": None, "joint_names": [".*"], "scale": of(joints, 0.25), "offset": of(joints), "joint_ids": None}
    return {
        "joint_ids_map": ids,
        "step_dt": 0.02,
        "stiffness": of(MOTORS, 20.0),
        "damping": of(MOTORS, 0.5),
        "default_joint_pos": of(joints),
        "commands": {"base_velocity": {"ranges": {"lin_vel_x": [-1.0, 1.0], "heading": None}}},
        "actions": {"JointPositionAction": action},
        "observations": {name: {"params": {}, "clip": None, "scale": None, "history_length": 1} for name in TERMS},
    }


def env() -> dict[str, Any]:
    """Isaac Lab's, for a Go2."""
    functions = {name: f"isaaclab.envs.mdp.observations:{name}" for name in TERMS}
    functions["velocity_commands"] = "isaaclab.envs.mdp.observations:generated_commands"
    term = {"modifiers": None, "noise": None, "clip": None, "scale": None, "history_length": 0}
    policy = {name: {"func": function, "params": {}, **term} for name, function in functions.items()}
    policy["velocity_commands"]["params"] = {"command_name": "base_velocity"}
    actuator = {"class_type": "isaaclab.actuators.actuator_pd:DCMotor", "joint_names_expr": [".*_hip_joint"]}
    return {
        "sim": {"dt": 0.005},
        "decimation": 4,
        "scene": {
            "robot": {
                "spawn": {"usd_path": "http://somewhere/Robots/Unitree/Go2/go2.usd"},
                "init_state": {"joint_pos": {".*L_hip_joint": 0.1, "F[L,R]_thigh_joint": 0.8, ".*_calf_joint": -1.5}},
                "actuators": {
                    "hips": {**actuator, "stiffness": 20.0, "damping": 0.5},
                    "others": {
                        **actuator,
                        "joint_names_expr": [".*_thigh_joint", ".*_calf_joint"],
                        "stiffness": {".*_thigh_joint": 30.0, ".*_calf_joint": 40.0},
                        "damping": 1.0,
                    },
                },
            },
        },
        "observations": {"policy": {"concatenate_terms": True, "history_length": None, **policy}},
        "actions": {
            "joint_pos": {
                "class_type": "isaaclab.envs.mdp.actions.joint_actions:JointPositionAction",
                "clip": None,
                "joint_names": [".*"],
                "scale": {".*_hip_joint": 0.125, "^(?!.*_hip_joint).*": 0.25},
                "offset": 0.0,
                "preserve_order": False,
                "use_default_offset": True,
            }
        },
        "commands": {"base_velocity": {"class_type": "isaaclab.envs.mdp.commands:UniformVelocityCommand"}},
    }


def rl_sar(mapping: list[int]) -> tuple[dict[str, Any], dict[str, Any]]:
    """rl_sar's config and base."""
    joints = tuple(MOTORS[motor] for motor in mapping)
    config = {
        "model_name": "policy.pt",
        "num_observations": 45,
        "observations": ["commands", "ang_vel", "gravity_vec", "dof_pos", "dof_vel", "actions"],
        "observations_history": [0, 1, 2],
        "observations_history_priority": "time",
        "clip_obs": 100.0,
        "clip_actions_lower": [-50] * 12,
        "clip_actions_upper": [50] * 12,
        "rl_kp": of(joints, 20.0),
        "rl_kd": of(joints, 0.5),
        "num_of_dofs": 12,
        "action_scale": of(joints, 0.25),
        "ang_vel_scale": 0.25,
        "dof_pos_scale": 1.0,
        "dof_vel_scale": 0.05,
        "commands_scale": [2.0, 2.0, 0.25],
        "default_dof_pos": of(joints),
        "joint_mapping": mapping,
    }
    base = {"dt": 0.005, "decimation": 4, "num_of_dofs": 12, "joint_names": list(MOTORS), "rl_kp": [1.0] * 12}
    return {"go2/robot_lab": config}, {"go2": base}


def legged_gym() -> dict[str, Any]:
    return {
        "env": {"num_observations": 48},
        "terrain": {"measure_heights": False, "measured_points_x": [-0.1, 0.0, 0.1], "measured_points_y": [0.0, 0.2]},
        "init_state": {"default_joint_angles": {name: OF[name] for name in reversed(MOTORS)}},
        "control": {
            "control_type": "P",
            "stiffness": {"hip": 20.0, "thigh": 30.0, "calf": 40.0},
            "damping": {"joint": 0.5},
            "action_scale": 0.25,
            "decimation": 4,
        },
        "normalization": {
            "obs_scales": {
                "lin_vel": 2.0,
                "ang_vel": 0.25,
                "dof_pos": 1.0,
                "dof_vel": 0.05,
                "height_measurements": 5.0,
            },
            "clip_observations": 100.0,
            "clip_actions": 50.0,
        },
        "sim": {"dt": 0.005},
    }


def mjlab(names: tuple[str, ...]) -> dict[str, str]:
    """Metadata of mjlab's exporter."""

    def listed(values: list[Any]) -> str:
        return ",".join(f"{each:.3f}" if isinstance(each, int | float) else str(each) for each in values)

    return {
        "run_path": "someone/mjlab/run",
        "joint_names": listed([*names]),
        "joint_stiffness": listed(of(names, 20.0)),
        "joint_damping": listed(of(names)),
        "default_joint_pos": listed(of(names)),
        "command_names": "twist",
        "observation_names": "base_lin_vel,base_ang_vel,projected_gravity,joint_pos,joint_vel,actions,command",
        "action_scale": listed(of(names, 2.0)),
    }


def onnx_file(file: Path, metadata: dict[str, str], outside: bool = False) -> Path:
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
