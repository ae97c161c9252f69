"""What the figures were made with."""

import ctypes
import hashlib
import platform
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import metadata
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from evaluate.causes.rules import CAUSE_RULE
from evaluate.hardware import HardwareConfig
from evaluate.measures.effort import ENERGY_RULE
from evaluate.measures.outcomes import SUCCESS_RULE
from policies.base import Policy
from quad_env.config import FallRule

REPOSITORY = Path(__file__).resolve().parents[2]
SOURCES = ("quad_env", "policies", "evaluate")
"""Packages that the figures depend on."""
RULES = {"success_rule": SUCCESS_RULE, "energy_rule": ENERGY_RULE, "cause_rule": CAUSE_RULE}
"""Versions with which alone results can be read."""
DIGEST = "2-"
"""Start of every policy's digest: by which rule it was made."""
_KINDS = {".py", ".xml", ".json"}


def versions() -> dict[str, str | None]:
    """Versions of what the figures depend on, and the git revision, None outside a repository."""
    return {
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        **{name: metadata.version(name) for name in ("mujoco", "numpy", "scipy", "gymnasium", "pyarrow")},
        "blas": blas(),
        "simd": " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", ())),
        "libc": " ".join(platform.libc_ver()).strip(),
        "quad_env": _version_of("simple-quad"),
        "fall_rule": FallRule().name,
        **RULES,
        "git_revision": git_revision(REPOSITORY),
    }


def blas() -> str:
    """NumPy's BLAS, and of OpenBLAS the kernel for this processor, which `OPENBLAS_CORETYPE` replaces."""
    found = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    return " ".join((found["name"], found["version"], *sorted(_kernels())))


def _kernels() -> set[str]:
    """Kernels of the OpenBLAS libraries of this process; none where the system does not list a process's libraries."""
    try:
        lines = Path("/proc/self/maps").read_text(encoding="utf-8").splitlines()
    except OSError:
        return set()
    kernels = set()
    for library in map(ctypes.CDLL, {line.split()[-1] for line in lines if "openblas" in line}):
        for name in ("scipy_openblas_get_corename64_", "openblas_get_corename64_", "openblas_get_corename"):
            if kernel := getattr(library, name, None):
                kernel.restype = ctypes.c_char_p
                kernels.add(kernel().decode())
    return kernels


def model_of(hardware: HardwareConfig) -> dict[str, str]:
    """The SHA-256 of the robot's model, where it is none of the code's, and the version of an unusual simulator."""
    robot = {} if hardware.robot == HardwareConfig.robot else {"robot": hardware.robot_model.sha256}
    usual = hardware.simulator == HardwareConfig.simulator
    return robot if usual else robot | {hardware.simulator: metadata.version(hardware.simulator)}


def git_revision(folder: Path) -> str | None:
    """The commit of a checkout, with `-dirty` if tracked files differ from it; None if there is none."""
    revision = _git(folder, "rev-parse", "HEAD")
    if revision is None:
        return None
    return f"{revision}-dirty" if _git(folder, "status", "--porcelain", "--untracked-files=no") else revision


def cpu_model() -> str:
    """What the processor calls itself: another one may round the last bit of a function differently."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()


@cache
def code_digest() -> str:
    """SHA-256 of the packages that the figures depend on, names and contents: a commit may change nothing of them."""
    digest = hashlib.sha256()
    for path in (path for package in SOURCES for path in sorted((REPOSITORY / package).rglob("*"))):
        if path.suffix not in _KINDS:
            continue
        content = path.read_bytes()
        digest.update(f"{path.relative_to(REPOSITORY).as_posix()} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def policy_digest(*policies: Policy) -> str:
    """SHA-256 of what defines fresh policies: their kinds, and all that they hold, such as parameters and weights."""
    digest = hashlib.sha256()
    for piece in chain.from_iterable(_pieces(policy, ()) for policy in policies):
        digest.update(piece + b"\n")
    return DIGEST + digest.hexdigest()


def _pieces(value: Any, within: tuple[int, ...]) -> Iterator[bytes]:
    """What a value consists of, in an order of its own; of what is neither data nor made of it, the type alone."""
    kind = type(value).__qualname__  # not its module: policies keep their digests when files move
    if isinstance(value, np.ndarray) and value.dtype == object:
        yield from _pieces(value.tolist(), within)  # its bytes are the addresses of its entries
    elif isinstance(value, np.ndarray | np.generic):
        yield f"{value.dtype} {value.shape}".encode() + value.tobytes()
    elif value is None or isinstance(value, bool | int | float | str | bytes):
        yield f"{kind} {value!r}".encode()
    elif isinstance(value, Path):
        yield value.name.encode()  # a file of the packages, whose contents are in the code's digest
    elif callable(value) and hasattr(value, "__qualname__"):
        yield value.__qualname__.encode()
    elif id(value) in within:
        yield b"itself"
    else:
        contents = _contents(value)
        yield f"{kind} of {len(contents)}".encode()
        for name, entry in contents:
            yield repr(name).encode()
            yield from _pieces(entry, (*within, id(value)))


def _contents(value: Any) -> list[tuple[Any, Any]]:
    """Names, keys or places, and what is there."""
    if isinstance(value, Mapping):
        return sorted(value.items(), key=lambda item: repr(item[0]))
    if isinstance(value, list | tuple):
        return list(enumerate(value))
    if is_dataclass(value):  # which may cache values outside its fields
        return sorted((field.name, getattr(value, field.name)) for field in fields(value))
    slots = {name: getattr(value, name) for name in getattr(type(value), "__slots__", ()) if hasattr(value, name)}
    return sorted((slots | getattr(value, "__dict__", {})).items())


def _git(folder: Path, *arguments: str) -> str | None:
    try:
        command = ["git", "-C", str(folder), *arguments]
        finished = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return finished.stdout.strip() if finished.returncode == 0 else None


def _version_of(distribution: str) -> str | None:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None
