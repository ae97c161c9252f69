"""Extensions: additions of other packages to the environment and the evaluation.

An extension has reward terms, observation terms, axes, scenarios, robots, policies and measures. An installed package
with an entry point of the group `quad_env` adds its extension to every command:

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
"""Entry-point group of extensions."""


@dataclass(frozen=True)
class Extension:
    """Additions of another package or script, as a mapping of names for each kind of addition.

    A name must differ from the built-in names of the same kind. docs/extending.md has an example of each kind.
    """

    rewards: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)
    """Reward terms: functions of a `QuadState`, available as `gym.make(..., rewards={name: weight})`."""
    observations: Mapping[str, Any] = field(default_factory=dict)
    """Observation terms: `quad_env.ObservationTerm`, available as `gym.make(..., observations=(name,))`."""
    axes: Mapping[str, Any] = field(default_factory=dict)
    """Axes, that is kinds of disturbance: `quad_env.Axis` of the same name, available as `--scenarios NAME:all`."""
    scenarios: Mapping[str, Any] = field(default_factory=dict)
    """Scenarios: `quad_env.Scenario` of the same name."""
    robots: Mapping[str, Any] = field(default_factory=dict)
    """Robots: a `quad_env.Robot`, the path of a robot model, or a function without arguments that returns either."""
    policies: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    """Policies: functions or classes that take the keyword arguments `robot` and `control_period`, s."""
    measures: Mapping[str, Any] = field(default_factory=dict)
    """Measures of an episode: `evaluate.measures.extra.ExtraMeasure`; each is a column of `episodes.parquet`."""

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
"""Extensions from `add_extension`, in the order of the calls."""
_added_observers: list[Callable[[], None]] = []
"""Functions that clear caches of names; `add_extension` calls them after every addition."""


def add_extension(extension: Extension) -> None:
    """Add an extension to this process; worker processes of an evaluation get the extension too.

    A built-in name raises ValueError later, in `check_new`.

    Args:
        extension: Extension to add.

    Raises:
        TypeError: The argument is not an `Extension`.
        ValueError: Another extension has an addition of the same kind and name.
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
    """Register a function without arguments that `add_extension` calls after every later addition."""
    _added_observers.append(drop_cache)


def named(kind: str) -> dict[str, Any]:
    """Return all additions of a kind.

    Args:
        kind: Name of a field of `Extension`.

    Returns:
        Name -> addition; additions of installed packages precede additions to this process.
    """
    additions: dict[str, Any] = {}
    for extension in (*_installed(), *_added):
        additions |= getattr(extension, kind)
    return additions


def check_new(kind: str, builtin: Mapping[str, Any]) -> dict[str, Any]:
    """Return all additions of a kind after a check that no addition has a built-in name.

    Args:
        kind: Name of a field of `Extension`.
        builtin: Mapping with the built-in names of this kind as keys.

    Returns:
        Name -> addition.

    Raises:
        ValueError: An addition has a built-in name.
    """
    additions = named(kind)
    if taken := _shared_names(additions, builtin):
        raise ValueError(f"extension: {kind} {taken} exist already; choose another name")
    return additions


def _shared_names(first: Mapping[str, Any], second: Mapping[str, Any]) -> str:
    """Return the names that both mappings have, sorted and joined by commas; empty if they share none."""
    return ", ".join(sorted(set(first) & set(second)))


@cache
def _installed() -> tuple[Extension, ...]:
    """Return the extensions of installed packages; warn about and leave out an extension that is invalid."""
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
    """Return the extension of an entry point; warn and return None if it cannot be loaded."""
    try:
        extension = entry_point.load()
    except Exception as error:  # because the code of another package may raise any exception
        _warn(entry_point, f"{type(error).__name__}: {error}")
        return None
    if not isinstance(extension, Extension):
        _warn(entry_point, f"expected a quad_env.Extension, got {type(extension).__name__}")
        return None
    return extension


def _first_clash(extensions: list[Extension], extension: Extension) -> str | None:
    """Return kind and name of the first addition that another extension has too; None if all names differ."""
    for kind in KINDS:
        for name in getattr(extension, kind):
            if any(name in getattr(other, kind) for other in extensions):
                return f"{kind} {name}"
    return None


def _warn(entry_point: EntryPoint, reason: str) -> None:
    warnings.warn(f"extension {entry_point.name} ({entry_point.value}) is left out: {reason}", stacklevel=2)
