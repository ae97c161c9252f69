"""Results of a finished or unfinished run for the commands that make tables and figures of it."""

import sys
from collections.abc import Sequence
from pathlib import Path

from evaluate.analysis.entries import Entry
from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import severity_axes
from evaluate.analysis.stored_run import analyse_run
from evaluate.cells import PolicyScenarioResult
from evaluate.records.store import read_run
from quad_env.cli.command_line import UsageError
from quad_env.cli.progress import show_waiting


def load_results(folder: Path) -> Results:
    """Read and analyse the run in a results folder; a note on stderr says if the run is not finished.

    Args:
        folder: Results folder.

    Returns:
        Results of the run.

    Raises:
        UsageError: The folder has no finished results.
    """
    run = read_run(folder)
    if not run.cells:
        raise UsageError(f"{folder} holds no finished part of a comparison yet")
    if not run.complete:
        total = len(run.manifest.cells)
        print(f"{folder} is not finished: {len(run.cells)} of {total} pairs of policy and scenario", file=sys.stderr)
    with show_waiting("working out the results"):
        return analyse_run(run)


def select_entries(entries: Sequence[Entry], names: Sequence[str]) -> tuple[Entry, ...]:
    """Select the entries that the option --policies names, in its order.

    Args:
        entries: All entries of a run.
        names: Names of entries; empty for all.

    Returns:
        The selected entries.

    Raises:
        UsageError: A name is not among the entries.
    """
    by_name = {entry.name: entry for entry in entries}
    if unknown := [name for name in names if name not in by_name]:
        raise UsageError(f"--policies: not in this run, got {', '.join(unknown)}; valid: {', '.join(by_name)}")
    return tuple(by_name[name] for name in dict.fromkeys(names or by_name))


def select_scenarios(cells: Sequence[PolicyScenarioResult], names: Sequence[str]) -> tuple[str, ...]:
    """Select the scenarios that the option --scenarios names; the name of an axis stands for its scenarios.

    Args:
        cells: Results of a run.
        names: Names of scenarios or disturbance axes; empty for all.

    Returns:
        Names of the selected scenarios; empty if `names` is empty.

    Raises:
        UsageError: A name is neither a scenario nor an axis of the run.
    """
    axes = {axis.name: axis.scenario_names for axis in severity_axes(cells)}
    scenarios = {name: (name,) for axis in axes.values() for name in axis}
    known = scenarios | axes
    if unknown := [name for name in names if name not in known]:
        raise UsageError(f"--scenarios: not in this run, got {', '.join(unknown)}; valid: {', '.join(known)}")
    return tuple(scenario for name in names for scenario in known[name])
