"""Constants with valid contents of settings files; the fuzz test reads copies with random changes."""

_LEGS = ("FR", "FL", "RR", "RL")
_KINDS = ("hip_joint", "thigh_joint", "calf_joint")
JOINTS = [f"{leg}_{kind}" for leg in _LEGS for kind in _KINDS]
"""Joint names in the motor order of Unitree robots: FR, FL, RR, RL, each with hip, thigh and calf."""


def joint_ramp(factor: float) -> list[float]:
    """Return twelve different values, one per joint, from `factor` up in steps of `factor` / 16."""
    return [factor * (1.0 + number / 16) for number in range(12)]


_TERMS = ("base_ang_vel", "projected_gravity", "velocity_commands", "joint_pos_rel", "joint_vel_rel", "last_action")
LEGGED_GYM = {
    "env": {"num_observations": 48},
    "terrain": {"measure_heights": False, "measured_points_x": [-0.1, 0.0, 0.1], "measured_points_y": [0.0, 0.2]},
    "init_state": {"default_joint_angles": dict(zip(JOINTS, joint_ramp(0.5), strict=True))},
    "control": {
        "control_type": "P",
        "stiffness": {"hip": 20.0, "thigh": 30.0, "calf": 40.0},
        "damping": {"joint": 0.5},
        "action_scale": 0.25,
        "decimation": 4,
    },
    "normalization": {
        "obs_scales": {"lin_vel": 2.0, "ang_vel": 0.25, "dof_pos": 1.0, "dof_vel": 0.05, "height_measurements": 5.0},
        "clip_observations": 100.0,
        "clip_actions": 50.0,
    },
    "sim": {"dt": 0.005},
}
"""Valid content of a settings file of the training framework legged_gym."""
ISAAC_LAB = {
    "sim": {"dt": 0.005},
    "decimation": 4,
    "scene": {
        "robot": {
            "spawn": {"usd_path": "http://host/Robots/Unitree/Go2/go2.usd"},
            "init_state": {"joint_pos": {".*L_hip_joint": 0.1, "F[L,R]_thigh_joint": 0.8, ".*_calf_joint": -1.5}},
            "actuators": {
                "hips": {"joint_names_expr": [".*_hip_joint"], "stiffness": 20.0, "damping": 0.5},
                "legs": {
                    "joint_names_expr": [".*_thigh_joint", ".*_calf_joint"],
                    "stiffness": {".*_thigh_joint": 30.0, ".*_calf_joint": 40.0},
                    "damping": 1.0,
                },
            },
        },
        "height_scanner": {
            "ray_alignment": "yaw",
            "pattern_cfg": {"resolution": 0.1, "size": [1.6, 1.0], "ordering": "xy"},
        },
    },
    "observations": {
        "policy": {
            "history_length": None,
            **{
                name: {"func": f"isaaclab.envs.mdp:{name}", "params": {}, "clip": None, "scale": 1.0}
                for name in _TERMS
                if name != "velocity_commands"
            },
            "commands": {
                "func": "isaaclab.envs.mdp:generated_commands",
                "params": {"command_name": "base_velocity"},
                "clip": [-1.0, 1.0],
                "scale": [1.0, 2.0, 3.0],
            },
            "scan": {
                "func": "isaaclab.envs.mdp:height_scan",
                "params": {"sensor_cfg": {"name": "height_scanner"}, "offset": 0.5},
            },
        }
    },
    "actions": {
        "joint_pos": {
            "class_type": "isaaclab.envs.mdp:JointPositionAction",
            "joint_names": [".*"],
            "scale": {".*_hip_joint": 0.125, "^(?!.*_hip_joint).*": 0.25},
            "offset": 0.0,
            "use_default_offset": True,
        }
    },
    "commands": {"base_velocity": {"class_type": "isaaclab.envs.mdp:UniformVelocityCommand"}},
}
"""Valid content of the file `params/env.yaml` that the training framework Isaac Lab writes."""
UNITREE = {
    "joint_ids_map": [3, 0, 9, 6, 4, 1, 10, 7, 5, 2, 11, 8],
    "step_dt": 0.02,
    "stiffness": joint_ramp(20.0),
    "damping": joint_ramp(0.5),
    "default_joint_pos": joint_ramp(0.5),
    "actions": {
        "JointPositionAction": {
            "clip": [[-2.0, 2.0]] * 12,
            "scale": joint_ramp(0.25),
            "offset": joint_ramp(0.5),
            "joint_ids": None,
        }
    },
    "observations": {
        **{name: {"params": {}, "clip": [-5.0, 5.0], "scale": None, "history_length": 1} for name in _TERMS},
        "gait_phase": {"params": {"period": 0.5}, "clip": None, "scale": None, "history_length": 1},
    },
}
"""Valid content of the file `deploy.yaml`, with which Unitree's software runs a trained policy."""
RL_SAR = (
    {
        "go2/lab": {
            "model_name": "policy.onnx",
            "observations": ["commands", "ang_vel", "gravity_vec", "dof_pos", "dof_vel", "actions"],
            "observations_history": [0, 1, 2],
            "clip_obs": 100.0,
            "clip_actions_lower": [-50] * 12,
            "clip_actions_upper": [50] * 12,
            "rl_kp": joint_ramp(20.0),
            "rl_kd": joint_ramp(0.5),
            "num_of_dofs": 12,
            "action_scale": joint_ramp(0.25),
            "ang_vel_scale": 0.25,
            "dof_pos_scale": 1.0,
            "dof_vel_scale": 0.05,
            "commands_scale": [2.0, 2.0, 0.25],
            "default_dof_pos": joint_ramp(0.5),
            "joint_mapping": [3, 0, 9, 6, 4, 1, 10, 7, 5, 2, 11, 8],
        }
    },
    {"go2": {"dt": 0.005, "decimation": 4, "num_of_dofs": 12, "joint_names": JOINTS}},
)
"""Valid contents of the files `config.yaml` and `base.yaml` of the deployment software rl_sar."""
MJLAB = {
    "joint_names": ",".join(JOINTS),
    "joint_stiffness": ",".join(["20.000"] * 12),
    "joint_damping": ",".join(["0.500"] * 12),
    "default_joint_pos": ",".join(["0.100"] * 12),
    "command_names": "twist",
    "observation_names": "base_lin_vel,base_ang_vel,projected_gravity,joint_pos,joint_vel,actions,command",
    "observation_terms_scale": ",".join(["1.000"] * 7),
    "observation_terms_history_length": ",".join(["1"] * 7),
    "action_scale": ",".join(["0.250"] * 12),
}
"""Valid metadata of an ONNX file, as the training framework mjlab writes them: name -> text."""
TOML = {
    "network": "exported/policy.onnx",
    "control_rate": 50,
    "joints": ["FR", "FL", "RR", "RL"],
    "default_position": {"hip": 0.1, "thigh": 0.8, "calf": -1.5},
    "action_scale": 0.25,
    "stiffness": 20,
    "damping": 0.5,
    "action_clip": [-10, 10],
    "terms": [
        "projected_gravity",
        {"name": "angular_velocity", "scale": 0.25},
        {"name": "joint_position", "history": 3},
        {"name": "gait_clock", "clock": 2.0},
        {"name": "constant", "values": [1.0, 0.0]},
        {"name": "height_scan", "grid": {"x": [-0.1, 0.0, 0.1], "y": [0.0, 0.1], "offset": 0.5}},
    ],
}
"""Valid specification of a policy in the TOML format of this project."""
TERRAIN = {"file": "hill.npy", "size": [8.0, 6.0], "height": 0.4, "start": [0.0, 0.0]}
"""Valid content of a TOML file that describes a terrain with a height field."""
