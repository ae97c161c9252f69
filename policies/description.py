"""Description of a trained policy: the file `policy.json` of a policy bundle, and its checks.

A damaged file is rejected with a message of one line. A file is also rejected if the layout or the scales of the
observation in the file differ from the environment, because the network would then compute with wrong inputs.
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
"""Version of the file format of `policy.json`, stored in its field `schema_version`."""
DESCRIPTION = "policy.json"
"""Name of the file with the description in a policy bundle (folder with a trained policy)."""
WEIGHTS = "policy.safetensors"
"""Name of the file with the network weights in a policy bundle (folder with a trained policy)."""
DIGEST = "description_sha256"
"""Name of the field of `policy.json` that has the SHA-256 of all other fields."""
_REMOVED_FIELDS = {
    "command_authority": [0.0] * 3,
    "foothold_authority": [0.0] * 2,
    "gait_authority": [0.0] * 3,
    "space": "joints",
    "shift_time": 0.0,
}
"""Name of each removed field of `policy.json` -> the only value of this field that this version accepts.

Older versions of the project wrote these fields. With the accepted value, a policy does not use the feature that was
removed."""
_MAX_WEIGHT = 1e6
"""Largest absolute value of a network weight or bias that is accepted in a policy bundle."""


@dataclass(frozen=True)
class BundleFields(Settings):
    """Fields of the file `policy.json`, which describes a trained policy, as JSON values.

    Fields with a default value may be missing in the file, because older versions of the project did not write them.
    """

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
    bounded: bool = True
    network_inputs: Any = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.authority) != 12 or not (self.name and self.name.isprintable()):
            raise ValueError("authority must be 12 numbers, and the name printable characters")


def describe_policy(
    policy: ResidualPolicy, training: Mapping[str, Any], git_revision: str, weights_sha256: str
) -> dict[str, Any]:
    """Return the description of a trained policy, the dictionary that is written to `policy.json`.

    Args:
        policy: Trained policy.
        training: All settings of the training: name -> JSON value.
        git_revision: Git revision of the code that trained the policy.
        weights_sha256: SHA-256 of the file with the network weights.

    Returns:
        Field name -> JSON value. The field `description_sha256` has the SHA-256 of all other fields.
    """
    description = {
        "schema_version": SCHEMA_VERSION,
        "name": policy.name,
        **_environment_fields(policy.robot, policy.height_scan),
        "robot": policy.robot.name,
        "model_sha256": policy.robot.sha256,
        "control_period": policy.control_period,
        "network": {"sizes": list(policy.network.sizes), "activation": ACTIVATION},
        "base": base_to_json(policy.base),
        "authority": policy.authority.tolist(),
        "inputs": asdict(policy.features.inputs),
        "hold": policy.hold,
        "bounded": policy.bounded,
        **_layout_fields(policy),
        "servo": [policy.robot.servo_stiffness.tolist(), policy.robot.servo_damping.tolist()],
        "training": dict(training),
        "git_revision": git_revision,
        "weights_sha256": weights_sha256,
    }
    return description | {DIGEST: description_digest(description)}


def description_digest(description: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a policy `description` (field name -> JSON value), in hexadecimal digits.

    The field `description_sha256` is left out, because it stores the resulting SHA-256.
    """
    values = {name: value for name, value in description.items() if name != DIGEST}
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def check_unaltered(place: Path, content: bytes) -> None:
    """Check that the description of a policy was not changed after it was written.

    PolicyError is raised if the SHA-256 of all other fields differs from the field `description_sha256`. A description
    that has no field `description_sha256` passes the check; older versions of the project did not write it.

    Args:
        place: Folder of the policy bundle, for the error message.
        content: Content of the file `policy.json`.
    """
    values = parse_json(content)
    if values.get(DIGEST) not in (None, description_digest(values)):
        fail(place, f"{DESCRIPTION} is not as it was written ({DIGEST} differs)")


def parse_description(place: Path, content: bytes) -> BundleFields:
    """Parse the file `policy.json` of a policy bundle, and check the fields that need no robot.

    PolicyError is raised if a field is missing, unknown or out of range.

    Args:
        place: Folder of the policy bundle, for the error message.
        content: Content of the file `policy.json`.

    Returns:
        Checked fields of the file.
    """
    try:
        values = parse_json(content)
    except ValueError as error:
        fail(place, f"{DESCRIPTION} is not JSON ({error})")
    if not isinstance(values, dict) or not isinstance(inputs := values.get("inputs", {}), dict):
        fail(place, f"{DESCRIPTION} must hold an object, and so must its inputs")
    for name, supported in _REMOVED_FIELDS.items():
        if (value := values.pop(name, supported)) != supported:
            fail(place, f"its {name} is {value!r:.80}, which this version cannot do; an older one can")
    required = [
        entry.name for entry in fields(BundleFields) if entry.default is MISSING and entry.default_factory is MISSING
    ]
    if missing := [name for name in required if name not in values]:
        fail(place, f"{DESCRIPTION} lacks {', '.join(missing)}")
    inputs = {name: tuple(value) if isinstance(value, list) else value for name, value in inputs.items()}
    try:
        return BundleFields(**values | {"inputs": Inputs(**inputs)})
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
    """Make a trained policy from its description and its network.

    PolicyError is raised if the description does not fit this version of the environment, or does not fit the robot.

    Args:
        place: Folder of the policy bundle, for error messages.
        description: Fields of the file `policy.json`.
        network: Network of the policy.
        robot: Robot of the policy; None for the built-in robot that the description names.
        joint_delay_steps: Delay of the observed joint angles, control steps; used by a model-based base policy.
        actuator: Actuator model of the joints; used by a model-based base policy.

    Returns:
        The trained policy, with the robot and the servo gains of its training.
    """
    robot = _trained_robot(place, description, robot)
    try:
        base = base_from_json(description.base, robot, float(description.control_period), joint_delay_steps, actuator)
        _check_environment(description, robot, base.height_scan)
        authority = np.array(description.authority, dtype=np.float32)
        policy = ResidualPolicy(
            base,
            network,
            authority,
            description.name,
            description.inputs,
            description.hold,
            description.bounded,
        )
        _check_layout(description, policy)
        return policy
    except ValueError as error:
        fail(place, str(error))


def _layout_fields(policy: ResidualPolicy) -> dict[str, Any]:
    """Return the field `network_inputs` with the layout of a policy that observes only some terms; else no field.

    The result is a dictionary field name -> JSON value.
    """
    features = policy.features
    if features.terms is None:
        return {}
    return {"network_inputs": features.terms.describe(features.inputs, policy.control_period)}


def _check_layout(description: BundleFields, policy: ResidualPolicy) -> None:
    """Raise ValueError if the layout of the network inputs in a `description` is not the layout of the `policy`."""
    expected = _layout_fields(policy).get("network_inputs")
    if description.network_inputs != expected:
        raise ValueError(f"network_inputs differs from the layout of this version: {description.network_inputs!r:.80}")


def _check_environment(description: BundleFields, robot: Robot, scan: HeightScan | None) -> None:
    """Raise ValueError if a policy was trained in another environment or on another model of the robot.

    The name of the environment, the joint names, and the layout and the scales of the observation must be the same. If
    the `description` has the SHA-256 of the robot model, the SHA-256 must also be the same. `scan` is the height scan
    of the base policy.
    """
    for name, expected in _environment_fields(robot, scan).items():
        if (actual := getattr(description, name)) != expected:
            raise ValueError(f"{name} differs from that of this {ENV_ID} with {robot.name}: {actual!r:.80}")
    if description.model_sha256 not in (None, robot.sha256):
        raise ValueError(f"it was trained on another model of {robot.name} than the one that is here (SHA-256 differs)")


def _trained_robot(folder: Path, description: BundleFields, robot: Robot | None) -> Robot:
    """Return the robot that a policy was trained on, with the servo gains of the training.

    The argument `robot` is used if its name or the SHA-256 of its model is the one in the `description`. Otherwise the
    built-in robot with the name in the description is used. A description that was written before version 0.3 has no
    servo gains; the robot then gets the gains `Robot.stiff_servo`.

    Raises PolicyError if there is no built-in robot with the name in the description, or if the servo gains are not
    valid.
    """
    name = description.robot
    trained_on = description.model_sha256
    if trained_on is None and name == SIMPLE_QUAD.name:
        trained_on = SIMPLE_QUAD.sha256
    if robot is None or (name != robot.name and trained_on != robot.sha256):
        robot = _robot_by_name(folder, name)
    try:
        stiffness, damping = robot.stiff_servo if description.servo is None else description.servo
        return robot.with_servo(stiffness, damping)
    except (TypeError, ValueError):
        fail(folder, f"servo must be stiffness and damping of {robot.num_joints} joints, above 0")


def _robot_by_name(folder: Path, name: str) -> Robot:
    """Return the built-in robot called `name`. Raises PolicyError if no robot has this name."""
    if name not in ROBOTS:
        fail(folder, f"it is for a robot {name!r}, which is none of {', '.join(ROBOTS)}: say which with --robot")
    try:
        return ROBOTS[name]
    except ModuleNotFoundError as error:
        fail(folder, str(error))


def build_network(folder: Path, shape: Any, tensors: Mapping[str, NDArray[Any]]) -> Network:
    """Build the network of a policy bundle from its stored weights and biases.

    PolicyError is raised if the shapes of the arrays do not fit each other or the description.

    Args:
        folder: Folder of the policy bundle, for the error message.
        shape: Field `network` of the description: layer widths and name of the activation function.
        tensors: Tensor name, for example "0.weight" -> weights or biases of a layer.

    Returns:
        Network with the weights and biases in `tensors`.
    """
    count = len(tensors) // 2
    try:
        weights, biases = (tuple(tensors[f"{i}.{kind}"] for i in range(count)) for kind in ("weight", "bias"))
        network = Network(weights, biases)
    except (IndexError, KeyError, ValueError) as error:
        fail(folder, f"the tensors in {WEIGHTS} make no network ({error})")
    if len(tensors) % 2 or shape != {"sizes": list(network.sizes), "activation": ACTIVATION}:
        fail(folder, f"the tensors in {WEIGHTS} are not of the network, {shape!r:.80}, that {DESCRIPTION} describes")
    if not all(np.abs(value).max(initial=0.0) <= _MAX_WEIGHT for value in tensors.values()):  # False for NaN
        fail(folder, f"weights must be finite and lie within ±{_MAX_WEIGHT:g}")
    return network


def _environment_fields(robot: Robot, scan: HeightScan | None) -> dict[str, Any]:
    """Return the fields of `policy.json` that identify the environment in which the policy was trained.

    The result is a dictionary field name -> JSON value. The fields are the name of the environment, the joint names,
    the columns of the observation (term name -> [start, stop]) and its scales.
    """
    table = table_with(robot, scan)
    return {
        "env_id": ENV_ID,
        "joints": list(robot.joint_names),
        "observation": {name: [part.start, part.stop] for name, part in table.slices.items()},
        "observation_scale": table.scale.tolist(),
    }


def fail(folder: Path, reason: str) -> NoReturn:
    """Raise PolicyError because the policy in a folder cannot be loaded.

    Args:
        folder: Folder of the policy bundle.
        reason: Reason for the error message, one line.

    Raises:
        PolicyError: Always.
    """
    raise PolicyError(f"cannot load the policy in {folder}: {reason}", "train it again, or fetch a complete copy")
