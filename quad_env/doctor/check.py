"""Checks, what they examine and what they find; a check is left out where one that it needs has found a problem."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, Literal

from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot


@dataclass(frozen=True)
class DoctorSubject:
    """The robot, and perhaps the policy, that a run of checks examines."""

    robot_source: str | Robot = "simple_quad"
    """Name of a robot, path of its MJCF, URDF or TOML, or the robot itself."""
    policy: str | None = None
    """Policy by name or path."""
    trust: bool = False
    """Whether it may be loaded from a file in which code can be hidden."""

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
        """The robot. Raises what reading it does."""
        return get_robot(self.robot_source)

    @cached_property
    def env(self) -> Any:
        """A single environment with it, servos as our controllers command them, falls ignored. Raises ValueError."""
        from quad_env.envs.env import SimpleQuadEnv

        return SimpleQuadEnv(robot=self.robot.with_stiff_servos, terminate_on_fall=False)

    @property
    def figures(self) -> str:
        """Place where the figures of the robot can be given, in words."""
        if self.name.endswith(".toml"):
            return self.name
        return f"a TOML (python -m quad_env describe {self.name} --toml mine.toml)"


@dataclass(frozen=True)
class Finding:
    """Result of a check."""

    result: Literal["ok", "warning", "problem", "left out"]
    """A warning needs no repair, a problem does."""
    observed: str
    """Observation, one line."""
    cause: str = ""
    """Likely cause; of warnings and problems."""
    remedy: str = ""
    """What to do; of warnings and problems."""
    details: tuple[str, ...] = ()
    """More of what was seen, a line each."""


def ok(seen: str) -> Finding:
    """Finding of a check without fault."""
    return Finding("ok", seen)


def problem(seen: str, cause: str, remedy: str) -> Finding:
    """Finding that needs repair."""
    return Finding("problem", seen, cause, remedy)


@dataclass(frozen=True)
class DoctorCheck:
    """One check by name."""

    name: str
    place: str
    """Module and function of a Subject, `quad_env.doctor.model:model`; loaded late, since it may not load."""
    needs: tuple[str, ...] = ()
    """Checks that have to succeed first, since this one would only find their problems again."""

    def run(self, subject: DoctorSubject) -> Finding:
        """Finding of the check; an unexpected error is a problem too."""
        module, _, function = self.place.partition(":")
        try:
            found: Finding = getattr(import_module(module), function)(subject)
        except ModuleNotFoundError as error:
            return problem(
                f"{error.name} is not installed", "a package is missing", "pip install -U simple-quad, or -e ."
            )
        except Exception as error:
            text = " ".join(str(error).split()) or type(error).__name__
            return problem(text, f"{type(error).__name__} in the check itself", "report it, with this line")
        return found


def run_checks(checks: Iterable[DoctorCheck], subject: DoctorSubject) -> Iterator[tuple[str, Finding]]:
    """Name and finding of each check, in their order; one whose needs are not met is left out."""
    broken: set[str] = set()
    for check in checks:
        if missing := [name for name in check.needs if name in broken]:
            finding = Finding("left out", f"not before {' and '.join(missing)}")
        else:
            finding = check.run(subject)
        if finding.result in ("problem", "left out"):
            broken.add(check.name)
        yield check.name, finding
