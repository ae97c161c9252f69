"""What a policy's file says: every field checked, so that a damaged or foreign file is refused in one line.

The layout and scales of the observation must be those of this environment, since a network that reads others would only
look as if it worked.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, PolicyError
from policies.history import Inputs
from policies.network import ACTIVATION, Network
from policies.parameters import is_number
from policies.residual import ResidualPolicy
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
_LARGEST_WEIGHT = 1e6


def _numbers(values: Any, most: int, low: float = -math.inf, high: float = math.inf) -> bool:
    """Whether a JSON value is a list of at most so many numbers between two."""
    return isinstance(values, list) and len(values) <= most and all(is_number(v) and low <= v <= high for v in values)


_RULES: dict[str, tuple[Callable[[Any], bool], str]] = {
    "name": (lambda value: isinstance(value, str) and value != "" and value.isprintable(), "printable characters"),
    "training": (lambda value: isinstance(value, dict), "an object"),
    "git_revision": (lambda value: isinstance(value, str), "a text"),
    "control_period": (lambda value: is_number(value) and 0.0 < value <= 1.0, "a time above 0 s, at most 1 s"),
    "authority": (lambda value: _numbers(value, 12, 0.0, math.pi) and len(value) == 12, "12 numbers from 0 to π"),
    "hold": (lambda value: type(value) is int and 1 <= value <= 1000, "a whole number from 1 to 1000"),
    "inputs": (
        lambda value: (
            isinstance(value, dict)
            and value.keys() <= {"lags", "averages", "clock"}
            and all(_numbers(value.get(name, []), 32) for name in ("lags", "averages"))
            and is_number(value.get("clock", 0.0))
        ),
        "lags and averages, lists of at most 32 numbers, and a clock, a number",
    ),
}
"""What fields must be that mean the same for every robot."""


def description_of(
    policy: ResidualPolicy, training: Mapping[str, Any], git_revision: str, weights_sha256: str
) -> dict[str, Any]:
    """The description of a policy, as JSON values; `training` is the resolved training configuration."""
    return {
        "schema_version": SCHEMA_VERSION,
        "name": policy.name,
        **_of_environment(policy.robot),
        "robot": policy.robot.name,
        "model_sha256": policy.robot.sha256,
        "control_period": policy.control_period,
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
    """The description with exactly the fields of its schema, checked as far as every robot's can be; PolicyError."""
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
    found = _LATER_FIELDS | description
    for field, (holds, what) in _RULES.items():
        if not holds(found[field]):
            fail(place, f"{field} must be {what}")
    return found


def assembled(place: Path, description: dict[str, Any], network: Network, robot: Robot | None = None) -> ResidualPolicy:
    """The policy of a description with its network; `robot` as in `load`. Raises PolicyError."""
    robot = _made_for(place, description, robot)
    for field, here in _of_environment(robot).items():
        if (there := description[field]) != here:
            fail(place, f"{field} differs from that of this {ENV_ID} with {robot.name}: {there!r:.80}")
    if description["model_sha256"] not in (None, robot.sha256):
        fail(place, f"it was trained on another model of {robot.name} than the one that is here (SHA-256 differs)")
    given, authority = description["inputs"], np.array(description["authority"], dtype=np.float32)
    try:
        base = described(description["base"], robot, float(description["control_period"]))
        inputs = Inputs(tuple(given.get("lags", ())), tuple(given.get("averages", ())), given.get("clock", 0.0))
        return ResidualPolicy(base, network, authority, description["name"], inputs, description["hold"])
    except ValueError as error:
        fail(place, str(error))


def _made_for(folder: Path, description: dict[str, Any], robot: Robot | None) -> Robot:
    """The robot, if it is the one that is given."""
    name = description["robot"]
    robot = robot and _commanded(folder, description, robot)
    if robot is None or (name != robot.name and not _is_of(description, robot)):
        robot = _commanded(folder, description, _named(folder, name))
    return robot


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


def network_of(folder: Path, shape: Any, tensors: Mapping[str, NDArray[Any]]) -> Network:
    """The network of a description and of tensors by name. Raises PolicyError."""
    count = len(tensors) // 2
    try:
        weights, biases = (tuple(tensors[f"{i}.{kind}"] for i in range(count)) for kind in ("weight", "bias"))
        network = Network(weights, biases)
    except (IndexError, KeyError, ValueError) as error:
        fail(folder, f"the tensors in {WEIGHTS} make no network ({error})")
    if len(tensors) % 2 or shape != {"sizes": list(network.sizes), "activation": ACTIVATION}:
        fail(folder, f"the tensors in {WEIGHTS} are not of the network, {shape!r:.80}, that {DESCRIPTION} describes")
    if not all(np.abs(value).max(initial=0.0) <= _LARGEST_WEIGHT for value in tensors.values()):  # NaN is not
        fail(folder, f"weights must be finite and lie within ±{_LARGEST_WEIGHT:g}")
    return network


def _of_environment(robot: Robot) -> dict[str, Any]:
    """Fields that say in which environment a policy acts; the observation's layout by name -> [start, stop]."""
    table = observation_table(robot)
    return {
        "env_id": ENV_ID,
        "joints": list(robot.joint_names),
        "observation": {name: [part.start, part.stop] for name, part in table.slices.items()},
        "observation_scale": table.scale.tolist(),
    }


def fail(folder: Path, reason: str) -> NoReturn:
    """Raise PolicyError, one line, for the policy in a folder."""
    raise PolicyError(f"cannot load the policy in {folder}: {reason}", "train it again, or fetch a complete copy")
