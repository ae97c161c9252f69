"""Pickles of values with the files that they name, for processes on machines that lack these files.

A pickle contains the names of files; the contents are kept apart from it, so that many pickles share them. A file of
an installed package is not sent: each machine has its own copy.
"""

import ast
import dataclasses
import io
import os
import pickle
import sysconfig
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from policies.description import DESCRIPTION
from policies.external import is_reference
from quad_env.cli.command_line import UsageError
from quad_env.files.reading import MAX_DATA_SIZE, check_file, has_content, parse_toml, read_bytes
from quad_env.robots.referenced_files import MODEL_SUFFIXES, referenced_files
from quad_env.robots.registry import SUFFIXES as ROBOT_SUFFIXES

_PACKAGES = ("quad_env", "policies", "evaluate", "train")
"""Packages of this project, which every machine has."""
_REPOSITORY = Path(__file__).resolve().parents[2]
_POLICY_FILES = (DESCRIPTION, "config.json")
"""Names of files; each folder of a policy bundle or of a training run has one of them."""
Options = TypeVar("Options")
MAX_SIZE = 2**30
"""Largest total size of the files of one pickle, bytes."""


class FileName(str):
    """Text that names a local file, such as `my_robot.xml` or `my_file.py:MyPolicy`; the file is sent."""

    __slots__ = ()


def mark_file(text: str) -> str:
    """Return the text as a `FileName` if it names a file of the user or the folder of a policy, otherwise the text.

    Args:
        text: Value of an option that is a name or the path of a file.

    Returns:
        The text.
    """
    path = _split(text)[0]
    is_file = (path.suffix in ROBOT_SUFFIXES or is_reference(text)) and path.is_file()
    is_folder = "/" in path.as_posix() and _is_policy_folder(path)
    return FileName(text) if is_file or is_folder else text


def mark_files(options: Options) -> Options:
    """Return options of a command, in which `mark_file` has been applied to every text.

    Args:
        options: Dataclass of options.

    Returns:
        The options.
    """
    given: Any = options
    values = {each.name: _mark_all(getattr(options, each.name)) for each in dataclasses.fields(given) if each.init}
    marked: Options = dataclasses.replace(given, **values)
    return marked


def _mark_all(value: Any) -> Any:
    """Apply `mark_file` to a text, or to all texts of a tuple."""
    if isinstance(value, tuple):
        return tuple(map(_mark_all, value))
    return mark_file(value) if isinstance(value, str) else value


def _is_policy_folder(path: Path) -> bool:
    """Return True if a path is the folder of a policy bundle or of a training run."""
    return any((path / name).is_file() for name in _POLICY_FILES)


@dataclass(frozen=True)
class Pickle:
    """Pickle of a value, and the files that it names."""

    body: bytes
    """The pickle."""
    files: tuple[str, ...]
    """Absolute paths of the user's files that the unpickled value needs."""


def pack(value: Any) -> Pickle:
    """Pickle a value, and list the files that it names.

    Each `Path` and each `FileName` of an existing file is replaced by a reference.

    Args:
        value: Value to pickle. Functions and classes of scripts are allowed.

    Returns:
        The pickle.

    Raises:
        UsageError: A part of the value cannot be pickled, or the files are too large.
    """
    import cloudpickle  # The import is local, because only the tasks of a Ray cluster need this package.

    files: dict[str, None] = {}

    class Pickler(cloudpickle.CloudPickler):  # type: ignore[misc]
        """Pickler that replaces files by references."""

        def persistent_id(self, entry: object) -> tuple[str, ...] | None:
            """Return the reference to a file; None for any other object."""
            reference = _reference(entry)
            if reference is not None and reference[0] != _INSTALLED:
                files.update(dict.fromkeys(map(str, _needed_files(Path(reference[1])))))
            return reference

    buffer = io.BytesIO()
    try:
        Pickler(buffer).dump(value)
    except (AttributeError, TypeError, pickle.PicklingError) as error:
        raise UsageError(f"--ray: a task cannot be sent to a worker ({error})") from error
    total = sum(Path(file).stat().st_size for file in files)
    if total > MAX_SIZE:
        raise UsageError(f"--ray: the files of a task have {total / 2**20:.0f} MiB; valid: at most {MAX_SIZE >> 20}")
    return Pickle(buffer.getvalue(), tuple(files))


@dataclass(frozen=True)
class Unpacked:
    """Unpickled value, and the names of its files on this machine."""

    value: Any
    """The value."""
    moved: bool
    """True if the files are copies in a temporary folder, False if they are where they were on the sending machine."""
    originals: Mapping[str, str] = field(default_factory=dict)
    """Name of a file on this machine -> name that the sending process has for it."""

    def restore(self, text: str) -> str:
        """Return a text, such as an error message, in which files have the names of the sending process.

        Args:
            text: Text that was made on this machine.

        Returns:
            The text.
        """
        for name in sorted(self.originals, key=len, reverse=True):
            text = text.replace(name, self.originals[name])
        return text


def unpack(body: bytes, files: Mapping[str, bytes], folder: Path) -> Unpacked:
    """Unpickle a value of `pack`; its files are copied to a folder if this machine lacks them.

    Args:
        body: The pickle.
        files: Absolute path on the sending machine -> content.
        folder: Folder for the copies.

    Returns:
        The value.
    """
    moved = not all(has_content(Path(name), content) for name, content in files.items())
    if moved:
        for name, content in files.items():
            copy = _moved_to(folder, name)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(content)
    originals: dict[str, str] = {}

    class Unpickler(pickle.Unpickler):
        """Unpickler that replaces references by names of files on this machine."""

        def persistent_load(self, reference: tuple[str, ...]) -> Path | str:
            """Return the path or the text that a reference stands for."""
            kind, name, *rest = reference
            if kind == _INSTALLED:
                return _installed_folders()[name] / rest[0]
            original, ending = rest
            here = str(_moved_to(folder, name)) if moved else name
            originals[here] = original
            if moved:
                originals.setdefault(str(folder), "")
            return Path(here) if kind == _PATH else here + ending

    value = Unpickler(io.BytesIO(body)).load()
    return Unpacked(value, moved, originals)


_INSTALLED = "installed"
"""Kind of the reference to a file of an installed package: root folder, relative path."""
_PATH = "path"
"""Kind of the reference to a `Path`: absolute path, original text, empty text."""
_TEXT = "text"
"""Kind of the reference to a `FileName`: absolute path, original text of the path, text after the path."""


def _reference(entry: object) -> tuple[str, ...] | None:
    """Return the reference that replaces an object in a pickle; None if the object is no file."""
    if isinstance(entry, FileName):
        path, ending = _split(entry)
        return _TEXT, os.path.abspath(path), str(path), ending
    if not isinstance(entry, Path) or not (entry.is_file() or _is_policy_folder(entry)):
        return None
    for name, root in _installed_folders().items():
        if entry.absolute().is_relative_to(root):
            return _INSTALLED, name, entry.absolute().relative_to(root).as_posix()
    return _PATH, os.path.abspath(entry), str(entry), ""


def _installed_folders() -> dict[str, Path]:
    """Return the folders with files that every machine has: name -> path."""
    folders = {name: _REPOSITORY / name for name in _PACKAGES}
    return folders | {name: Path(sysconfig.get_paths()[name]) for name in ("purelib", "platlib")}


def _split(text: str) -> tuple[Path, str]:
    """Split a text such as `my_file.py:MyPolicy` into the path and the ending with the colon."""
    file, colon, name = text.rpartition(":")
    if colon and file.lower().endswith(".py"):
        return Path(file), colon + name
    return Path(text), ""


def _needed_files(path: Path) -> Iterator[Path]:
    """Yield a user's file and the files that it needs: modules next to a Python file, meshes and parts of a model.

    If the path is a folder, all files in it are yielded.
    """
    if path.is_dir():
        yield from (file for file in sorted(path.rglob("*")) if file.is_file())
        return
    check_file(path, MAX_DATA_SIZE)
    yield path
    needed = _FINDERS.get(path.suffix.lower())
    if needed is not None:
        yield from (Path(os.path.abspath(each)) for each in needed(path))


def _neighbour_modules(path: Path) -> Iterator[Path]:
    """Yield the Python modules that a file imports from its own folder, and the modules that these import."""
    waiting = [path]
    seen = {path}
    while waiting:
        for module in _imported_modules(waiting.pop(), path.parent):
            if module not in seen:
                seen.add(module)
                waiting.append(module)
                yield module


def _imported_modules(file: Path, folder: Path) -> Iterator[Path]:
    """Yield the files in a folder that may belong to the import statements of a Python file.

    A package is yielded with all of its Python files.
    """
    try:
        tree = ast.parse(read_bytes(file))
    except (SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.append(node.module)
        for name in {each.partition(".")[0] for each in names}:
            if (module := folder / f"{name}.py").is_file():
                yield module
            elif (package := folder / name).is_dir():
                yield from sorted(package.rglob("*.py"))


def _model_of_toml(path: Path) -> Iterator[Path]:
    """Yield the model that a user's TOML file of a robot names, and the files of the model."""
    try:
        name = parse_toml(read_bytes(path)).get("mjcf")
    except ValueError:
        return
    model = path.parent / name if isinstance(name, str) else None
    if model is not None and model.is_file():
        yield model
        yield from referenced_files(model)


_FINDERS: Mapping[str, Callable[[Path], Any]] = {
    ".py": _neighbour_modules,
    ".toml": _model_of_toml,
    **dict.fromkeys(MODEL_SUFFIXES, referenced_files),
}
"""Suffix of a file -> function that returns the files that it needs."""


def _moved_to(folder: Path, name: str) -> Path:
    """Return the path of the copy of a file in a folder; relative positions of files are kept."""
    path = Path(name)
    return folder / path.relative_to(path.anchor)
