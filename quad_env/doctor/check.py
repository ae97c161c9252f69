"""Basic classes of the command `doctor`: the examined robot and policy, a check, and its result.

`run_checks` runs checks in order. The function leaves out a check that depends on another check which has found a
problem.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, Literal

from quad_env.cli.extras import remedy
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot


@dataclass(frozen=True)
class DoctorSubject:
    """Robot and optional policy that the checks of `doctor` and `describe` examine."""

    robot_source: str | Robot = "simple_quad"
    """Name of the examined robot, path of its MJCF, URDF or TOML file, or the robot itself."""
    policy: str | None = None
    """Name or path of the examined policy; None if no policy is examined."""
    trust: bool = False
    """True if the policy may be loaded from a file format that can contain code, which loading would execute."""

    @property
    def name(self) -> str:
        """Name of the examined robot, or path of its file, for texts that the user reads."""
        return (
            self.robot_source
            if isinstance(self.robot_source, str)
            else str(self.robot_source.source or self.robot_source.name)
        )

    @cached_property
    def robot(self) -> Robot:
        """The examined robot; it is loaded at the first access.

        A file that is missing or no valid model raises FileNotFoundError or ModelError. ModuleNotFoundError is raised
        if the robot's package is not installed.
        """
        return get_robot(self.robot_source)

    @cached_property
    def env(self) -> Any:
        """Environment with the examined robot, with its gains `stiff_servo`; a fall does not end an episode.

        ValueError is raised if the robot cannot be simulated.
        """
        from quad_env.envs.env import SimpleQuadEnv

        return SimpleQuadEnv(robot=self.robot.with_stiff_servos, terminate_on_fall=False)

    @property
    def parameter_source(self) -> str:
        """Text for remedies: the TOML file in which the user can change parameters of the examined robot.

        If the robot has no TOML file, the text contains the command that makes this file.
        """
        if self.name.endswith(".toml"):
            return self.name
        return f"a TOML (python -m quad_env describe {self.name} --toml mine.toml)"


@dataclass(frozen=True)
class Finding:
    """Result of a check of the command `doctor`; made by the function of the check or by `run_checks`."""

    result: Literal["ok", "warning", "problem", "left out"]
    """Outcome of the check; a "problem" must be repaired, and a check that was not run is "left out"."""
    observed: str
    """Text of one line about the fault that the check has found, or about the property that has no fault."""
    cause: str = ""
    """Text about the likely cause of a warning or problem; empty if the check has found no fault."""
    remedy: str = ""
    """Text about the remedy of a warning or problem; empty if the check has found no fault."""
    details: tuple[str, ...] = ()
    """Further observations for the user, one line each, such as omitted parts of a model."""


def ok(observed: str) -> Finding:
    """Return the finding of a check that has found no fault; `observed` is a line about the examined property."""
    return Finding("ok", observed)


def problem(observed: str, cause: str, remedy: str) -> Finding:
    """Return the finding of a check that has found a fault that must be repaired.

    Args:
        observed: Text of one line about the fault.
        cause: Text about the likely cause of the fault.
        remedy: Text about the remedy of the fault.

    Returns:
        The finding.
    """
    return Finding("problem", observed, cause, remedy)


@dataclass(frozen=True)
class DoctorCheck:
    """One check of the command `doctor`: its name, its function, and the checks that must precede it.

    The checks of this package examine the installation and the robot; the package `live` has checks of policies.
    """

    name: str
    """Name of the check in the printed report, such as `limits`."""
    place: str
    """Module and name of the function that performs the check, such as `quad_env.doctor.model:model`.

    The function takes a `DoctorSubject` and returns a `Finding`. Only the method `run` imports the module, because the
    import itself may fail.
    """
    needs: tuple[str, ...] = ()
    """Names of the checks that must succeed before this check is run.

    If one of these checks finds a problem, this check is left out, because it would only report the same problem again.
    """

    def run(self, subject: DoctorSubject) -> Finding:
        """Run the check on the robot and policy in `subject`, and return its finding.

        An unexpected exception becomes the finding of a problem.
        """
        module, _, function = self.place.partition(":")
        try:
            finding: Finding = getattr(import_module(module), function)(subject)
        except ModuleNotFoundError as error:
            return problem(
                f"{error.name} is not installed", "a package is missing", remedy((error.name or "").partition(".")[0])
            )
        except Exception as error:
            text = " ".join(str(error).split()) or type(error).__name__
            return problem(text, f"{type(error).__name__} in the check itself", "report it, with this line")
        return finding


def run_checks(checks: Iterable[DoctorCheck], subject: DoctorSubject) -> Iterator[tuple[str, Finding]]:
    """Run the checks of the command `doctor` in order, and yield the name and finding of each.

    A check is left out if it needs another check that has found a problem or was left out.

    Args:
        checks: Checks in the order of execution; each follows the checks that it needs.
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
