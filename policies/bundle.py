"""Policy bundle: folder with a trained policy, in two files that contain data and no code.

The file `policy.safetensors` has the weights of the network. The file `policy.json`, the description, has all other
data of the policy. `load` checks every field, and compares the SHA-256 of both files with the stored SHA-256.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load as parse_safetensors
from safetensors.numpy import save as format_safetensors

from policies.base import PolicyError
from policies.description import DESCRIPTION as DESCRIPTION
from policies.description import WEIGHTS as WEIGHTS
from policies.description import (
    assemble_policy,
    build_network,
    check_unaltered,
    describe_policy,
    fail,
    parse_description,
)
from policies.network import Network
from policies.residual import ResidualPolicy
from policies.servo_option import check_servo, with_servo_option
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.files.reading import max_network_size, read_bytes
from quad_env.files.writing import write_atomically
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot

BEST = "best"
"""Name of the subfolder of a training run that has the policy bundle with the best validation result."""
MAX_DESCRIPTION_SIZE = 2**22
"""Largest accepted size of a file `policy.json`, bytes. The files of this project have about 20 000 bytes."""


def save(path: str | Path, policy: ResidualPolicy, training: Mapping[str, Any], git_revision: str) -> None:
    """Write a trained policy as a policy bundle, a folder with two files.

    Each file is written completely or not at all. OSError is raised if the folder is not writable.

    Args:
        path: Folder of the bundle. The function makes the folder if it does not exist.
        policy: Trained policy.
        training: All settings of the training: name -> JSON value.
        git_revision: Git revision of the code that trained the policy.
    """
    folder = Path(path)
    folder.mkdir(parents=True, exist_ok=True)
    weights = format_safetensors(network_tensors(policy.network))
    sha256 = hashlib.sha256(weights).hexdigest()
    text = json.dumps(describe_policy(policy, training, git_revision, sha256), indent=2, allow_nan=False) + "\n"
    write_atomically(folder / WEIGHTS, weights)
    write_atomically(folder / DESCRIPTION, text.encode())


def copy(folder: Path, to: Path) -> None:
    """Copy a policy bundle to another folder: first `policy.safetensors`, then `policy.json`.

    Raises OSError if a file cannot be read or written.

    Args:
        folder: Folder of the bundle.
        to: Folder of the copy. The function makes the folder if it does not exist.
    """
    to.mkdir(parents=True, exist_ok=True)
    for name in (WEIGHTS, DESCRIPTION):
        write_atomically(to / name, (folder / name).read_bytes())


def load(
    path: str | Path,
    robot: str | Robot | None = None,
    *,
    joint_delay_steps: int = 0,
    actuator: Actuator = IDEAL,
    servo: Any = None,
) -> ResidualPolicy:
    """Load the trained policy in a policy bundle.

    The policy commands the servo gains that it was trained with. Raises PolicyError if a file is missing or damaged, or
    does not fit this version of the project. Raises PolicyError also if the bundle does not fit the argument `robot` or
    its servo gains.

    Args:
        path: Folder of a policy bundle or of a training run. For a training run, the bundle with the best validation
            result is loaded.
        robot: Robot of the policy, or its name. None for the robot that the bundle names; this robot must be one of
            `quad_env.ROBOTS`.
        joint_delay_steps: Delay of the observed joint angles, control steps; used by a model-based base policy.
        actuator: Actuator model of the joints; used by a model-based base policy.
        servo: Servo gains that `robot` must have, as in `policies.make`. "own" accepts the servo gains of the training
            for every robot.

    Returns:
        The trained policy.
    """
    folder = find_bundle_folder(Path(path))
    robot = None if robot is None else with_servo_option(get_robot(robot), servo)
    content = _read(folder / DESCRIPTION, MAX_DESCRIPTION_SIZE)
    description = parse_description(folder, content)
    weights = _read(folder / WEIGHTS, max_network_size())
    if hashlib.sha256(weights).hexdigest() != description.weights_sha256:
        fail(folder, f"{WEIGHTS} is not the file that {DESCRIPTION} was written with (SHA-256 differs)")
    network = build_network(folder, description.network, _parse_weights(folder, weights))
    policy = assemble_policy(folder, description, network, robot, joint_delay_steps, actuator)
    check_unaltered(folder, content)
    if robot is not None:
        check_servo(policy, robot, servo)
    return policy


def find_bundle_folder(folder: Path) -> Path:
    """Return the path of the policy bundle in a `folder`: the folder itself, or its subfolder `best`.

    The subfolder is used if the folder is a training run. Raises PolicyError if there is no policy bundle.
    """
    if (folder / DESCRIPTION).exists():
        return folder
    if (folder / BEST).is_dir():
        return folder / BEST
    if (folder / "config.json").exists():
        raise PolicyError(f"the training run in {folder} has no policy yet: it writes {BEST}/ at its first validation")
    raise PolicyError(
        f"no {DESCRIPTION} in {folder}",
        "name the folder of a trained policy, such as models/residual, or of a training run",
    )


def _read(file: Path, limit: int) -> bytes:
    """Return the content of a `file` of a policy bundle.

    Raises PolicyError if the file cannot be read, for example because it has more than `limit` bytes.
    """
    try:
        return read_bytes(file, limit)
    except OSError as error:
        fail(file.parent, f"{file.name} cannot be read ({error.strerror})")


def _parse_weights(folder: Path, weights: bytes) -> dict[str, NDArray[Any]]:
    """Convert the content of a safetensors file to a dictionary tensor name -> array.

    Raises PolicyError, with the `folder` of the policy bundle in the message, if the content is not valid.
    """
    try:
        return dict(parse_safetensors(weights))
    except (SafetensorError, ValueError, KeyError, TypeError, AttributeError, OverflowError):
        fail(folder, f"{WEIGHTS} is not a safetensors file of plain numbers")


def network_tensors(network: Network) -> dict[str, NDArray[Any]]:
    """Return the weights and biases of a network, as they are stored in a policy bundle.

    The result is a dictionary tensor name -> array. The names are `0.weight` and `0.bias` for the first layer.
    """
    weights = {f"{i}.weight": np.ascontiguousarray(w) for i, w in enumerate(network.weights)}
    return weights | {f"{i}.bias": np.ascontiguousarray(b) for i, b in enumerate(network.biases)}
