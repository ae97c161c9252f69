"""Networks of external policies, ONNX or TorchScript: file kinds, loading, and recurrent states.

Here the memory of a network is its recurrent state. The network computes one robot's action per call, because a matrix
product of several rows rounds each row differently, by 1e-7. The previous actions in the observation would amplify this
difference. With one row per call, a robot's actions have the same bits in every batch and in the policy's own project.

Kinds of files:
- TorchScript files (`torch.jit.save`) are zip archives with `constants.pkl`.
- Checkpoints (`torch.save`) are zip archives without `constants.pkl`; older checkpoints are pickles.
- Models of Stable-Baselines3 are zip archives with `policy.pth`.
- Checkpoints of rsl_rl, `model_*.pt`, hold `model_state_dict` or `actor_state_dict` (`runners/on_policy_runner.py`).
"""

import copy
import re
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from policies.base import Mask, PolicyError
from policies.external.act_function import ActFunction
from policies.external.onnx_network import find_roles, make_network_factory, open_session
from policies.external.packages import import_package
from policies.external.spec import PolicySpec
from policies.memory import PerRobotState
from quad_env.columns import EnvIndices
from quad_env.files.text import format_exception

Weights = NDArray[np.float32]
NetworkKind = Literal["onnx", "torchscript", "checkpoint", "stable-baselines3", "zip"]
MAX_REASON = 300
"""Maximum number of characters that an error quotes from a library's message."""
TORCHSCRIPT_SUFFIXES = ".pt", ".jit"
"""Suffixes of files that are read as TorchScript if their content does not identify their kind."""
IR_VERSION_TAG = b"\x08"
"""First byte of ONNX files: the tag of `ModelProto.ir_version`."""
_LEARNERS = {
    b"actor_state_dict": "rsl_rl",
    b"model_state_dict": "rsl_rl",
    b"running_mean_std": "rl_games",
    b"state_preprocessor": "skrl",
}
"""Key in a checkpoint -> learning library that writes it."""
_SCANNED_BYTES = 2**20
"""Size of the part of a checkpoint's pickle that is searched for the keys of `_LEARNERS`, bytes."""


def detect_kind(file: Path) -> NetworkKind:
    """Return the kind of a network's file; `onnx` if no mark of another kind is found. Raises OSError."""
    with file.open("rb") as stream:
        start = stream.read(4)
    if start[:1] == b"\x80" and start[1:2] in (b"\x02", b"\x03", b"\x04", b"\x05"):
        return "checkpoint"
    if start != b"PK\x03\x04":
        return "torchscript" if file.suffix.lower() in TORCHSCRIPT_SUFFIXES and start[:1] != IR_VERSION_TAG else "onnx"
    try:
        with zipfile.ZipFile(file) as archive:
            names = [Path(name).name for name in archive.namelist()]
    except (zipfile.BadZipFile, ValueError, NotImplementedError):
        return "torchscript" if file.suffix.lower() in TORCHSCRIPT_SUFFIXES else "zip"
    if "constants.pkl" in names:
        return "torchscript"
    if "policy.pth" in names:
        return "stable-baselines3"
    return "checkpoint" if "data.pkl" in names else "zip"


def is_onnx(file: Path) -> bool:
    """Return True if a network's file is read as ONNX, or cannot be read."""
    try:
        return detect_kind(file) == "onnx"
    except OSError:
        return True


def check_is_network(file: Path) -> None:
    """Raise PolicyError, which names the kind of the file, unless the file is ONNX or TorchScript."""
    try:
        kind = detect_kind(file)
    except OSError as error:
        raise PolicyError(f"cannot read {file} ({error.strerror})") from None
    if kind == "checkpoint":
        raise PolicyError(
            f"{file} is a checkpoint{_learner_of(file)}, not TorchScript",
            "a checkpoint holds weights alone: export the network as .onnx or TorchScript, as the play script of the "
            "learner does (exported/policy.onnx)",
        )
    if kind == "stable-baselines3":
        raise PolicyError(f"{file} is a model of Stable-Baselines3, not a network", "name it as a .zip, with --trust")
    if kind == "zip":
        raise PolicyError(
            f"{file} is a zip archive without a network", "export the network as .onnx or TorchScript .pt"
        )


def _learner_of(file: Path) -> str:
    """Return " of NAME" with the learning library that wrote a checkpoint; an empty text if it is unknown.

    The file is searched for known keys and is not unpickled, so that none of its code runs.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            member = next(name for name in archive.namelist() if Path(name).name == "data.pkl")
            with archive.open(member) as stream:
                content = stream.read(_SCANNED_BYTES)
    except (zipfile.BadZipFile, StopIteration, OSError, ValueError, NotImplementedError, RuntimeError):
        with file.open("rb") as stream:
            content = stream.read(_SCANNED_BYTES)
    return next((f" of {learner}" for key, learner in _LEARNERS.items() if key in content), "")


class BatchedNetwork(PerRobotState):
    """Network for n robots, with one recurrent state per robot; `load_network` makes it.

    Args:
        make: Makes a function from one observation to one action, with an initial recurrent state.
        has_memory: True for a recurrent network; then each robot has its own function.
    """

    def __init__(self, make: Callable[[], ActFunction], has_memory: bool) -> None:
        self._make = make
        self.has_memory = has_memory
        self.reset(1)

    def reset(self, num_envs: int) -> None:
        """Allocate and reset the recurrent states of `num_envs` robots."""
        self._acts = [self._make() for _ in range(num_envs)] if self.has_memory else [self._make()] * num_envs

    def reset_where(self, mask: Mask) -> None:
        """Reset the recurrent states of the robots for which `mask`, (n,), is True."""
        for robot in np.flatnonzero(mask).tolist() if self.has_memory else ():
            self._acts[robot] = self._make()

    def compute_actions(self, observations: Weights, env_ids: EnvIndices) -> NDArray[Any]:
        """Return the actions of some robots.

        Args:
            observations: Policy observations of the robots in `env_ids`, (m, width).
            env_ids: Indices of the robots, (m,).

        Returns:
            Actions of the network, (m, 12).
        """
        pairs = zip(observations, env_ids.tolist(), strict=True)
        return np.array([np.ravel(self._acts[robot](row)) for row, robot in pairs])


def load_network(spec: PolicySpec) -> BatchedNetwork:
    """Load the network of a specification.

    The network is called three times, to check it and to detect a recurrent state.

    Loading a TorchScript network restricts PyTorch to one thread in this process.

    Args:
        spec: Specification of the policy.

    Returns:
        Network, allocated for one robot.

    Raises:
        PolicyError: The file is not a network, or the network's inputs or outputs contradict the specification.
    """
    make, has_memory = (_load_onnx if is_onnx(spec.network) else _load_torchscript)(spec)
    row = np.random.default_rng(0).standard_normal(spec.width).astype(np.float32)
    try:
        act = make()
        action, *repeated = (np.array(act(row)) for _ in range(3))
    except Exception as error:
        _raise_call_error(spec, error)
    num_joints = len(spec.joints)
    if action.size != num_joints or action.dtype.kind != "f":
        output = f"gives {action.size} numbers of type {action.dtype}"
        raise PolicyError(f"{spec.network} {output} for the {num_joints} joints of its description")
    return BatchedNetwork(make, has_memory or any(action.tobytes() != each.tobytes() for each in repeated))


def _raise_call_error(spec: PolicySpec, error: Exception) -> NoReturn:
    """Raise PolicyError for a failed call; it gives the expected width if the library's message has it."""
    if match := re.search(r"and (\d+)x\d+\)|Expected (\d+), got|mat \(\d+x(\d+)\)", str(error)):
        raise _width_error(spec, int(next(filter(None, match.groups())))) from None
    reason = format_exception(error).rpartition("RuntimeError: ")[2]
    raise PolicyError(f"{spec.network} fails: {reason[:MAX_REASON]}") from None


def _width_error(spec: PolicySpec, expected: int) -> PolicyError:
    """Return the error for a network that expects `expected` numbers per observation."""
    parts = []
    for term in spec.terms:
        history = f" x {term.history}" if term.history > 1 else ""
        parts.append(f"{term.name} {term.width}{history}")
    fault = f"{spec.network} reads {expected} numbers and its description gives {spec.width}: {' + '.join(parts)}"
    return PolicyError(fault, "correct the terms")


def _load_onnx(spec: PolicySpec) -> tuple[Callable[[], ActFunction], bool]:
    """Return the factory of an ONNX network, and True if the network is recurrent."""
    session = open_session(spec.network)
    factory = make_network_factory(session, spec.network)
    width = find_roles(session.get_inputs(), session.get_outputs(), spec.network).observation.shape[-1]
    if isinstance(width, int) and width != spec.width:
        raise _width_error(spec, width)
    return factory


def _load_torchscript(spec: PolicySpec) -> tuple[Callable[[], ActFunction], bool]:
    """Return the factory of a TorchScript network, and True if the network is recurrent.

    A network counts as recurrent if it has a method `reset`.
    """
    file = spec.network
    check_is_network(file)
    torch = import_package("torch", "train")
    torch.set_num_threads(1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            module = torch.jit.load(file, map_location="cpu").eval()
    except Exception as error:
        fault = f"{file} is not TorchScript ({format_exception(error)[:MAX_REASON]})"
        raise PolicyError(fault, "export the network with torch.jit.save; a checkpoint holds weights alone") from None
    dtype = next((parameter.dtype for parameter in module.parameters()), torch.float32)

    def make() -> ActFunction:
        network = copy.deepcopy(module)

        def act(row: Weights) -> Any:
            # The row is copied because the bits of the result depend on the memory address of the row.
            # Optimisation is off because the optimised calls would give other bits than the first calls.
            with torch.inference_mode(), torch.jit.optimized_execution(False):
                output = network(torch.from_numpy(row[None]).to(dtype, copy=True))
            return (output[0] if isinstance(output, tuple | list) else output).numpy()

        return act

    return make, hasattr(module, "reset")
