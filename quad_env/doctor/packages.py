"""Whether Python and the packages are those that the project asks for."""

import os
import platform
import shlex
import tomllib
from importlib import import_module, metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from quad_env.doctor.check import Finding, Subject, ok, problem

PROJECT = "simple-quad"
SOURCE = Path(__file__).parents[2] / "pyproject.toml"
"""Of the clone that this package lies in, if it lies in one: newer than what was installed, after a `git pull`."""


def requirements() -> tuple[SpecifierSet, list[Requirement], str]:
    """Versions of Python and packages that the clone, else the installed package, asks for, and what installs them.

    Raises PackageNotFoundError.
    """
    project = tomllib.loads(SOURCE.read_text(encoding="utf-8"))["project"] if SOURCE.is_file() else {}
    if project.get("name") == PROJECT:
        packages = list(map(Requirement, project["dependencies"]))
        return (
            SpecifierSet(project["requires-python"]),
            packages,
            f"pip install -U -e {shlex.quote(str(SOURCE.parent))}",
        )
    needed = map(Requirement, metadata.requires(PROJECT) or ())
    packages = [each for each in needed if not each.marker or each.marker.evaluate({"extra": ""})]
    return SpecifierSet(metadata.metadata(PROJECT)["Requires-Python"]), packages, f"pip install -U {PROJECT}"


def packages(_: Subject) -> Finding:
    """Whether Python and the packages that every command needs are there, in versions that fit."""
    (python, wanted, install), version = requirements(), platform.python_version()
    if not python.contains(version, prereleases=True):
        needed = f"Python {version}, but {python} is required"
        return problem(needed, "the environment was made with another Python", "make one with a newer Python")
    wrong = [fault for each in wanted if (fault := _fault(each))]
    if not wrong:
        return ok(f"Python {version}, {len(wanted)} packages, MuJoCo {metadata.version('mujoco')}")
    cause = "not installed into this environment, changed by another package, or required since the last `git pull`"
    return problem("; ".join(wrong), cause, install)


def _fault(needed: Requirement) -> str | None:
    """What is wrong with it, in words; None for nothing."""
    try:
        version = metadata.version(needed.name)
    except metadata.PackageNotFoundError:
        return f"{needed.name} is missing"
    if needed.specifier.contains(version, prereleases=True):
        return None
    return f"{needed.name} is {version}, {needed.specifier} is required"


def mujoco(_: Subject) -> Finding:
    """Whether MuJoCo loads, with its batch of simulations."""
    try:
        import_module("quad_env.physics.simulation")  # imports of MuJoCo what all commands do
    except Exception as error:  # whatever a backend of OpenGL, or a library of the system, raises
        seen = f"MuJoCo does not load: {' '.join(str(error).split())}"
        if chosen := os.environ.get("MUJOCO_GL"):
            cause = f"MUJOCO_GL={chosen}, which MuJoCo reads as it loads, asks for what is not here"
            return problem(seen, cause, "unset MUJOCO_GL, or set it to egl")
        return problem(seen, "its wheel is for another system, or is damaged", "pip install --force-reinstall mujoco")
    return ok("MuJoCo loads, with its batch")
