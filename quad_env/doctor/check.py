"""Checks and their findings; a check is left out where one that it needs has found a problem."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Literal

from quad_env.doctor.subject import Subject

Result = Literal["ok", "warning", "problem", "left out"]


@dataclass(frozen=True)
class Finding:
    """Result of a check."""

    result: Result
    seen: str
    """Observation, one line."""
    cause: str = ""
    """Likely cause; of warnings and problems."""
    remedy: str = ""
    """What to do; of warnings and problems."""


def ok(seen: str) -> Finding:
    """Finding of a check without fault."""
    return Finding("ok", seen)


def warning(seen: str, cause: str, remedy: str) -> Finding:
    """Finding that needs no repair."""
    return Finding("warning", seen, cause, remedy)


def problem(seen: str, cause: str, remedy: str) -> Finding:
    """Finding that needs repair."""
    return Finding("problem", seen, cause, remedy)


@dataclass(frozen=True)
class Check:
    """One check by name."""

    name: str
    place: str
    """Module and function of a Subject, `quad_env.doctor.model:model`; loaded late, since it may not load."""
    needs: tuple[str, ...] = ()
    """Checks that have to succeed first, since this one would only find their problems again."""

    def look(self, subject: Subject) -> Finding:
        """Finding of the check; an unexpected error is a problem too."""
        module, _, function = self.place.partition(":")
        try:
            found = getattr(import_module(module), function)(subject)
        except ModuleNotFoundError as error:
            return problem(
                f"{error.name} is not installed", "a package is missing", "pip install -U simple-quad, or -e ."
            )
        except Exception as error:
            text = " ".join(str(error).split()) or type(error).__name__
            return problem(text, f"{type(error).__name__} in the check itself", "report it, with this line")
        assert isinstance(found, Finding)
        return found


@dataclass(frozen=True)
class Entry:
    """A check with its finding."""

    name: str
    finding: Finding
    seconds: float
    """Duration of the check."""


def examine(checks: Iterable[Check], subject: Subject) -> Iterator[Entry]:
    """Entries of the checks, in their order; one whose needs are not met is left out."""
    broken: set[str] = set()
    for check in checks:
        start = time.perf_counter()
        if missing := [name for name in check.needs if name in broken]:
            finding = Finding("left out", f"not before {' and '.join(missing)}")
        else:
            finding = check.look(subject)
        if finding.result in ("problem", "left out"):
            broken.add(check.name)
        yield Entry(check.name, finding, time.perf_counter() - start)
