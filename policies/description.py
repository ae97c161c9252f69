"""What a policy's file says: every field checked, so that a damaged or foreign file is refused in one line.

The layout and scales of the observation must be those of this environment, since a network that reads others would only
look as if it worked.
"""

import hashlib
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from policies.base import CONTROL_PERIOD, PolicyError
from policies.history import Inputs
from policies.network import ACTIVATION, Network
from policies.residual import ResidualPolicy
from policies.residual_bases import base_from_json, base_to_json
from quad_env import ENV_ID
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.config import Bounds, Settings
from quad_env.files.reading import parse_json
from quad_env.robots.registry import ROBOTS
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.sensing.height_scan import HeightScan, table_with

SCHEMA_VERSION = 1
DESCRIPTION, WEIGHTS = "policy.json", "policy.safetensors"
DIGEST = "description_sha256"
"""Field with the SHA-256 of all others."""
_REMOVED_FIELDS = {
    "command_authority": [0.0] * 3,
    "foothold_authority": [0.0] * 2,
    "gait_authority": [0.0] * 3,
    "space": "joints",
    "shift_time": 0.0,
}
"""Fields of bundles of older versions, and the only values that policies can still have."""
_LARGEST_WEIGHT = 1e6


@dataclass(frozen=True)
class BundleFields(Settings):
    """Fields of a description, as JSON values; older bundles lack those with a default, and were made for that."""

    schema_version: Literal[1]
    name: str
    env_id: str
    observation: Any
    observation_scale: Any
    network: Any
    base: Any
    authority: list[Annotated[float, Bounds("from 0 to π", 0.0, math.pi)]]
    training: dict[str, Any]
    git_revision: str
    weights_sha256: str
    description_sha256: str | None = None
    robot: str = SIMPLE_QUAD.name
    joints: Any = field(default_factory=lambda: list(SIMPLE_QUAD.joint_names))
    model_sha256: str | None = None
    control_period: Annotated[float, Bounds("above 0 s, at most 1 s", sys.float_info.min, 1.0)] = CONTROL_PERIOD
    inputs: Inputs = field(default_factory=Inputs)
    hold: Annotated[int, Bounds("from 1 to 1000", 1, 1000)] = 1
    servo: Any = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.authority) != 12 or not (self.name and self.name.isprintable()):
            raise ValueError("authority must be 12 numbers, and the name printable characters")


def describe_policy(
    policy: ResidualPolicy, training: Mapping[str, Any], git_revision: str, weights_sha256: str
) -> dict[str, Any]:
    """The description of a policy, as JSON values; `training` is the resolved training configuration."""
    found = {
        "schema_version": SCHEMA_VERSION,
        "name": policy.name,
        **_of_environment(policy.robot, policy.height_scan),
        "robot": policy.robot.name,
        "model_sha256": policy.robot.sha256,
        "control_period": policy.control_period,
        "network": {"sizes": list(policy.network.sizes), "activation": ACTIVATION},
        "base": base_to_json(policy.base),
        "authority": policy.authority.tolist(),
        "inputs": asdict(policy.features.inputs),
        "hold": policy.hold,
        "servo": [policy.robot.servo_stiffness.tolist(), policy.robot.servo_damping.tolist()],
        "training": dict(training),
        "git_revision": git_revision,
        "weights_sha256": weights_sha256,
    }
    return found | {DIGEST: description_digest(found)}


def description_digest(description: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a description, as JSON values, without its own digest."""
    values = {name: value for name, value in description.items() if name != DIGEST}
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def check_unaltered(place: Path, content: bytes) -> None:
    """Raise PolicyError for a description altered since it was written; older descriptions have no digest."""
    found = parse_json(content)
    if found.get(DIGEST) not in (None, description_digest(found)):
        fail(place, f"{DESCRIPTION} is not as it was written ({DIGEST} differs)")


def parse_description(place: Path, content: bytes) -> BundleFields:
    """The description with exactly the fields of its schema, checked as far as every robot's can be; PolicyError."""
    try:
        found = parse_json(content)
    except ValueError as error:
        fail(place, f"{DESCRIPTION} is not JSON ({error})")
    if not isinstance(found, dict) or not isinstance(inputs := found.get("inputs", {}), dict):
        fail(place, f"{DESCRIPTION} must hold an object, and so must its inputs")
    for name, only in _REMOVED_FIELDS.items():
        if (value := found.pop(name, only)) != only:
            fail(place, f"its {name} is {value!r:.80}, which this version cannot do; an older one can")
    needed = [each.name for each in fields(BundleFields) if each.default is MISSING and each.default_factory is MISSING]
    if lacking := [name for name in needed if name not in found]:
        fail(place, f"{DESCRIPTION} lacks {', '.join(lacking)}")
    inputs = {name: tuple(value) if isinstance(value, list) else value for name, value in inputs.items()}
    try:
        return BundleFields(**found | {"inputs": Inputs(**inputs)})
    except (TypeError, ValueError) as error:
        fail(place, f"{DESCRIPTION} is none of this version: {error}")


def assemble_policy(
    place: Path,
    description: BundleFields,
    network: Network,
    robot: Robot | None = None,
    joint_delay_steps: int = 0,
    actuator: Actuator = IDEAL,
) -> ResidualPolicy:
    """The policy of a description with its network; `robot`, `late` and `actuator` as in `load`. Raises PolicyError."""
    robot = _made_for(place, description, robot)
    authority = np.array(description.authority, dtype=np.float32)
    try:
        base = base_from_json(description.base, robot, float(description.control_period), joint_delay_steps, actuator)
        for name, here in _of_environment(robot, base.height_scan).items():
            if (there := getattr(description, name)) != here:
                raise ValueError(f"{name} differs from that of this {ENV_ID} with {robot.name}: {there!r:.80}")
        if description.model_sha256 not in (None, robot.sha256):
            raise ValueError(
                f"it was trained on another model of {robot.name} than the one that is here (SHA-256 differs)"
            )
        return ResidualPolicy(base, network, authority, description.name, description.inputs, description.hold)
    except ValueError as error:
        fail(place, str(error))


def _made_for(folder: Path, description: BundleFields, robot: Robot | None) -> Robot:
    """The robot that is given if the policy was trained on its model, whatever its file is called now, else the one of
    that name; with the servo gains that the policy was trained with: bundles of before 0.3 have stiff ones."""
    name, trained_on = description.robot, description.model_sha256
    if trained_on is None and name == SIMPLE_QUAD.name:
        trained_on = SIMPLE_QUAD.sha256
    if robot is None or (name != robot.name and trained_on != robot.sha256):
        robot = _named(folder, name)
    try:
        stiffness, damping = robot.stiff_servo if description.servo is None else description.servo
        return robot.with_servo(stiffness, damping)
    except (TypeError, ValueError):
        fail(folder, f"servo must be stiffness and damping of {robot.num_joints} joints, above 0")


def _named(folder: Path, name: str) -> Robot:
    if name not in ROBOTS:
        fail(folder, f"it is for a robot {name!r}, which is none of {', '.join(ROBOTS)}: say which with --robot")
    try:
        return ROBOTS[name]
    except ModuleNotFoundError as error:
        fail(folder, str(error))


def build_network(folder: Path, shape: Any, tensors: Mapping[str, NDArray[Any]]) -> Network:
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


def _of_environment(robot: Robot, scan: HeightScan | None) -> dict[str, Any]:
    """Fields that say in which environment a policy acts; the observation's layout by name -> [start, stop]."""
    table = table_with(robot, scan)
    return {
        "env_id": ENV_ID,
        "joints": list(robot.joint_names),
        "observation": {name: [part.start, part.stop] for name, part in table.slices.items()},
        "observation_scale": table.scale.tolist(),
    }


def fail(folder: Path, reason: str) -> NoReturn:
    """Raise PolicyError, one line, for the policy in a folder."""
    raise PolicyError(f"cannot load the policy in {folder}: {reason}", "train it again, or fetch a complete copy")
