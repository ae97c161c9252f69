"""Whether Python and the packages are those that the project asks for."""

import os
import platform
import shlex
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from quad_env.doctor.check import Finding, ok, problem, warning
from quad_env.doctor.subject import Subject

PROJECT = "simple-quad"
SOURCE = Path(__file__).parents[2] / "pyproject.toml"
"""Of the clone that this package lies in, if it lies in one: newer than what was installed, after a `git pull`."""


@dataclass(frozen=True)
class Asked:
    """What the project asks for."""

    python: SpecifierSet
    base: tuple[Requirement, ...]
    extras: Mapping[str, tuple[Requirement, ...]]
    clone: bool
    """Whether it is the clone that says so, which is installed with `-e`."""

    def install(self, extra: str = "") -> str:
        """Command that brings an extra's packages, or those that all need."""
        target = f"{SOURCE.parent if self.clone else PROJECT}{f'[{extra}]' if extra else ''}"
        return f"pip install -U {'-e ' if self.clone else ''}{shlex.quote(target)}"


def asked() -> Asked:
    """What the clone asks for, else what the installed package does. Raises PackageNotFoundError."""
    project = tomllib.loads(SOURCE.read_text(encoding="utf-8"))["project"] if SOURCE.is_file() else {}
    if project.get("name") == PROJECT:
        extras = {name: _parsed(lines) for name, lines in project["optional-dependencies"].items()}
        return Asked(SpecifierSet(project["requires-python"]), _parsed(project["dependencies"]), extras, clone=True)
    told = metadata.metadata(PROJECT)
    needed = _parsed(metadata.requires(PROJECT) or ())
    extras = {
        extra: tuple(each for each in needed if each.marker and each.marker.evaluate({"extra": extra}))
        for extra in told.get_all("Provides-Extra") or ()
    }
    base = tuple(each for each in needed if not each.marker or each.marker.evaluate({"extra": ""}))
    return Asked(SpecifierSet(told["Requires-Python"]), base, extras, clone=False)


def _parsed(lines: Iterable[str]) -> tuple[Requirement, ...]:
    return tuple(map(Requirement, lines))


def python(_: Subject) -> Finding:
    """Whether the interpreter is recent enough."""
    version = platform.python_version()
    if asked().python.contains(version, prereleases=True):
        return ok(f"Python {version}")
    needed = f"Python {version}, but {asked().python} is asked for"
    return problem(needed, "the environment was made with another Python", "make one with a newer Python: see README")


def packages(_: Subject) -> Finding:
    """Whether the packages that everything needs are there, in versions that fit."""
    wanted = asked()
    wrong = [fault for each in wanted.base if (fault := _fault(each))]
    if not wrong:
        return ok(f"{len(wanted.base)} of {len(wanted.base)} packages; MuJoCo {metadata.version('mujoco')}")
    cause = "not installed into this environment, changed by another package, or asked for since the last `git pull`"
    return problem("; ".join(wrong), cause, wanted.install())


def extras(_: Subject) -> Finding:
    """Which optional extras are there; old packages of theirs are warned of, missing ones are nobody's fault."""
    wanted, there, absent = asked(), [], []
    old: dict[str, str] = {}
    for name, needed in wanted.extras.items():
        missing = [each.name for each in needed if not _version(each)]
        faults = [fault for each in needed if each.name not in missing and (fault := _fault(each))]
        old |= dict.fromkeys(faults, name)
        (absent.append(f"{name} ({', '.join(missing)})") if missing else there.append(name))
    seen = f"there: {', '.join(there) or 'none'}"
    if absent:
        seen += f"; not there: {', '.join(absent)}; {wanted.install('NAME')} brings one"
    if not old:
        return ok(seen)
    cause = "another package wants these versions, or they were installed long ago"
    return warning("; ".join(old), cause, " && ".join(wanted.install(name) for name in dict.fromkeys(old.values())))


def _version(needed: Requirement) -> str | None:
    try:
        return metadata.version(needed.name)
    except metadata.PackageNotFoundError:
        return None


def _fault(needed: Requirement) -> str | None:
    """What is wrong with it, in words; None for nothing."""
    version = _version(needed)
    if version is None:
        return f"{needed.name} is missing"
    if needed.specifier.contains(version, prereleases=True):
        return None
    return f"{needed.name} is {version}, {needed.specifier} is asked for"


def mujoco(_: Subject) -> Finding:
    """Whether MuJoCo loads, with the batch that every simulation here is one of."""
    try:
        import_module("quad_env.physics.simulation")  # which takes of MuJoCo what everything here does
    except Exception as error:  # whatever a backend of OpenGL, or a library of the system, raises
        seen = f"MuJoCo does not load: {' '.join(str(error).split())}"
        if chosen := os.environ.get("MUJOCO_GL"):
            cause = f"MUJOCO_GL={chosen}, which MuJoCo reads as it loads, asks for what is not here"
            return problem(seen, cause, "unset MUJOCO_GL, or set it to egl")
        return problem(seen, "its wheel is for another system, or is damaged", "pip install --force-reinstall mujoco")
    return ok("MuJoCo loads, with its batch")
