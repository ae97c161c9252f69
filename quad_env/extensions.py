"""Extensions: objects that other packages or scripts add to the environment and the evaluation.

An extension contains reward terms, observation terms, disturbance axes, scenarios, robots, policies and measures. An
installed package with an entry point of the group `quad_env` adds its extension to every command:

    [project.entry-points.quad_env]
    my_project = "my_project.quadruped:EXTENSION"

A script calls `quad_env.add_extension(extension)` to add an extension to its own process.
"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

GROUP = "quad_env"
"""Name of the entry-point group in which installed packages register their `Extension`."""


@dataclass(frozen=True)
class Extension:
    """Objects that another package or script adds to this project; each field maps names to objects of one kind.

    A name must differ from the built-in names of the same kind. docs/extending.md has an example of each kind.
    """

    rewards: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)
    """Name of a reward term -> function that takes a `QuadState` and returns the value of the term.

    `gym.make(..., rewards={name: weight})` makes an environment with the term.
    """
    observations: Mapping[str, Any] = field(default_factory=dict)
    """Name of an observation term -> `quad_env.ObservationTerm`.

    `gym.make(..., observations=(name,))` makes an environment with the term.
    """
    axes: Mapping[str, Any] = field(default_factory=dict)
    """Name of a disturbance axis -> `quad_env.Axis` of the same name, with scenarios of increasing severity.

    The option `--scenarios NAME:all` evaluates policies at all levels of the axis.
    """
    scenarios: Mapping[str, Any] = field(default_factory=dict)
    """Name of a scenario -> `quad_env.Scenario` of the same name."""
    robots: Mapping[str, Any] = field(default_factory=dict)
    """Name of a robot -> `quad_env.Robot`, path of the robot's model file, or function.

    The function takes no arguments, and returns a `quad_env.Robot` or the path of a model file.
    """
    policies: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    """Name of a policy (controller) -> function or class that makes the policy.

    The function or class takes the keyword arguments `robot` and `control_period`, s.
    """
    measures: Mapping[str, Any] = field(default_factory=dict)
    """Name of a measure, which is a number per episode -> `evaluate.measures.extra.ExtraMeasure`.

    Each measure becomes a column of `episodes.parquet`, the table of the evaluated episodes.
    """

    def __post_init__(self) -> None:
        for kind in fields(self):
            named_entries = getattr(self, kind.name)
            if not isinstance(named_entries, Mapping):
                raise TypeError(f"{kind.name}: expected a mapping of names, got {named_entries!r}")
            for name in named_entries:
                if not (isinstance(name, str) and name.isidentifier()):
                    raise ValueError(f"{kind.name}: name {name!r} is not a Python identifier")


KINDS = tuple(kind.name for kind in fields(Extension))
"""Kinds of objects that an extension can add, which are the names of the fields of `Extension`."""
_added: list[Extension] = []
"""Extensions that `add_extension` has added to this process, in the order of the calls."""
_added_observers: list[Callable[[], None]] = []
"""Functions without arguments that `add_extension` calls at its end.

Each function clears a cached list of names, because the list does not contain the objects of the new extension.
"""


def add_extension(extension: Extension) -> None:
    """Add the objects of an extension to this process and to the worker processes of an evaluation.

    If an object has a built-in name, `check_new` raises ValueError later, when objects of this kind are first used.

    Args:
        extension: Extension to add.

    Raises:
        TypeError: The argument is not an `Extension`.
        ValueError: Another extension has an object of the same kind and name.
    """
    if not isinstance(extension, Extension):
        raise TypeError(f"extension: expected a quad_env.Extension, got {extension!r}")
    for kind in KINDS:
        if taken := _shared_names(named(kind), getattr(extension, kind)):
            raise ValueError(f"extension: {kind} {taken} exist already; choose another name")
    _added.append(extension)
    for drop_cache in _added_observers:
        drop_cache()


def added_extensions() -> tuple[Extension, ...]:
    """Return the extensions that were added to this process, in the order of the calls of `add_extension`."""
    return tuple(_added)


def when_added(drop_cache: Callable[[], None]) -> None:
    """Register a function without arguments, `drop_cache`, that every later call of `add_extension` calls.

    The function should clear a cached list of names, because the list lacks the objects of the new extension.
    """
    _added_observers.append(drop_cache)


def named(kind: str) -> dict[str, Any]:
    """Return the objects of one kind, for example all robots, that extensions provide.

    The extensions are entry points of installed packages, or were added by `add_extension`.

    Args:
        kind: Name of a field of `Extension`, such as `robots`.

    Returns:
        Name -> object. Objects of installed packages precede objects that `add_extension` has added.
    """
    additions: dict[str, Any] = {}
    for extension in (*_installed(), *_added):
        additions |= getattr(extension, kind)
    return additions


def check_new(kind: str, builtin: Mapping[str, Any]) -> dict[str, Any]:
    """Return the objects of one kind that extensions add, and check that their names are not built-in names.

    Args:
        kind: Name of a field of `Extension`, such as `robots`.
        builtin: Mapping with the built-in names of this kind as keys.

    Returns:
        Name -> object that an extension adds.

    Raises:
        ValueError: An object of an extension has a built-in name.
    """
    additions = named(kind)
    if taken := _shared_names(additions, builtin):
        raise ValueError(f"extension: {kind} {taken} exist already; choose another name")
    return additions


def _shared_names(first: Mapping[str, Any], second: Mapping[str, Any]) -> str:
    """Return the keys that `first` and `second` share, sorted and joined by commas; empty if none."""
    return ", ".join(sorted(set(first) & set(second)))


@cache
def _installed() -> tuple[Extension, ...]:
    """Return the extensions that installed packages register as entry points.

    An extension that cannot be loaded is left out with a warning. An extension is also left out with a warning if
    another extension already has an object of the same kind and name.
    """
    extensions: list[Extension] = []
    for entry_point in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        extension = _load(entry_point)
        if extension is None:
            continue
        clash = _first_clash(extensions, extension)
        if clash is None:
            extensions.append(extension)
        else:
            _warn(entry_point, f"{clash} exists already in another extension")
    return tuple(extensions)


def _load(entry_point: EntryPoint) -> Extension | None:
    """Import the extension that an installed package registers as `entry_point`.

    If the import fails or the imported object is not an `Extension`, the function warns and returns None.
    """
    try:
        extension = entry_point.load()
    except Exception as error:
        # All exceptions are caught, because the code of another package may raise any exception.
        _warn(entry_point, f"{type(error).__name__}: {error}")
        return None
    if not isinstance(extension, Extension):
        _warn(entry_point, f"expected a quad_env.Extension, got {type(extension).__name__}")
        return None
    return extension


def _first_clash(extensions: list[Extension], extension: Extension) -> str | None:
    """Return the first kind and name, such as `robots rex`, that `extension` shares with `extensions`.

    The result is None if no object of `extensions` has the same kind and name as an object of `extension`.
    """
    for kind in KINDS:
        for name in getattr(extension, kind):
            if any(name in getattr(other, kind) for other in extensions):
                return f"{kind} {name}"
    return None


def _warn(entry_point: EntryPoint, reason: str) -> None:
    warnings.warn(f"extension {entry_point.name} ({entry_point.value}) is left out: {reason}", stacklevel=2)
