"""Framework of the `doctor` command: the subject of the checks, a check, and the finding of a check.

A check is left out if another check that it needs has found a problem.
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
    """Robot and optional policy that the checks examine; made by the commands `doctor` and `describe`."""

    robot_source: str | Robot = "simple_quad"
    """Name of the robot, path of its MJCF, URDF or TOML file, or the robot itself."""
    policy: str | None = None
    """Name or path of the policy; None if no policy is examined."""
    trust: bool = False
    """True if the policy may be loaded from a file that can contain hidden code."""

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
        """The robot, loaded at the first access. Raises ModelError, FileNotFoundError or ModuleNotFoundError."""
        return get_robot(self.robot_source)

    @cached_property
    def env(self) -> Any:
        """Single environment with the robot and stiff servos; falls do not end it. Raises ValueError."""
        from quad_env.envs.env import SimpleQuadEnv

        return SimpleQuadEnv(robot=self.robot.with_stiff_servos, terminate_on_fall=False)

    @property
    def parameter_source(self) -> str:
        """Name of the TOML file with the robot's parameters, or a text that says how to make this file."""
        if self.name.endswith(".toml"):
            return self.name
        return f"a TOML (python -m quad_env describe {self.name} --toml mine.toml)"


@dataclass(frozen=True)
class Finding:
    """Result of a check; made by `ok`, `problem`, the check itself or `run_checks`."""

    result: Literal["ok", "warning", "problem", "left out"]
    """Kind of the result. A problem must be repaired; a warning need not be."""
    observed: str
    """Observation of the check, one line."""
    cause: str = ""
    """Likely cause of a warning or problem; empty for other results."""
    remedy: str = ""
    """Remedy of a warning or problem; empty for other results."""
    details: tuple[str, ...] = ()
    """Further observations, one line each."""


def ok(observed: str) -> Finding:
    """Return the finding of a check that has found no fault; `observed` is its observation."""
    return Finding("ok", observed)


def problem(observed: str, cause: str, remedy: str) -> Finding:
    """Return a finding that needs repair, with the text `observed`, its likely `cause` and its `remedy`."""
    return Finding("problem", observed, cause, remedy)


@dataclass(frozen=True)
class DoctorCheck:
    """Named check of the `doctor` command; the package `live` has further checks."""

    name: str
    """Name of the check in the report."""
    place: str
    """Module and name of the function that checks the subject, such as `quad_env.doctor.model:model`.

    The module is imported by `run`, because the import itself may fail.
    """
    needs: tuple[str, ...] = ()
    """Names of the checks that must succeed first, because this check would only report their problems again."""

    def run(self, subject: DoctorSubject) -> Finding:
        """Run the check and return its finding. An unexpected exception becomes a problem finding."""
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
    """Run checks in order and yield the name and finding of each.

    A check is left out if a check that it needs has found a problem or was left out.

    Args:
        checks: Checks in the order of execution.
        subject: Robot and policy to examine.

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
