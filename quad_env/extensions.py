"""Extensions: reward terms, observation terms, scenarios, robots, policies and measures of other packages.

A package that declares an entry point of the group `quad_env` adds its extension to every command once it is installed:

    [project.entry-points.quad_env]
    my_project = "my_project.quadruped:EXTENSION"

A script adds one with `quad_env.add_extension(extension)`, for its own process.
"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

GROUP = "quad_env"
"""Entry-point group that is searched for extensions."""


@dataclass(frozen=True)
class Extension:
    """Additions of another package or script, by name; made by its author, read by `named`.

    Each name must differ from the built-in names of its kind. docs/extending.md has an example of each kind.
    """

    rewards: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)
    """Reward terms: functions of a `QuadState`, available as `gym.make(..., rewards={name: weight})`."""
    observations: Mapping[str, Any] = field(default_factory=dict)
    """Observation terms: `quad_env.ObservationTerm`, available as `gym.make(..., observations=(name,))`."""
    axes: Mapping[str, Any] = field(default_factory=dict)
    """Axes of disturbance: `quad_env.Axis` of the same name, for `--scenarios NAME:all`."""
    scenarios: Mapping[str, Any] = field(default_factory=dict)
    """Scenarios: `quad_env.Scenario` of the same name."""
    robots: Mapping[str, Any] = field(default_factory=dict)
    """Robots: a `quad_env.Robot`, the path of its model, or a function without arguments that returns either."""
    policies: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    """Policies: functions or classes that take the keywords `robot` and `control_period` (s)."""
    measures: Mapping[str, Any] = field(default_factory=dict)
    """Measures of an episode: `evaluate.measures.extra.ExtraMeasure`, a column of `episodes.parquet` each."""

    def __post_init__(self) -> None:
        for kind in fields(self):
            named_entries = getattr(self, kind.name)
            if not isinstance(named_entries, Mapping):
                raise TypeError(f"{kind.name}: expected a mapping of names, got {named_entries!r}")
            for name in named_entries:
                if not (isinstance(name, str) and name.isidentifier()):
                    raise ValueError(f"{kind.name}: name {name!r} is not a Python identifier")


KINDS = tuple(kind.name for kind in fields(Extension))
"""Kinds of additions, in the order of the fields of `Extension`."""
_added: list[Extension] = []
"""Extensions that were added in this process, in order."""
_added_observers: list[Callable[[], None]] = []
"""Functions that drop caches of names, called after every addition."""


def add_extension(extension: Extension) -> None:
    """Add an extension to this process. Worker processes of the evaluator receive it as well.

    ValueError is raised if another extension has the same name of the same kind.

    Args:
        extension: Additions; a built-in name is refused when its kind is read.

    Raises:
        TypeError: The argument is not an `Extension`.
    """
    if not isinstance(extension, Extension):
        raise TypeError(f"extension: expected a quad_env.Extension, got {extension!r}")
    for kind in KINDS:
        _check_distinct(kind, named(kind), getattr(extension, kind))
    _added.append(extension)
    for drop_cache in _added_observers:
        drop_cache()


def added_extensions() -> tuple[Extension, ...]:
    """Return the extensions that `add_extension` received in this process, in order."""
    return tuple(_added)


def when_added(drop_cache: Callable[[], None]) -> None:
    """Call `drop_cache` after every later addition."""
    _added_observers.append(drop_cache)


def named(kind: str) -> dict[str, Any]:
    """Return every addition of a kind by name.

    Args:
        kind: Name of a field of `Extension`.

    Returns:
        Additions of installed packages, then of this process.
    """
    additions: dict[str, Any] = {}
    for extension in (*_installed(), *_added):
        additions |= getattr(extension, kind)
    return additions


def check_new(kind: str, builtin: Mapping[str, Any]) -> dict[str, Any]:
    """Return every addition of a kind by name.

    Args:
        kind: Name of a field of `Extension`.
        builtin: Names that the package itself has of this kind.

    Returns:
        Additions by name.

    Raises:
        ValueError: An addition has a built-in name.
    """
    additions = named(kind)
    if taken := sorted(set(additions) & set(builtin)):
        raise ValueError(f"extension: {kind} {', '.join(taken)} exist already; choose another name")
    return additions


def _check_distinct(kind: str, known: Mapping[str, Any], new: Mapping[str, Any]) -> None:
    if taken := sorted(set(known) & set(new)):
        raise ValueError(f"extension: {kind} {', '.join(taken)} exist already; choose another name")


@cache
def _installed() -> tuple[Extension, ...]:
    """Return the extensions of installed packages; a broken one is left out with a warning."""
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
    """Return the extension of an entry point; None, after a warning, if it cannot be loaded."""
    try:
        extension = entry_point.load()
    except Exception as error:  # the code of another package may raise anything
        _warn(entry_point, f"{type(error).__name__}: {error}")
        return None
    if not isinstance(extension, Extension):
        _warn(entry_point, f"expected a quad_env.Extension, got {type(extension).__name__}")
        return None
    return extension


def _first_clash(extensions: list[Extension], extension: Extension) -> str | None:
    """Return the first addition, kind and name, that one of the other extensions has too; None without one."""
    for kind in KINDS:
        for name in getattr(extension, kind):
            if any(name in getattr(other, kind) for other in extensions):
                return f"{kind} {name}"
    return None


def _warn(entry_point: EntryPoint, reason: str) -> None:
    warnings.warn(f"extension {entry_point.name} ({entry_point.value}) is left out: {reason}", stacklevel=2)
