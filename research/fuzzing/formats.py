"""Formats that are fuzzed: a valid file, its mutations and its reader for each.

A reader raises its own one-line error for any fault; a result has to be plausible.
"""

import io
import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from policies import bundle
from policies.base import CONTROL_PERIOD, PolicyError
from policies.external import onnx_file, readers
from policies.external.network_policy import control_period_ratio, with_spec_gains
from policies.external.observation_adapter import ObservationAdapter
from policies.external.packages import import_package
from policies.external.reference import PolicyReference, resolve_reference
from policies.external.spec import PolicySpec
from policies.shipped import MODELS
from quad_env.robots.plausibility import find_warnings
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.terrain import HeightField
from research.fuzzing.mutations import mutate_bytes, mutate_tree, mutate_xml

Rng = np.random.Generator
Write = Callable[[Path, Rng], Path]
"""Function that writes a mutated file into an empty folder and returns its path."""
Read = Callable[[Path], None]
"""Function that reads it: raises its own error for a fault, an AbsurdError for an implausible result."""
_SHARE_OF_BYTES = 0.2
"""Share of mutations of the file's bytes rather than of its values."""
_LEGS = ("FR", "FL", "RR", "RL")
_KINDS = ("hip_joint", "thigh_joint", "calf_joint")
_JOINTS = [f"{leg}_{kind}" for leg in _LEGS for kind in _KINDS]


class AbsurdError(AssertionError):
    """Implausible robot or policy, read without an error."""


def _count(rng: Rng) -> int:
    return int(rng.choice([1, 1, 2, 4]))


def _text(tree: Any, suffix: str) -> bytes:
    if suffix == ".json":
        return json.dumps(tree).encode()
    if suffix == ".toml":
        return "".join(f"{key} = {_toml(value)}\n" for key, value in tree.items()).encode(errors="replace")
    return bytes(import_package("yaml").safe_dump(tree, sort_keys=False, allow_unicode=True).encode())


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(str(key))} = {_toml(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return '""' if value is None else json.dumps(value).replace("NaN", "nan").replace("Infinity", "inf")


def _settings(tree: Any, name: str, network: str = "exported/policy.onnx") -> Write:
    """Return the writer of a text file of values, with an empty network where it expects one."""

    def write(folder: Path, rng: Rng) -> Path:
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        (folder / network).parent.mkdir(parents=True, exist_ok=True)
        (folder / network).touch()
        if rng.random() < _SHARE_OF_BYTES:
            file.write_bytes(mutate_bytes(_text(tree, file.suffix), rng, _count(rng)))
        else:
            file.write_bytes(_text(mutate_tree(tree, rng, _count(rng)), file.suffix))
        return file

    return write


def _rl_sar(folder: Path, rng: Rng) -> Path:
    config, base = _RL_SAR
    which = int(rng.integers(3))
    file = _settings(config, "go2/lab/config.yaml", "go2/lab/policy.onnx")(folder, rng)
    if which:
        file.write_bytes(_text(config, ".yaml"))
    _settings(base, "go2/base.yaml", "go2/lab/policy.onnx")(folder, rng)
    if which == 0:
        (folder / "go2/base.yaml").write_bytes(_text(base, ".yaml"))
    return file


def _read_description(file: Path) -> None:
    """Read a description, and derive its values for a robot."""
    found = readers.read(file)
    if found is None:
        return
    _check_description(found)
    robot = with_spec_gains(SIMPLE_QUAD, found)
    control_period_ratio(found, CONTROL_PERIOD)
    if found.width * max(term.history for term in found.terms) < 10_000_000:
        ObservationAdapter(found, robot, CONTROL_PERIOD)


def _check_description(found: PolicySpec) -> None:
    numbers = np.concatenate([np.ravel(getattr(found, name)) for name in ("stiffness", "damping", "action_scale")])
    if not (np.isfinite(numbers).all() and np.abs(numbers).max() <= 1e4 and 1.0 <= found.control_rate <= 1e4):
        raise AbsurdError(f"a description with gains up to {np.abs(numbers).max():g} at {found.control_rate:g} Hz")
    if found.width > 100_000:
        raise AbsurdError(f"an observation of {found.width} numbers")


def _network(metadata: dict[str, str]) -> Any:
    onnx = import_package("onnx")
    kind = onnx.TensorProto.FLOAT
    weights = onnx.numpy_helper.from_array(np.full((48, 12), 0.01, np.float32), "weights")
    bias = onnx.numpy_helper.from_array(np.zeros(12, np.float32), "bias")
    ends = [onnx.helper.make_tensor_value_info(name, kind, [1, width]) for name, width in (("obs", 48), ("act", 12))]
    nodes = [
        onnx.helper.make_node("Gemm", ["obs", "weights", "bias"], ["sum"]),
        onnx.helper.make_node("Tanh", ["sum"], ["act"]),
    ]
    graph = onnx.helper.make_graph(nodes, "policy", ends[:1], ends[1:], [weights, bias])
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8)
    for key, value in metadata.items():
        model.metadata_props.add(key=key, value=value)
    return model


def _mjlab(folder: Path, rng: Rng) -> Path:
    file = folder / "policy.onnx"
    metadata = {str(key): str(value)[:5000] for key, value in mutate_tree(_MJLAB, rng, _count(rng)).items()}
    if rng.random() < 0.5:
        key = list(metadata)[rng.integers(len(metadata))]
        metadata[key] = mutate_bytes(metadata[key].encode(), rng, _count(rng)).decode(errors="replace")
    content = _network(metadata).SerializeToString()
    file.write_bytes(mutate_bytes(content, rng) if rng.random() < _SHARE_OF_BYTES else content)
    return file


_OPERATORS = ("Identity", "RandomNormalLike", "Loop", "Gemm", "Tanh", "Shape", "NoSuch", "Reshape", "Tile", "Exp")


def _graph(folder: Path, rng: Rng) -> Path:
    model = _network({})
    graph = model.graph
    for _ in range(_count(rng)):
        node = graph.node[rng.integers(len(graph.node))]
        match int(rng.integers(9)):
            case 0:
                node.op_type = _OPERATORS[rng.integers(len(_OPERATORS))]
            case 1:
                del node.input[rng.integers(len(node.input) + 1) :]
            case 2 if _has_shape(graph):
                sizes = graph.input[0].type.tensor_type.shape.dim
                sizes[rng.integers(len(sizes))].dim_value = int(rng.choice([0, 1, -1, 12, 2**31, 2**40]))
            case 3 if graph.input:
                del graph.input[0].type.tensor_type.shape.dim[int(rng.integers(2)) :]
            case 4:
                ends = graph.input if rng.integers(2) else graph.output
                del ends[:]
            case 5:
                tensor = graph.initializer[rng.integers(len(graph.initializer))]
                tensor.dims[0] = int(rng.choice([0, 1, -1, 2**31, 2**40]))
            case 6:
                tensor = graph.initializer[rng.integers(len(graph.initializer))]
                tensor.raw_data = mutate_bytes(tensor.raw_data, rng, 3)
            case 7 if graph.input:
                graph.input[0].type.tensor_type.elem_type = int(rng.integers(20))
            case _:
                graph.node.add().CopyFrom(node)
    content = model.SerializeToString()
    file = folder / "policy.onnx"
    file.write_bytes(mutate_bytes(content, rng) if rng.random() < _SHARE_OF_BYTES else content)
    return file


def _has_shape(graph: Any) -> bool:
    return bool(graph.input and graph.input[0].type.tensor_type.shape.dim)


def _read_graph(file: Path) -> None:
    readers.read(file)
    policy = onnx_file.load_onnx(PolicyReference(file), SIMPLE_QUAD)
    act: Any = policy()  # type: ignore[operator]
    try:
        act(np.zeros(48, np.float32))
    except Exception as error:  # the process of a policy reports any exception
        raise PolicyError(f"it raises {type(error).__name__}") from None


def _bundle(folder: Path, rng: Rng) -> Path:
    shutil.copytree(MODELS / "residual", folder / "policy")
    place = folder / "policy" / (bundle.WEIGHTS if rng.random() < _SHARE_OF_BYTES else bundle.DESCRIPTION)
    if place.name == bundle.WEIGHTS or rng.random() < _SHARE_OF_BYTES:
        place.write_bytes(mutate_bytes(place.read_bytes(), rng, _count(rng)))
    else:
        tree = mutate_tree(json.loads(place.read_bytes()), rng, _count(rng))
        place.write_text(json.dumps(tree), encoding="utf-8")
    return folder / "policy"


def _read_bundle(folder: Path) -> None:
    policy = bundle.load(folder)
    if not (np.isfinite(policy.authority).all() and policy.authority.min() >= 0.0 and policy.authority.max() <= np.pi):
        raise AbsurdError(f"an authority of {policy.authority}")


def _zip(folder: Path, rng: Rng) -> Path:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("data", json.dumps(mutate_tree({"policy_class": "x", "observation_space": {"n": 48}}, rng)))
        archive.writestr("policy.pth", rng.bytes(200))
    file = folder / "model.zip"
    file.write_bytes(mutate_bytes(content.getvalue(), rng, _count(rng)))
    return file


def _read_zip(file: Path) -> None:
    resolve_reference(file, trust=False)
    raise AbsurdError("a model of Stable-Baselines3 is taken without --trust")


def _xml(source: Path, name: str) -> Write:
    def write(folder: Path, rng: Rng) -> Path:
        file = folder / name
        if rng.random() < _SHARE_OF_BYTES:
            file.write_bytes(mutate_bytes(source.read_bytes(), rng, _count(rng)))
        else:
            root = mutate_xml(ElementTree.fromstring(source.read_bytes()), rng, _count(rng))
            file.write_bytes(ElementTree.tostring(root))
        return file

    return write


def _read_robot(file: Path) -> None:
    robot = Robot.from_mjcf(file)
    model = robot.model
    words = list(find_warnings(robot))
    figures = [robot.mass, robot.leg_length, robot.home_height, robot.rated_torque]
    figures += [
        *robot.joint_lower,
        *robot.joint_upper,
        *robot.servo_stiffness,
        *robot.servo_damping,
        *robot.trunk_size,
        *robot.home_pose,
    ]
    if not np.isfinite(figures).all() or not np.isfinite(model.body_mass).all():
        raise AbsurdError("a robot with figures that are not finite")
    if not words and not (0.05 < robot.mass < 5000.0 and 0.02 < robot.leg_length < 5.0 and robot.rated_torque < 1e5):
        size = f"{robot.mass:g} kg on legs of {robot.leg_length:g} m"
        raise AbsurdError(f"a robot of {size} with {robot.rated_torque:g} N·m")


def _terrain(folder: Path, rng: Rng) -> Path:
    heights = rng.random((20, 30))
    content = io.BytesIO()
    np.save(content, heights)
    array = content.getvalue()
    (folder / "hill.npy").write_bytes(mutate_bytes(array[:128], rng) + array[128:] if rng.random() < 0.4 else array)
    return _settings(_TERRAIN, "hill.toml", "none.onnx")(folder, rng)


def _read_terrain(file: Path) -> None:
    found = HeightField.from_toml(file)
    if not np.isfinite([found.heights.min_height, found.heights.span]).all():
        raise AbsurdError("heights that are not finite")


def _of_joints(factor: float) -> list[float]:
    return [factor * (1.0 + number / 16) for number in range(12)]


_TERMS = ("base_ang_vel", "projected_gravity", "velocity_commands", "joint_pos_rel", "joint_vel_rel", "last_action")
_LEGGED_GYM = {
    "env": {"num_observations": 48},
    "terrain": {"measure_heights": False, "measured_points_x": [-0.1, 0.0, 0.1], "measured_points_y": [0.0, 0.2]},
    "init_state": {"default_joint_angles": dict(zip(_JOINTS, _of_joints(0.5), strict=True))},
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
_ENV = {
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
_DEPLOY = {
    "joint_ids_map": [3, 0, 9, 6, 4, 1, 10, 7, 5, 2, 11, 8],
    "step_dt": 0.02,
    "stiffness": _of_joints(20.0),
    "damping": _of_joints(0.5),
    "default_joint_pos": _of_joints(0.5),
    "actions": {
        "JointPositionAction": {
            "clip": [[-2.0, 2.0]] * 12,
            "scale": _of_joints(0.25),
            "offset": _of_joints(0.5),
            "joint_ids": None,
        }
    },
    "observations": {
        **{name: {"params": {}, "clip": [-5.0, 5.0], "scale": None, "history_length": 1} for name in _TERMS},
        "gait_phase": {"params": {"period": 0.5}, "clip": None, "scale": None, "history_length": 1},
    },
}
_RL_SAR = (
    {
        "go2/lab": {
            "model_name": "policy.onnx",
            "observations": ["commands", "ang_vel", "gravity_vec", "dof_pos", "dof_vel", "actions"],
            "observations_history": [0, 1, 2],
            "clip_obs": 100.0,
            "clip_actions_lower": [-50] * 12,
            "clip_actions_upper": [50] * 12,
            "rl_kp": _of_joints(20.0),
            "rl_kd": _of_joints(0.5),
            "num_of_dofs": 12,
            "action_scale": _of_joints(0.25),
            "ang_vel_scale": 0.25,
            "dof_pos_scale": 1.0,
            "dof_vel_scale": 0.05,
            "commands_scale": [2.0, 2.0, 0.25],
            "default_dof_pos": _of_joints(0.5),
            "joint_mapping": [3, 0, 9, 6, 4, 1, 10, 7, 5, 2, 11, 8],
        }
    },
    {"go2": {"dt": 0.005, "decimation": 4, "num_of_dofs": 12, "joint_names": _JOINTS}},
)
_MJLAB = {
    "joint_names": ",".join(_JOINTS),
    "joint_stiffness": ",".join(["20.000"] * 12),
    "joint_damping": ",".join(["0.500"] * 12),
    "default_joint_pos": ",".join(["0.100"] * 12),
    "command_names": "twist",
    "observation_names": "base_lin_vel,base_ang_vel,projected_gravity,joint_pos,joint_vel,actions,command",
    "observation_terms_scale": ",".join(["1.000"] * 7),
    "observation_terms_history_length": ",".join(["1"] * 7),
    "action_scale": ",".join(["0.250"] * 12),
}
_TOML = {
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
_TERRAIN = {"file": "hill.npy", "size": [8.0, 6.0], "height": 0.4, "start": [0.0, 0.0]}

FORMATS: dict[str, tuple[Write, Read]] = {
    "legged-gym-yaml": (_settings(_LEGGED_GYM, "settings.yaml"), _read_description),
    "legged-gym-json": (_settings(_LEGGED_GYM, "settings.json"), _read_description),
    "isaac-lab": (_settings(_ENV, "params/env.yaml"), _read_description),
    "unitree": (_settings(_DEPLOY, "params/deploy.yaml"), _read_description),
    "rl-sar": (_rl_sar, _read_description),
    "mjlab": (_mjlab, _read_description),
    "toml": (_settings(_TOML, "policy.toml"), _read_description),
    "bundle": (_bundle, _read_bundle),
    "onnx": (_graph, _read_graph),
    "sb3": (_zip, _read_zip),
    "mjcf": (_xml(SIMPLE_QUAD.mjcf, "robot.xml"), _read_robot),
    "urdf": (_xml(SIMPLE_QUAD.mjcf.with_suffix(".urdf"), "robot.urdf"), _read_robot),
    "terrain": (_terrain, _read_terrain),
}
"""Name -> writer of a mutated file and its reader."""
OWN_ERRORS = (PolicyError, ValueError, OSError)
"""Errors of readers for a faulty file: PolicyError, ModelError, other value errors, and system errors."""
