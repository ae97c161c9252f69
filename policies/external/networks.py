"""Networks of external policies, ONNX or TorchScript: file kinds, loading, calls and recurrent states.

The recurrent state of a network is also called its memory. A network computes the action of one robot per call, because
a matrix product of several rows has other rounding errors in each row, of about 1e-7. The previous actions in the
observation would amplify this difference. With one row per call, the actions of a robot have the same bits for every
number of robots, and the same bits as in the project that trained the policy.

Kinds of network files:
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
"""Array of 32-bit floats, for example the observation of a policy."""
NetworkKind = Literal["onnx", "torchscript", "checkpoint", "stable-baselines3", "zip"]
"""Kind of a network file; `zip` is a zip archive that contains no network."""
MAX_REASON = 300
"""Maximum number of characters that an error quotes from the message of PyTorch or ONNX runtime."""
TORCHSCRIPT_SUFFIXES = ".pt", ".jit"
"""Suffixes of files that are read as TorchScript if their content identifies no other kind."""
IR_VERSION_TAG = b"\x08"
"""First byte of ONNX files: the protobuf tag of the field `ModelProto.ir_version`."""
_LEARNERS = {
    b"actor_state_dict": "rsl_rl",
    b"model_state_dict": "rsl_rl",
    b"running_mean_std": "rl_games",
    b"state_preprocessor": "skrl",
}
"""Key in a checkpoint -> name of the learning library that writes checkpoints with this key."""
_SCANNED_BYTES = 2**20
"""Number of bytes at the start of a checkpoint's pickle that are searched for the keys of `_LEARNERS`."""


def detect_kind(file: Path) -> NetworkKind:
    """Return the kind of a network file, detected by its first bytes and by the members of a zip archive.

    The kind is `onnx` if the content fits no other kind. Raises OSError if the file cannot be read.
    """
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
    """Return True if the kind of a network file is `onnx` (`detect_kind`), or if the file cannot be read."""
    try:
        return detect_kind(file) == "onnx"
    except OSError:
        return True


def check_is_network(file: Path) -> None:
    """Raise PolicyError, with the kind of the file, if a network file is neither ONNX nor TorchScript."""
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
    """Return the text ` of NAME` for an error; NAME is the learning library that wrote a checkpoint.

    The text is empty if the library is unknown. The file is searched for the keys of `_LEARNERS` and is not unpickled,
    because unpickling can run hidden code.
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
    """Network of an external policy for n robots, with one recurrent state per robot.

    `load_network` makes it from a specification.

    Args:
        make: Function without arguments. It returns a function from one observation to one action, with an initial
            recurrent state.
        has_memory: True for a recurrent network; then each robot has its own function. Otherwise all robots share one.
    """

    def __init__(self, make: Callable[[], ActFunction], has_memory: bool) -> None:
        self._make = make
        self.has_memory = has_memory
        self.reset(1)

    def reset(self, num_envs: int) -> None:
        """Set the number of robots to `num_envs`, and start each robot with an initial recurrent state."""
        self._acts = [self._make() for _ in range(num_envs)] if self.has_memory else [self._make()] * num_envs

    def reset_where(self, mask: Mask) -> None:
        """Reset the recurrent states of the robots for which `mask`, (n,) bool, is True."""
        for robot in np.flatnonzero(mask).tolist() if self.has_memory else ():
            self._acts[robot] = self._make()

    def compute_actions(self, observations: Weights, env_ids: EnvIndices) -> NDArray[Any]:
        """Call the network for m robots, one call per robot, and update their recurrent states.

        Args:
            observations: Observations of the robots in the form of the policy, (m, width).
            env_ids: Indices of the robots in the batch, (m,).

        Returns:
            Raw outputs of the network, in the policy's joint order, (m, 12).
        """
        pairs = zip(observations, env_ids.tolist(), strict=True)
        return np.array([np.ravel(self._acts[robot](row)) for row, robot in pairs])


def load_network(spec: PolicySpec) -> BatchedNetwork:
    """Load the network that the specification of an external policy names, and test it.

    The network is called three times with the same random observation. The network counts as recurrent if its three
    actions differ. Loading a TorchScript network restricts PyTorch to one thread in this process.

    Args:
        spec: Specification of the policy, with the path of the network's file.

    Returns:
        Network for one robot; its method `reset` sets another number of robots.

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
    """Raise the PolicyError for a network call that failed with the exception `error`.

    The PolicyError states the observation width that the network expects, if the message of `error` contains it.
    """
    if match := re.search(r"and (\d+)x\d+\)|Expected (\d+), got|mat \(\d+x(\d+)\)", str(error)):
        raise _width_error(spec, int(next(filter(None, match.groups())))) from None
    reason = format_exception(error).rpartition("RuntimeError: ")[2]
    raise PolicyError(f"{spec.network} fails: {reason[:MAX_REASON]}") from None


def _width_error(spec: PolicySpec, expected: int) -> PolicyError:
    """Return the error for a network that expects `expected` numbers per observation, not `spec.width`.

    The error lists the observation terms of the specification with their widths.
    """
    parts = []
    for term in spec.terms:
        history = f" x {term.history}" if term.history > 1 else ""
        parts.append(f"{term.name} {term.width}{history}")
    fault = f"{spec.network} reads {expected} numbers and its description gives {spec.width}: {' + '.join(parts)}"
    return PolicyError(fault, "correct the terms")


def _load_onnx(spec: PolicySpec) -> tuple[Callable[[], ActFunction], bool]:
    """Return the factory of an ONNX network's functions, and True if the network is recurrent.

    The factory has no arguments. It returns a function from one observation to one action. Raises PolicyError if the
    width of the network's input differs from the specification.
    """
    session = open_session(spec.network)
    factory = make_network_factory(session, spec.network)
    width = find_roles(session.get_inputs(), session.get_outputs(), spec.network).observation.shape[-1]
    if isinstance(width, int) and width != spec.width:
        raise _width_error(spec, width)
    return factory


def _load_torchscript(spec: PolicySpec) -> tuple[Callable[[], ActFunction], bool]:
    """Return the factory of a TorchScript network's functions, and True if the network is recurrent.

    The factory has no arguments. It returns a function from one observation to one action, which calls its own copy of
    the network. A network counts as recurrent if it has a method `reset`. Raises PolicyError if the file is invalid.
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
            # The observation is copied because the bits of the result depend on its memory address.
            # Optimisation is off because PyTorch optimises later calls, which would change the bits of their results.
            with torch.inference_mode(), torch.jit.optimized_execution(False):
                output = network(torch.from_numpy(row[None]).to(dtype, copy=True))
            return (output[0] if isinstance(output, tuple | list) else output).numpy()

        return act

    return make, hasattr(module, "reset")
