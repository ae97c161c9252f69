"""Checks and what they find; they run one after the other, and none whose grounds have given way."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Literal

from quad_env.doctor.subject import Subject

Result = Literal["ok", "warning", "problem", "left out"]


@dataclass(frozen=True)
class Finding:
    """What a check has seen."""

    result: Result
    seen: str
    """In a line."""
    cause: str = ""
    """Why it is so, as far as can be told; of warnings and problems."""
    remedy: str = ""
    """What to do about it; of warnings and problems."""


def ok(seen: str) -> Finding:
    """All well."""
    return Finding("ok", seen)


def warning(seen: str, cause: str, remedy: str) -> Finding:
    """Something that one can live with."""
    return Finding("warning", seen, cause, remedy)


def problem(seen: str, cause: str, remedy: str) -> Finding:
    """Something that has to be mended."""
    return Finding("problem", seen, cause, remedy)


@dataclass(frozen=True)
class Check:
    """One thing to look at."""

    name: str
    place: str
    """Module and function, `quad_env.doctor.robot:model`, that take a Subject; loaded when its turn comes, since a
    broken package may not even load."""
    needs: tuple[str, ...] = ()
    """Checks without which this one would only see what they have seen already."""

    def look(self, subject: Subject) -> Finding:
        """Run it; an error that it did not foresee is a problem too."""
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
    """A check with what it has found."""

    name: str
    finding: Finding
    seconds: float
    """How long it took."""


def examine(checks: Iterable[Check], subject: Subject) -> Iterator[Entry]:
    """Run the checks in their order; one whose needs are not met is left out."""
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
