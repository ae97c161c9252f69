"""Find faults of the installation, a robot or a policy: each check is printed as it ends, then a summary."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from quad_env.cli.command_line import UsageError
from quad_env.cli.format import with_count
from quad_env.doctor.check import DoctorCheck, DoctorSubject, Finding, run_checks
from quad_env.files.text import escape_control_characters
from quad_env.robots.registry import ROBOTS, parse_robot

PACKAGE = "quad_env.doctor"
"""Name of the Python package with the modules that contain the functions of the checks."""
CHECKS = (
    DoctorCheck("packages", f"{PACKAGE}.installation:packages"),
    DoctorCheck("mujoco", f"{PACKAGE}.installation:mujoco", ("packages",)),
    DoctorCheck("opengl", f"{PACKAGE}.installation:opengl", ("mujoco",)),
    DoctorCheck("model", f"{PACKAGE}.model:model", ("mujoco",)),
    DoctorCheck("names", f"{PACKAGE}.model:names", ("model",)),
    DoctorCheck("limits", f"{PACKAGE}.model:limits", ("model",)),
    DoctorCheck("joints", f"{PACKAGE}.model:joints", ("limits",)),
    DoctorCheck("stands", f"{PACKAGE}.stance_check:stands", ("joints",)),
    DoctorCheck("plausible", f"{PACKAGE}.model:plausible", ("stands",)),
)
"""Checks of the installation and the robot that `doctor` performs, in the order of execution.

Each check follows the checks that it needs. If several checks find problems, the first one must be repaired first.
"""
NO_BENCH_NOTE = "walking and policies were not examined: they need simple-quad-bench, or a clone of the project"
"""Note at the end of the report of `doctor` if only the package `quad_env` is installed, but not the policies."""


@dataclass(frozen=True)
class DoctorOptions:
    """Examine installation, robot and policy; the exit code is 1 where something is wrong."""

    robot: str = "simple_quad"
    """Robot: a name of quad_env.ROBOTS, or the path of its MJCF, URDF or TOML."""
    policy: str | None = None
    """Policy to examine too: its name, folder or file."""
    trust: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Load the policy from a file that can hide code, a .zip of Stable-Baselines3 or a TorchScript .pt."""
    write: Path | None = None
    """File for the description of the policy, as TOML, to see and correct what was understood."""


def main(options: DoctorOptions) -> int:
    """Run the checks of the installation and the robot, and return the exit code of the command.

    This function is the command if only the package `quad_env` is installed. Options about policies raise UsageError,
    because this package contains no policies.
    """
    if options.policy is not None or options.write is not None:
        raise UsageError(
            "policies are part of simple-quad-bench, or of a clone, not of quad_env alone: no --policy, no --write"
        )
    return run(options, None)


def run(options: DoctorOptions, policy_checks: tuple[DoctorCheck, ...] | None) -> int:
    """Run the checks of the command `doctor`, and print their findings. An unknown robot raises UsageError.

    Args:
        options: Options of the command, with the robot and the policy to examine.
        policy_checks: Checks of policies; None if only the package `quad_env` is installed, without policies.

    Returns:
        Exit code: 0 if no check has found a problem, else 1.
    """
    if options.robot not in ROBOTS and not Path(options.robot).is_file():
        parse_robot(options.robot)  # This call raises UsageError with a message for the user.
    subject = DoctorSubject(options.robot, options.policy, options.trust)
    counts = Counter[str]()
    for name, finding in run_checks((*CHECKS, *(policy_checks or ())), subject):
        counts[finding.result] += 1
        print(escape_control_characters("\n".join(_lines(name, finding))), flush=True)
    faults = [with_count(counts[kind], kind) for kind in ("problem", "warning") if counts[kind]]
    others = [f"{counts[kind]} {kind}" for kind in ("ok", "left out") if counts[kind]]
    print(", ".join(faults + others) + (f"; {NO_BENCH_NOTE}" if policy_checks is None else ""))
    return int(counts["problem"] > 0)


def _lines(name: str, finding: Finding) -> Iterator[str]:
    """Yield the lines of the printed report about the check `name` with the result `finding`.

    The lines contain the observation, its details, and the cause and remedy of a fault.
    """
    yield f"{finding.result:9} {name:11} {finding.observed}"
    yield from (f"{'':22}{line}" for line in finding.details)
    if finding.remedy:
        yield f"{'':22}cause:  {finding.cause}"
        yield f"{'':22}remedy: {finding.remedy}"
