"""What a policy's file says: every field checked, so that a damaged or foreign file is refused in one line.

The layout and scales of the observation must be those of this environment, since a network that reads others would only
look as if it worked.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, Actions, PolicyError
from policies.history import Inputs
from policies.network import ACTIVATION, Network
from policies.parameters import is_number
from policies.residual import Features, ResidualPolicy
from policies.residual_bases import describe, described
from quad_env import ENV_ID
from quad_env.files.reading import parse_json
from quad_env.robots.named import ROBOTS
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.task.observations import observation_table

SCHEMA_VERSION = 1
DESCRIPTION, WEIGHTS = "policy.json", "policy.safetensors"
_FIELDS = {
    "schema_version",
    "name",
    "env_id",
    "observation",
    "observation_scale",
    "network",
    "base",
    "authority",
    "training",
    "git_revision",
    "weights_sha256",
}
_LATER_FIELDS: dict[str, Any] = {
    "robot": SIMPLE_QUAD.name,
    "joints": list(SIMPLE_QUAD.joint_names),
    "model_sha256": None,
    "control_period": CONTROL_PERIOD,
    "inputs": {},
    "hold": 1,
    "servo": None,
}
"""Fields that older bundles lack, and what these were made for."""
_REMOVED_FIELDS = {
    "command_authority": [0.0] * 3,
    "foothold_authority": [0.0] * 2,
    "gait_authority": [0.0] * 3,
    "space": "joints",
    "shift_time": 0.0,
}
"""Fields of bundles of older versions, and the only values that policies can still have."""
_LARGEST_WIDTH, _MOST_LAYERS = 4096, 16
_LARGEST_WEIGHT = 1e6
_LARGEST_AUTHORITY = math.pi
_LONGEST_PERIOD = 1.0
_MOST_FRAMES = 32
_LONGEST_HOLD = 1000


def description_of(
    policy: ResidualPolicy, training: Mapping[str, Any], git_revision: str, weights_sha256: str
) -> dict[str, Any]:
    """The description of a policy, as JSON values; `training` is the resolved training configuration."""
    return {
        "schema_version": SCHEMA_VERSION,
        "name": policy.name,
        "env_id": ENV_ID,
        "robot": policy.robot.name,
        "joints": list(policy.robot.joint_names),
        "model_sha256": policy.robot.sha256,
        "control_period": policy.control_period,
        "observation": _layout(policy.robot),
        "observation_scale": observation_table(policy.robot).scale.tolist(),
        "network": {"sizes": list(policy.network.sizes), "activation": ACTIVATION},
        "base": describe(policy.base),
        "authority": policy.authority.tolist(),
        "inputs": asdict(policy.features.inputs),
        "hold": policy.hold,
        "servo": [policy.robot.servo_stiffness.tolist(), policy.robot.servo_damping.tolist()],
        "training": dict(training),
        "git_revision": git_revision,
        "weights_sha256": weights_sha256,
    }


def parsed(place: Path, content: bytes) -> dict[str, Any]:
    """The description with exactly the fields of its schema, whose contents are yet to be checked; PolicyError."""
    try:
        description = parse_json(content)
    except ValueError as error:
        fail(place, f"{DESCRIPTION} is not JSON ({error})")
    if not isinstance(description, dict):
        fail(place, f"{DESCRIPTION} must hold an object")
    version = description.get("schema_version")
    if type(version) is not int or version != SCHEMA_VERSION:
        fail(place, f"schema_version must be {SCHEMA_VERSION}, not {version!r:.80}")
    if missing := sorted(_FIELDS - set(description)):
        fail(place, f"{DESCRIPTION} lacks {', '.join(missing)}")
    for field, only in _REMOVED_FIELDS.items():
        if (value := description.pop(field, only)) != only:
            fail(place, f"its {field} is {value!r:.80}, which this version cannot do; an older one can")
    if unknown := sorted(set(description) - _FIELDS - set(_LATER_FIELDS)):
        fail(place, f"{DESCRIPTION} has unknown fields {', '.join(unknown)}")
    return _LATER_FIELDS | description


def assembled(
    place: Path, description: dict[str, Any], network: Callable[[int, int], Network], robot: Robot | None = None
) -> ResidualPolicy:
    """The policy of a description, with the network of so many inputs and outputs; `robot` as in `load`. Raises
    PolicyError."""
    robot, control_period = _made_for(place, description, robot)
    _check_environment(place, description, robot)
    try:
        base = described(description["base"], robot, control_period)
    except ValueError as error:
        fail(place, str(error))
    inputs = _inputs(place, description["inputs"])
    corrects = network(Features(base, inputs).width, robot.num_joints)
    if type(hold := description["hold"]) is not int or not 1 <= hold <= _LONGEST_HOLD:
        fail(place, f"hold must be a whole number from 1 to {_LONGEST_HOLD}")
    name = description["name"]
    if not isinstance(name, str) or not name or not name.isprintable():
        fail(place, "name must be a text of printable characters")
    authority = _authority(place, description["authority"], robot.num_joints)
    return ResidualPolicy(base, corrects, authority, name, inputs, hold)


def _check_environment(folder: Path, description: dict[str, Any], robot: Robot) -> None:
    if description["env_id"] != ENV_ID:
        fail(folder, f"it is for {description['env_id']!r}, not {ENV_ID!r}")
    if description["observation"] != _layout(robot):
        fail(folder, f"its observation layout is not that of this {ENV_ID}")
    if description["observation_scale"] != observation_table(robot).scale.tolist():
        fail(folder, f"its observation scales are not those of this {ENV_ID}")
    if not isinstance(description["training"], dict) or not isinstance(description["git_revision"], str):
        fail(folder, "training must be an object and git_revision a text")


def _made_for(folder: Path, description: dict[str, Any], robot: Robot | None) -> tuple[Robot, float]:
    """The robot, if it is the one that is given, and the control period, s."""
    name, control_period = description["robot"], description["control_period"]
    robot = robot and _commanded(folder, description, robot)
    if robot is None or (name != robot.name and not _is_of(description, robot)):
        robot = _commanded(folder, description, _named(folder, name))
    if description["joints"] != list(robot.joint_names):
        fail(folder, f"it was trained on other joints than those of {robot.name}, or in another order")
    if description["model_sha256"] is not None and description["model_sha256"] != robot.sha256:
        fail(folder, f"it was trained on another model of {robot.name} than the one that is here (SHA-256 differs)")
    if not is_number(control_period) or not 0.0 < control_period <= _LONGEST_PERIOD:
        fail(folder, f"control_period must be a time above 0 s, at most {_LONGEST_PERIOD:g} s")
    return robot, float(control_period)


def _commanded(folder: Path, description: dict[str, Any], robot: Robot) -> Robot:
    """The robot with the servo gains that the policy was trained with; bundles of before 0.3 have stiff ones."""
    try:
        stiffness, damping = robot.stiff_servo if description["servo"] is None else description["servo"]
        return robot.with_servo(stiffness, damping)
    except (TypeError, ValueError):
        fail(folder, f"servo must be stiffness and damping of {robot.num_joints} joints, above 0")


def _is_of(description: dict[str, Any], robot: Robot) -> bool:
    """Whether it was trained on that robot's model, whose file may have another name now."""
    trained_on = description["model_sha256"]
    if trained_on is None and description["robot"] == SIMPLE_QUAD.name:
        trained_on = SIMPLE_QUAD.sha256
    return bool(trained_on == robot.sha256)


def _named(folder: Path, name: Any) -> Robot:
    if not isinstance(name, str) or name not in ROBOTS:
        fail(folder, f"it is for a robot {name!r}, which is none of {', '.join(ROBOTS)}: say which with --robot")
    try:
        return ROBOTS[name]
    except ModuleNotFoundError as error:
        fail(folder, str(error))


def network_of(folder: Path, shape: Any, tensors: Mapping[str, NDArray[Any]], inputs: int, outputs: int) -> Network:
    """The network of a description and of tensors by name. Raises PolicyError."""
    if not isinstance(shape, dict) or set(shape) != {"sizes", "activation"}:
        fail(folder, "network must have sizes and activation")
    sizes = shape["sizes"]
    if not isinstance(sizes, list) or not all(type(s) is int and 0 < s <= _LARGEST_WIDTH for s in sizes):
        fail(folder, f"network sizes must be whole numbers from 1 to {_LARGEST_WIDTH}")
    if not 2 <= len(sizes) <= _MOST_LAYERS + 1 or sizes[0] != inputs or sizes[-1] != outputs:
        fail(folder, f"network sizes must lead from {inputs} inputs to {outputs} outputs")
    if shape["activation"] != ACTIVATION:
        fail(folder, f"activation must be {ACTIVATION}")
    layers = list(enumerate(pairwise(sizes)))
    expected = {f"{i}.weight": pair for i, pair in layers} | {f"{i}.bias": pair[1:] for i, pair in layers}
    if {key: value.shape for key, value in tensors.items()} != expected:
        fail(folder, f"the tensors in {WEIGHTS} do not make the network that {DESCRIPTION} describes")
    if not all(value.dtype == np.float32 and np.isfinite(value).all() for value in tensors.values()):
        fail(folder, "weights must be finite float32")
    if not all(np.abs(value).max() <= _LARGEST_WEIGHT for value in tensors.values()):
        fail(folder, f"weights must lie within ±{_LARGEST_WEIGHT:g}")
    weights, biases = (tuple(tensors[f"{i}.{kind}"] for i, _ in layers) for kind in ("weight", "bias"))
    return Network(weights, biases)


def _authority(folder: Path, values: Any, count: int) -> Actions:
    if not isinstance(values, list) or len(values) != count:
        fail(folder, f"authority must be {count} numbers")
    if not all(is_number(value) and 0.0 <= value <= _LARGEST_AUTHORITY for value in values):
        fail(folder, "authority must be finite numbers from 0 to π")
    return np.array(values, dtype=np.float32)


def _inputs(folder: Path, values: Any) -> Inputs:
    if not isinstance(values, dict) or not set(values) <= {"lags", "averages", "clock"}:
        fail(folder, "inputs must have lags, averages and a clock")
    clock, times = values.get("clock", 0.0), {name: values.get(name, []) for name in ("lags", "averages")}
    if not all(isinstance(each, list) and len(each) <= _MOST_FRAMES for each in times.values()):
        fail(folder, f"lags and averages must be lists of at most {_MOST_FRAMES} times")
    if not all(is_number(number) for number in (clock, *times["lags"], *times["averages"])):
        fail(folder, "lags, averages and the clock must be numbers")
    try:
        return Inputs(tuple(times["lags"]), tuple(times["averages"]), clock)
    except ValueError as error:
        fail(folder, str(error))


def _layout(robot: Robot) -> dict[str, list[int]]:
    """The observation's layout: name -> [start, stop]."""
    return {name: [part.start, part.stop] for name, part in observation_table(robot).slices.items()}


def fail(folder: Path, reason: str) -> NoReturn:
    """Raise PolicyError, one line, for the policy in a folder."""
    raise PolicyError(f"cannot load the policy in {folder}: {reason}", "train it again, or fetch a complete copy")
