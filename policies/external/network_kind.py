"""Kinds of network files by their content, for every ending of their names.

Sources: TorchScript (`torch.jit.save`) and checkpoints (`torch.save`) are zip archives; only the first have
`constants.pkl`. Older checkpoints are pickles. Models of Stable-Baselines3 are zip archives with `policy.pth`. rsl_rl's
checkpoints `model_*.pt` hold `model_state_dict` or `actor_state_dict` (`runners/on_policy_runner.py`).
"""

import zipfile
from pathlib import Path
from typing import Literal

from policies.base import PolicyError

NetworkKind = Literal["onnx", "torchscript", "checkpoint", "stable-baselines3", "zip"]
TORCHSCRIPT_SUFFIXES = ".pt", ".jit"
"""Endings of files that count as TorchScript if their content does not identify them."""
IR_VERSION = b"\x08"
"""First byte of ONNX files: the tag of `ModelProto.ir_version`."""
_LEARNERS = {
    b"actor_state_dict": "rsl_rl",
    b"model_state_dict": "rsl_rl",
    b"running_mean_std": "rl_games",
    b"state_preprocessor": "skrl",
}
"""Learners by a key of their checkpoints."""
_SCANNED = 2**20
"""Bytes. Size of the part of a checkpoint's pickle that is searched for a key."""


def detect_kind(file: Path) -> NetworkKind:
    """Return the kind of a network's file; `onnx` without a mark of another kind. Raises OSError."""
    with file.open("rb") as stream:
        start = stream.read(4)
    if start[:1] == b"\x80" and start[1:2] in (b"\x02", b"\x03", b"\x04", b"\x05"):
        return "checkpoint"
    if start != b"PK\x03\x04":
        return "torchscript" if file.suffix.lower() in TORCHSCRIPT_SUFFIXES and start[:1] != IR_VERSION else "onnx"
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
    """Return whether a network's file is to be read as ONNX; True also for an unreadable one."""
    try:
        return detect_kind(file) == "onnx"
    except OSError:
        return True


def check_is_network(file: Path) -> None:
    """Raise PolicyError with the kind of the file unless it is ONNX or TorchScript."""
    try:
        kind = detect_kind(file)
    except OSError as error:
        raise PolicyError(f"cannot read {file} ({error.strerror})") from None
    if kind == "checkpoint":
        raise PolicyError(
            f"{file} is no TorchScript but a checkpoint{_learner_of(file)}",
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
    """Return the learner that writes a checkpoint of this kind, in words; nothing is unpickled."""
    try:
        with zipfile.ZipFile(file) as archive:
            member = next(name for name in archive.namelist() if Path(name).name == "data.pkl")
            with archive.open(member) as stream:
                content = stream.read(_SCANNED)
    except (zipfile.BadZipFile, StopIteration, OSError, ValueError, NotImplementedError, RuntimeError):
        with file.open("rb") as stream:
            content = stream.read(_SCANNED)
    return next((f" of {learner}" for key, learner in _LEARNERS.items() if key in content), "")
