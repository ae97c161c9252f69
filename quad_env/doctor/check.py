"""Checks of the doctor, their subject and their findings.

A check is left out if a check that it needs has found a problem.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, Literal

from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot


@dataclass(frozen=True)
class DoctorSubject:
    """The robot, and perhaps the policy, that checks examine; made by the commands `doctor` and `describe`."""

    robot_source: str | Robot = "simple_quad"
    """Name of a robot, path of its MJCF, URDF or TOML, or the robot itself."""
    policy: str | None = None
    """Policy by name or path."""
    trust: bool = False
    """True if the policy may be loaded from a file that can hide code."""

    @property
    def name(self) -> str:
        """Name of the robot, or the path of its file."""
        return (
            self.robot_source
            if isinstance(self.robot_source, str)
            else str(self.robot_source.source or self.robot_source.name)
        )

    @cached_property
    def robot(self) -> Robot:
        """The robot, read at the first access; raises ModelError, FileNotFoundError or ModuleNotFoundError."""
        return get_robot(self.robot_source)

    @cached_property
    def env(self) -> Any:
        """A single environment with the robot and its stiff servos that ignores falls; raises ValueError."""
        from quad_env.envs.env import SimpleQuadEnv

        return SimpleQuadEnv(robot=self.robot.with_stiff_servos, terminate_on_fall=False)

    @property
    def parameter_source(self) -> str:
        """File that can give parameters of the robot, in words."""
        if self.name.endswith(".toml"):
            return self.name
        return f"a TOML (python -m quad_env describe {self.name} --toml mine.toml)"


@dataclass(frozen=True)
class Finding:
    """Result of a check; made by `ok`, `problem` or the check itself."""

    result: Literal["ok", "warning", "problem", "left out"]
    """A warning needs no repair, a problem does."""
    observed: str
    """Observation on one line."""
    cause: str = ""
    """Likely cause; empty unless the result is a warning or problem."""
    remedy: str = ""
    """Remedy; empty unless the result is a warning or problem."""
    details: tuple[str, ...] = ()
    """Further observations, a line each."""


def ok(observed: str) -> Finding:
    """Return the finding of a check without fault."""
    return Finding("ok", observed)


def problem(observed: str, cause: str, remedy: str) -> Finding:
    """Return a finding that needs repair, with the text `observed`, its likely `cause` and its `remedy`."""
    return Finding("problem", observed, cause, remedy)


@dataclass(frozen=True)
class DoctorCheck:
    """A check by name; the commands `doctor` of this package and of `live` have lists of them."""

    name: str
    """Name in the report."""
    place: str
    """Module and function that takes the subject, `quad_env.doctor.model:model`; imported late, since it may fail."""
    needs: tuple[str, ...] = ()
    """Names of checks that have to succeed first: this one would only find their problems again."""

    def run(self, subject: DoctorSubject) -> Finding:
        """Return the finding of the check; an unexpected error is a problem too."""
        module, _, function = self.place.partition(":")
        try:
            finding: Finding = getattr(import_module(module), function)(subject)
        except ModuleNotFoundError as error:
            return problem(
                f"{error.name} is not installed", "a package is missing", "pip install -U simple-quad, or -e ."
            )
        except Exception as error:
            text = " ".join(str(error).split()) or type(error).__name__
            return problem(text, f"{type(error).__name__} in the check itself", "report it, with this line")
        return finding


def run_checks(checks: Iterable[DoctorCheck], subject: DoctorSubject) -> Iterator[tuple[str, Finding]]:
    """Yield name and finding of each check.

    A check is left out if one of its needs has a problem or is left out.

    Args:
        checks: Checks in their order.
        subject: Robot and policy.

    Yields:
        Name of the check, and its finding.
    """
    failed: set[str] = set()
    for check in checks:
        if missing := [name for name in check.needs if name in failed]:
            finding = Finding("left out", f"not before {' and '.join(missing)}")
        else:
            finding = check.run(subject)
        if finding.result in ("problem", "left out"):
            failed.add(check.name)
        yield check.name, finding
