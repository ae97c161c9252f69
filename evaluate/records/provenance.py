"""Provenance of results: versions, processor, and digests of code, policies and robot model."""

import ast
import ctypes
import hashlib
import platform
import subprocess
from collections.abc import Callable, Iterator, Mapping
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
"""Packages that the results depend on."""
RULES = {"success_rule": SUCCESS_RULE, "energy_rule": ENERGY_RULE, "cause_rule": CAUSE_RULE}
"""Versions of the rules; results by other rules cannot be read."""
DIGEST = "3-"
"""Prefix of every policy digest: the version of the digest's rule."""
_SOURCE_SUFFIXES = {".py", ".xml", ".json"}
"""Suffixes of the files that the code's digest includes."""


def versions() -> dict[str, str | None]:
    """Return the versions that the results depend on, and the git revision (None without git)."""
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
    """Return NumPy's BLAS with the processor kernel of OpenBLAS, which `OPENBLAS_CORETYPE` overrides."""
    library = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    return " ".join((library["name"], library["version"], *sorted(_openblas_kernels())))


def _openblas_kernels() -> set[str]:
    """Return the kernels of this process's OpenBLAS libraries; empty if they cannot be listed."""
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


def hardware_versions(hardware: HardwareConfig) -> dict[str, str]:
    """Return the SHA-256 of a robot and the version of a simulator that are not the default."""
    versions = {}
    if hardware.robot != HardwareConfig.robot:
        versions["robot"] = hardware.robot_model.sha256
    if hardware.simulator != HardwareConfig.simulator:
        versions[hardware.simulator] = metadata.version(hardware.simulator)
    return versions


def git_revision(folder: Path) -> str | None:
    """Return a checkout's commit, with `-dirty` if tracked files differ; None without a repository."""
    revision = _git(folder, "rev-parse", "HEAD")
    if revision is None:
        return None
    return f"{revision}-dirty" if _git(folder, "status", "--porcelain", "--untracked-files=no") else revision


def cpu_model() -> str:
    """Return the processor's name; another processor may round the last bit of a function differently."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()


@cache
def code_digest() -> str:
    """Return the SHA-256 of the packages that the results depend on: file names, statements and data.

    Comments, docstrings and the layout of Python files do not count, since no result depends on them.
    """
    digest = hashlib.sha256()
    for path in (path for package in SOURCES for path in sorted((REPOSITORY / package).rglob("*"))):
        if path.suffix not in _SOURCE_SUFFIXES:
            continue
        content = path.read_bytes()
        if path.suffix == ".py":
            content = _statements(content)
        digest.update(f"{path.relative_to(REPOSITORY).as_posix()} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def _statements(source: bytes) -> bytes:
    """Return the syntax tree of Python source as text without docstrings, or invalid source as it is."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):
        return source
    words: list[str] = []
    _add_syntax(tree, words.append)
    return " ".join(words).encode()


def _add_syntax(node: ast.AST, add: Callable[[str], None]) -> None:
    """Add a node, its fields and its children, without texts that are statements: docstrings.

    Absent and empty fields are left out, so that the text does not depend on the Python version as `ast.dump` does.
    """
    add(type(node).__name__)
    for name in node._fields:
        value = getattr(node, name, None)
        if isinstance(value, ast.AST):
            add(name)
            _add_syntax(value, add)
        elif isinstance(value, list):
            entries = [entry for entry in value if not _is_docstring(entry)]
            if entries:
                add(f"{name}[{len(entries)}]")
            for entry in entries:
                if isinstance(entry, ast.AST):
                    _add_syntax(entry, add)
                else:
                    add(repr(entry))
        elif value is not None:
            add(f"{name}={value!r}")


def _is_docstring(node: Any) -> bool:
    """Return True for a statement that is a text, of a module, class, function or attribute."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def policy_digest(*policies: Policy) -> str:
    """Return the SHA-256 of fresh policies: classes and attributes, with parameters and weights."""
    digest = hashlib.sha256()
    for piece in chain.from_iterable(_pieces(policy, ()) for policy in policies):
        digest.update(piece + b"\n")
    return DIGEST + digest.hexdigest()


def _pieces(value: Any, ancestors: tuple[int, ...]) -> Iterator[bytes]:
    """Yield the class and the contents of a value in a fixed order.

    Args:
        value: A policy or a value within it.
        ancestors: `id` of the values that contain it, for references of a value to itself.

    Yields:
        Parts of the text to hash. Modules are not among them, so policies keep their digests when files move.
    """
    kind = type(value).__qualname__
    if isinstance(value, np.ndarray) and value.dtype == object:
        yield from _pieces(value.tolist(), ancestors)  # its bytes are the addresses of its entries
    elif isinstance(value, np.ndarray | np.generic):
        yield f"{value.dtype} {value.shape}".encode() + value.tobytes()
    elif value is None or isinstance(value, bool | int | float | str | bytes):
        yield f"{kind} {value!r}".encode()
    elif isinstance(value, Path):
        yield value.name.encode()  # a file of the packages, whose contents are in the code's digest
    elif callable(value) and hasattr(value, "__qualname__"):
        yield value.__qualname__.encode()
    elif id(value) in ancestors:
        yield b"itself"
    else:
        contents = _contents(value)
        yield f"{kind} of {len(contents)}".encode()
        for name, entry in contents:
            yield repr(name).encode()
            yield from _pieces(entry, (*ancestors, id(value)))


def _contents(value: Any) -> list[tuple[Any, Any]]:
    """Return pairs of name, key or index and the entry."""
    if isinstance(value, Mapping):
        return sorted(value.items(), key=lambda item: repr(item[0]))
    if isinstance(value, list | tuple):
        return list(enumerate(value))
    if is_dataclass(value):  # which may cache values outside its fields
        return sorted((field.name, getattr(value, field.name)) for field in fields(value))
    slots = {name: getattr(value, name) for name in getattr(type(value), "__slots__", ()) if hasattr(value, name)}
    return sorted((slots | getattr(value, "__dict__", {})).items())


def _git(folder: Path, *arguments: str) -> str | None:
    """Return the output of a git command in a folder; None if it fails."""
    command = ["git", "-C", str(folder), *arguments]
    try:
        finished = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return finished.stdout.strip() if finished.returncode == 0 else None


def _version_of(distribution: str) -> str | None:
    """Return the version of an installed distribution; None if it is not installed."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None
