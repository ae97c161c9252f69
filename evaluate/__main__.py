"""`python -m evaluate`: compare policies on the same episodes of every scenario."""

from evaluate import launcher

if __name__ == "__main__":  # before the imports that take time
    launcher.leave_on_interrupt()

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from evaluate.command_line import UsageError, fail, parse, survive_narrow_encodings

if TYPE_CHECKING:
    from evaluate.experiment import Cell, Entrant
    from quad_env.scenarios import Scenario

PROGRAM = "python -m evaluate"
DEFAULT_POLICIES = ("document", "document_repaired", "trot", "residual")
FILES = ("results.json", "episodes.parquet", "report.html")
"""What a comparison leaves in its folder."""
MOST_EPISODES = 1_000_000
MOST_THREADS = 256


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class Options:
    """What to compare, and where the outcome goes."""

    policies: tuple[str, ...] = DEFAULT_POLICIES
    """Names of policies, or folders of trained ones such as models/residual."""
    scenarios: tuple[str, ...] = ("flat", "push", "rough")
    """Names of scenarios, or `all`."""
    episodes: int = 128
    """Episodes of 10 s of each policy on each scenario (count). The same for every policy."""
    seed: int = 0
    """Which set of episodes (whole number from 0). Training never sees any of them, whatever its own seed."""
    out: Path = Path("results/evaluation")
    """Folder for results.json, episodes.parquet and report.html; files of these names are replaced."""
    threads: int = _cores()
    """Threads of the simulation (count; default: this machine's cores). The outcome does not depend on it."""


@dataclass(frozen=True)
class Plan:
    """Options that have been checked: everything exists and can be written."""

    entrants: "tuple[Entrant, ...]"
    scenarios: "tuple[Scenario, ...]"
    options: Options


def main(arguments: list[str] | None = None) -> int:
    """Run the command; the exit code: 0, 2 after a user's mistake, 130 after Ctrl-C."""
    survive_narrow_encodings()
    try:
        return _compare(_check(parse(Options, arguments, program=PROGRAM, description=__doc__ or "")))
    except UsageError as mistake:
        return fail(str(mistake))
    except KeyboardInterrupt:
        print("interrupted: no further file was written", file=sys.stderr)
        return launcher.INTERRUPTED


def _check(options: Options) -> Plan:
    """Everything that can be wrong, before anything is simulated."""
    from evaluate import battery
    from policies.files import make_writable_folder

    for name, value, low, high in (
        ("episodes", options.episodes, 1, MOST_EPISODES),
        ("threads", options.threads, 1, MOST_THREADS),
        ("seed", options.seed, 0, 2**63 - 1),
    ):
        if not low <= value <= high:
            raise UsageError(f"--{name} must be a whole number from {low} to {high}, not {value}")
    try:
        scenarios = battery.resolve(options.scenarios)
    except ValueError as error:
        raise UsageError(f"--scenarios: {error}") from error
    entrants = _entrants(options.policies)
    try:
        make_writable_folder(options.out)
    except OSError as error:
        raise UsageError(
            f"cannot write to the folder {options.out} ({error.strerror}); name another one with --out"
        ) from error
    if taken := [str(options.out / name) for name in FILES if (options.out / name).is_dir()]:
        raise UsageError(f"{', '.join(taken)} is to be a file, but is a folder; name another folder with --out")
    return Plan(entrants, scenarios, options)


def _entrants(names: tuple[str, ...]) -> "tuple[Entrant, ...]":
    import policies
    from evaluate.experiment import Entrant

    labels = [name if name in policies.names() else name.rstrip("/\\") or name for name in names]
    if not labels:
        raise UsageError(f"--policies: none given; name at least one of {', '.join(policies.names())}, or a folder")
    places = [label if label in policies.names() else str(Path(label).resolve()) for label in labels]
    if repeated := sorted({label for label, place in zip(labels, places, strict=True) if places.count(place) > 1}):
        raise UsageError(f"--policies: {', '.join(repeated)} given more than once; name each policy once")
    try:
        return tuple(Entrant(label, policies.resolve(label)) for label in labels)
    except policies.PolicyError as error:
        raise UsageError(f"--policies: {error}") from error


def _compare(plan: Plan) -> int:
    """Run every cell, then show and write what was done, even if the user interrupted."""
    # Everything that is needed to the end, so that no interrupt can come in the middle of an import.
    import quad_env.vector_env  # noqa: F401
    from evaluate import ending
    from evaluate.experiment import cells, evaluation_seeds
    from evaluate.progress import show_progress

    options = plan.options
    done: list[Cell] = []
    total = len(plan.entrants) * len(plan.scenarios)
    seeds = evaluation_seeds(options.seed, options.episodes)
    interrupted = False
    try:
        launcher.raise_on_interrupt()
        with show_progress(total) as progress:
            done.extend(cells(plan.entrants, plan.scenarios, seeds, options.threads, progress))
    except KeyboardInterrupt:
        interrupted = True
        if not done:
            raise
    ending.conclude(done, options.out, seed=options.seed, episodes=options.episodes, complete=not interrupted)
    if interrupted:
        print(f"interrupted: wrote the {len(done)} finished parts of {total} to {options.out}", file=sys.stderr)
    return launcher.INTERRUPTED if interrupted else 0


if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
