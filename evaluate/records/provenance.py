"""Origin of the results of an evaluation: versions, processor, and hashes of code, policies and robot."""

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
"""Folder that contains the packages of this project: the root of the git repository, if there is one."""
SOURCES = ("quad_env", "policies", "evaluate")
"""Names of the packages of this project on which the results of an evaluation depend."""
RULES = {"success_rule": SUCCESS_RULE, "energy_rule": ENERGY_RULE, "cause_rule": CAUSE_RULE}
"""Versions of the rules for success, energy and causes of failure: name of the rule -> version.

Results that were computed with other versions of these rules cannot be read.
"""
DIGEST = "3-"
"""Prefix of the hash of every policy: the version of the algorithm that computes the hash."""
_SOURCE_SUFFIXES = {".py", ".xml", ".json"}
"""Suffixes of the files that enter the hash of the code: Python modules, robot models and data."""


def versions() -> dict[str, str | None]:
    """Return the versions of all software on which the results of an evaluation depend.

    The result maps the name of a package, rule or library to its version. A version is None if it is not known, for
    example the git revision if this project is not in a git repository.
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
    """Return name, version and kernels of NumPy's library for linear algebra (BLAS) as one text.

    A kernel is the code that OpenBLAS has selected for this processor; it affects the last bits of the results. The
    environment variable `OPENBLAS_CORETYPE` overrides the selection.
    """
    library = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    return " ".join((library["name"], library["version"], *sorted(_openblas_kernels())))


def _openblas_kernels() -> set[str]:
    """Return the names of the processor kernels that the loaded OpenBLAS libraries have selected.

    A kernel is code for one type of processor. The set is empty if the libraries of this process cannot be listed, as
    on systems without the folder /proc.
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
    """Return the versions of the robot and of the simulator in `hardware`, if they are not the default.

    The result maps the name of the simulator to its version, and the key `robot` to the SHA-256 of the robot's model.
    Defaults are left out, because the hash of the code and the version of MuJoCo already describe them.
    """
    versions = {}
    if hardware.robot != HardwareConfig.robot:
        versions["robot"] = hardware.robot_model.sha256
    if hardware.simulator != HardwareConfig.simulator:
        versions[hardware.simulator] = metadata.version(hardware.simulator)
    return versions


def git_revision(folder: Path) -> str | None:
    """Return the hash of the current git commit, with `-dirty` appended if tracked files differ from it.

    Args:
        folder: Folder of a project in the git repository.

    Returns:
        The text; None if the folder is not in a git repository. A folder of installed packages gives None too, because
        it may be in the repository of another project.
    """
    revision = _git(folder, "rev-parse", "HEAD") if (folder / "pyproject.toml").is_file() else None
    if revision is None:
        return None
    return f"{revision}-dirty" if _git(folder, "status", "--porcelain", "--untracked-files=no") else revision


def cpu_model() -> str:
    """Return the name of the processor of this machine.

    The results depend on the processor, because two processors can compute functions with different last bits.
    """
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()


@cache
def code_digest(packages: tuple[str, ...] = SOURCES) -> str:
    """Return the SHA-256 of the code on which the results depend: Python statements and data files.

    Comments, docstrings and the layout of Python files have no influence on the hash, because no result depends on
    them.

    Args:
        packages: Names of the packages of this project that contain the code; by default SOURCES.

    Returns:
        The hash, hexadecimal.
    """
    digest = hashlib.sha256()
    for path in (path for package in packages for path in sorted((REPOSITORY / package).rglob("*"))):
        if path.suffix not in _SOURCE_SUFFIXES:
            continue
        content = path.read_bytes()
        if path.suffix == ".py":
            content = _statements(content)
        digest.update(f"{path.relative_to(REPOSITORY).as_posix()} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def _statements(source: bytes) -> bytes:
    """Convert the text of a Python module to a text of its syntax tree, in which docstrings are left out.

    Args:
        source: Content of the file.

    Returns:
        Text that depends only on the statements; `source` itself if it is not valid Python.
    """
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):
        return source
    words: list[str] = []
    _add_syntax(tree, words.append)
    return " ".join(words).encode()


def _add_syntax(node: ast.AST, add: Callable[[str], None]) -> None:
    """Convert a syntax tree of Python code to words, in which docstrings are left out.

    Absent and empty fields of syntax nodes are left out as well. The words therefore do not depend on the Python
    version. The output of `ast.dump` is not used, because it depends on the Python version.

    Args:
        node: Root of the syntax tree.
        add: Function that is called with each word, one after the other.
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
    """Return True if the syntax node `node` is a docstring of a module, class, function or attribute.

    Every statement that consists only of a string counts as a docstring.
    """
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def policy_digest(*policies: Policy) -> str:
    """Return the SHA-256 of policies: their classes and all of their attributes, such as network weights.

    Args:
        *policies: Policy objects that have not run yet, because attributes change while a policy runs. A policy with
            one label has one object, or a second object for scenarios with the hardware profile.

    Returns:
        The hash as text, after a prefix with the version of the algorithm.
    """
    digest = hashlib.sha256()
    for piece in chain.from_iterable(_pieces(policy, ()) for policy in policies):
        digest.update(piece + b"\n")
    return DIGEST + digest.hexdigest()


def _pieces(value: Any, ancestors: tuple[int, ...]) -> Iterator[bytes]:
    """Convert an object to a sequence of bytes for the hash of a policy: its class and its contents.

    Args:
        value: The policy, or an object that it contains at any depth.
        ancestors: `id` of each object that contains `value`, to detect an object that contains itself.

    Yields:
        Pieces of the bytes in a fixed order. They contain no module names, so a policy keeps its hash if its source
        file is moved.
    """
    kind = type(value).__qualname__
    if isinstance(value, np.ndarray) and value.dtype == object:
        yield from _pieces(value.tolist(), ancestors)  # The bytes of an array of objects would be memory addresses.
    elif isinstance(value, np.ndarray | np.generic):
        yield f"{value.dtype} {value.shape}".encode() + value.tobytes()
    elif value is None or isinstance(value, bool | int | float | str | bytes):
        yield f"{kind} {value!r}".encode()
    elif isinstance(value, Path):
        yield value.name.encode()  # Only the file's name counts, because the hash of the code contains its content.
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
    """Return the contents of an object as pairs of name and value, for the hash of a policy.

    Args:
        value: Dictionary, list, tuple, dataclass or any other object with attributes.

    Returns:
        Pairs in a fixed order. The name is a dictionary key, a list index or the name of an attribute.
    """
    if isinstance(value, Mapping):
        return sorted(value.items(), key=lambda item: repr(item[0]))
    if isinstance(value, list | tuple):
        return list(enumerate(value))
    if is_dataclass(value):  # Only fields count, because other attributes of a dataclass may be caches.
        return sorted((field.name, getattr(value, field.name)) for field in fields(value))
    slots = {name: getattr(value, name) for name in getattr(type(value), "__slots__", ()) if hasattr(value, name)}
    return sorted((slots | getattr(value, "__dict__", {})).items())


def _git(folder: Path, *arguments: str) -> str | None:
    """Run a git command in a folder, and return its output.

    Args:
        folder: Folder in which the command runs.
        *arguments: Arguments of the program git, for example `rev-parse` and `HEAD`.

    Returns:
        The output without surrounding white space; None if the command fails or takes more than 10 s.
    """
    command = ["git", "-C", str(folder), *arguments]
    try:
        finished = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return finished.stdout.strip() if finished.returncode == 0 else None


def _version_of(distribution: str) -> str | None:
    """Return the version of the installed Python package `distribution`; None if it is not installed."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None
