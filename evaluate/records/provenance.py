"""Provenance of results: versions, processor, and SHA-256 digests of code, policies and robot model."""

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
"""Names of the packages of this project that the results depend on."""
RULES = {"success_rule": SUCCESS_RULE, "energy_rule": ENERGY_RULE, "cause_rule": CAUSE_RULE}
"""Name of a rule -> its version; results of another version cannot be read."""
DIGEST = "3-"
"""Prefix of the digest of every policy: the version of the algorithm that computes the digest."""
_SOURCE_SUFFIXES = {".py", ".xml", ".json"}
"""Suffixes of the files that enter the digest of the code."""


def versions() -> dict[str, str | None]:
    """Return the versions of everything that the results depend on: name -> version.

    A version is None if it is not known, for example the git revision outside of a repository.
    """
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
    """Return a text that names NumPy's BLAS library, its version and its processor kernels.

    The kernels are those that OpenBLAS has selected, because they affect the last bits of the results. The environment
    variable `OPENBLAS_CORETYPE` overrides the selection.
    """
    library = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    return " ".join((library["name"], library["version"], *sorted(_openblas_kernels())))


def _openblas_kernels() -> set[str]:
    """Return the names of the processor kernels of all OpenBLAS libraries that this process has loaded.

    The set is empty if the libraries cannot be listed.
    """
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
    """Return the versions of robot and simulator, as far as they are not the default.

    The dictionary maps the name of the simulator to its version, and `robot` to the SHA-256 of its model.
    """
    versions = {}
    if hardware.robot != HardwareConfig.robot:
        versions["robot"] = hardware.robot_model.sha256
    if hardware.simulator != HardwareConfig.simulator:
        versions[hardware.simulator] = metadata.version(hardware.simulator)
    return versions


def git_revision(folder: Path) -> str | None:
    """Return the commit of a git repository, with `-dirty` appended if tracked files differ from it.

    The result is None if `folder` is not in a repository.
    """
    revision = _git(folder, "rev-parse", "HEAD")
    if revision is None:
        return None
    return f"{revision}-dirty" if _git(folder, "status", "--porcelain", "--untracked-files=no") else revision


def cpu_model() -> str:
    """Return the name of the processor.

    Results depend on the processor, because processors can round the last bit of a function differently.
    """
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()


@cache
def code_digest() -> str:
    """Return the SHA-256 of the code of the packages in SOURCES: Python statements and data files.

    Comments, docstrings and the layout of Python files do not count, because no result depends on them.
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
    """Return the syntax tree of Python `source` as text without docstrings.

    Source that is not valid Python is returned unchanged.
    """
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):
        return source
    words: list[str] = []
    _add_syntax(tree, words.append)
    return " ".join(words).encode()


def _add_syntax(node: ast.AST, add: Callable[[str], None]) -> None:
    """Add the text of a syntax tree to a hash, without docstrings.

    Absent and empty fields are left out. The text therefore does not depend on the Python version, unlike `ast.dump`.

    Args:
        node: Root of the syntax tree.
        add: Function that receives the parts of the text one after the other.
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
    """Return True if a syntax node is a docstring of a module, class, function or attribute.

    Every statement that consists of a string counts as a docstring.
    """
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def policy_digest(*policies: Policy) -> str:
    """Return the SHA-256 of `policies` that have not run yet: their classes and all attributes.

    The attributes include parameters and network weights.
    """
    digest = hashlib.sha256()
    for piece in chain.from_iterable(_pieces(policy, ()) for policy in policies):
        digest.update(piece + b"\n")
    return DIGEST + digest.hexdigest()


def _pieces(value: Any, ancestors: tuple[int, ...]) -> Iterator[bytes]:
    """Yield the class and the contents of an object in a fixed order, as text to hash.

    Args:
        value: A policy, or an attribute of it at any depth.
        ancestors: `id` of each object that contains the object, to detect an object that contains itself.

    Yields:
        Parts of the text. They contain no module names, so a policy keeps its digest when its source file moves.
    """
    kind = type(value).__qualname__
    if isinstance(value, np.ndarray) and value.dtype == object:
        yield from _pieces(value.tolist(), ancestors)  # because the bytes of an object array are addresses
    elif isinstance(value, np.ndarray | np.generic):
        yield f"{value.dtype} {value.shape}".encode() + value.tobytes()
    elif value is None or isinstance(value, bool | int | float | str | bytes):
        yield f"{kind} {value!r}".encode()
    elif isinstance(value, Path):
        yield value.name.encode()  # only the name, because the code digest contains the file's contents
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
    """Return the contents of an object as pairs: attribute name, dictionary key or list index, and value."""
    if isinstance(value, Mapping):
        return sorted(value.items(), key=lambda item: repr(item[0]))
    if isinstance(value, list | tuple):
        return list(enumerate(value))
    if is_dataclass(value):  # only fields, because other attributes of a dataclass may be caches
        return sorted((field.name, getattr(value, field.name)) for field in fields(value))
    slots = {name: getattr(value, name) for name in getattr(type(value), "__slots__", ()) if hasattr(value, name)}
    return sorted((slots | getattr(value, "__dict__", {})).items())


def _git(folder: Path, *arguments: str) -> str | None:
    """Run a git command in a folder, and return its output.

    Args:
        folder: Folder in which the command runs.
        *arguments: Arguments of git.

    Returns:
        The output, stripped; None if the command fails.
    """
    command = ["git", "-C", str(folder), *arguments]
    try:
        finished = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return finished.stdout.strip() if finished.returncode == 0 else None


def _version_of(distribution: str) -> str | None:
    """Return the version of the installed Python `distribution`; None if it is not installed."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None
