"""Common code of the benchmark commands.

The module defines the common options of the commands, checks the options, runs the benchmark, prints tables, and writes
the JSON file.
"""

import dataclasses
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.table import Table

from benchmarks.support.bars import BARS, RequirementCheck
from benchmarks.support.measure import Quartiles, machine_facts, machine_line
from evaluate.analysis.results import nan_to_null
from quad_env import MAX_EPISODE_STEPS
from quad_env.cli.command_line import UsageError, check_numbers, make_folder_of, parse
from quad_env.cli.program import exit_code
from quad_env.files.writing import write_atomically

WIDTH = 100
"""Width of the printed tables, characters."""
OPTION_LIMITS = {
    "rounds": (1, 10_000),
    "envs": (1, 65_536),
    "threads": (1, 256),
    "robot_steps": (1, 10**9),
    "warm_up": (1, MAX_EPISODE_STEPS),
    "calls": (10, 10**7),
    "frames": (1, 10**6),
    "seconds": (1.0, 1e6),
}
"""Name of an option -> smallest and largest valid value.

The limits hold for every benchmark command that has an option of this name.
"""


@dataclass(frozen=True)
class OutputOptions:
    """Options that every benchmark command has."""

    quick: bool = False
    """Test the command with a tiny workload; the measured values are meaningless."""
    json: Path | None = None
    """JSON file for the measured values; an existing file is replaced."""


@dataclass(frozen=True)
class MeasurementOptions(OutputOptions):
    """Options of every benchmark command that measures in rounds."""

    rounds: int = 15
    """Number of measurement rounds; results are medians over the rounds, with quartiles in brackets."""


OptionsT = TypeVar("OptionsT", bound=OutputOptions)


@dataclass(frozen=True)
class BenchmarkResult:
    """Result of a benchmark command: values for the JSON file, tables to print, and checked requirements."""

    figures: dict[str, Any]
    """Name of a measurement -> measured values; written to the JSON file under the key `figures`."""
    tables: tuple[Table, ...]
    """Tables that the command prints."""
    checks: tuple[RequirementCheck, ...] = ()
    """Requirements that the command has checked, each with its measured values."""
    notes: tuple[str, ...] = ()
    """Lines that the command prints below the tables."""
    unmeasured: tuple[str, ...] = ()
    """Names of requirements in BARS that other benchmark commands check, but this command does not."""


def make_command(
    kind: type[OptionsT], measure: Callable[[OptionsT], BenchmarkResult], program: str, description: str | None
) -> Callable[..., int]:
    """Create the main function of a benchmark command.

    The main function parses the options, runs the benchmark, prints the result and writes the JSON file.

    Args:
        kind: Dataclass of the options.
        measure: Function that runs the benchmark with the parsed options and returns the result.
        program: Name of the command: NAME in `python -m NAME`.
        description: Description of the command in the output of --help.

    Returns:
        Function that takes a list of command-line arguments, or None for the arguments of the process. It returns the
        exit code: 0 after success, 2 after a user error with a one-line message, 130 after Ctrl-C.
    """

    def run(arguments: Sequence[str]) -> int:
        options = parse(kind, list(arguments), program=f"python -m {program}", description=description or "")
        _check(options)
        facts = machine_facts()
        write_results(measure(options), facts, options, program)
        return 0

    return lambda arguments=None: exit_code(lambda: run(sys.argv[1:] if arguments is None else arguments))


def _check(options: OutputOptions) -> None:
    """Check the options of a benchmark command, and create the folder of the JSON file.

    Args:
        options: Parsed options.

    Raises:
        UsageError: A number is outside its limits, a list is empty or contains a value twice, or the folder cannot be
            created.
    """
    check_numbers(options, {name: limits for name, limits in OPTION_LIMITS.items() if hasattr(options, name)})
    for name, value in vars(options).items():
        if isinstance(value, tuple) and len(set(value)) < max(len(value), 1):
            option = f"--{name.replace('_', '-')}"
            raise UsageError(f"{option} names a value twice" if value else f"{option}: none given; name at least one")
    if options.json:
        make_folder_of(options.json, "--json")


def write_results(result: BenchmarkResult, facts: dict[str, Any], options: OutputOptions, program: str) -> None:
    """Print the result of a benchmark command, and write the JSON file if the option `json` is set.

    Args:
        result: Result of the command.
        facts: Facts about the machine, from `machine_facts`.
        options: Options of the command.
        program: Name of the command: NAME in `python -m NAME`.
    """
    console = Console(width=WIDTH, highlight=False)
    for rows in result.tables:
        console.print(rows)
    for note in result.notes:
        console.print(note, markup=False, soft_wrap=True)
    if result.checks:
        console.print(checks_table(result.checks, result.unmeasured))
    console.print(machine_line(facts), style="dim", soft_wrap=True)
    if options.json:
        record = {
            "benchmark": program,
            "options": dataclasses.asdict(options),
            "machine": facts,
            "figures": result.figures,
            "checks": [dataclasses.asdict(check) | {"met": check.is_met} for check in result.checks],
        }
        write_atomically(options.json, (json.dumps(to_json_types(record), indent=2) + "\n").encode())


def checks_table(checks: Sequence[RequirementCheck], unmeasured: Sequence[str]) -> Table:
    """Create the table that shows each requirement with its limits and measured values.

    Args:
        checks: Checked requirements with their measured values.
        unmeasured: Names of requirements without measured values. The table shows the command that measures each of
            them.

    Returns:
        The table, with one row per requirement.
    """
    rows = make_table("Limits", "figure", "bar", "measured", "")
    for check in checks:
        requirement = BARS[check.bar]
        values = ", ".join(
            f"{value:.4g}{limit.unit}" for value, limit in zip(check.values, requirement.limits, strict=True)
        )
        state = "[green]met[/]" if check.is_met else "[red]not met[/]"
        rows.add_row(requirement.name, _limits(check.bar), values, state)
    for name in unmeasured:
        rows.add_row(BARS[name].name, _limits(name), f"python -m benchmarks.{BARS[name].command}", "")
    return rows


def _limits(bar: str) -> str:
    """Return the limits of the requirement with the name `bar` as text, for example `≥ 0.9 or ≤ 6 µs`."""
    return " or ".join(map(str, BARS[bar].limits))


def make_table(title: str, *heads: str) -> Table:
    """Create an empty table; the first column is left-aligned, all other columns are right-aligned.

    Args:
        title: Title above the table.
        *heads: Headings of the columns.

    Returns:
        The table, to which the caller adds rows.
    """
    table = Table(title=title, title_justify="left", title_style="bold")
    for index, head in enumerate(heads):
        table.add_column(head, justify="right" if index else "left")
    return table


def format_quartiles(value: Quartiles, digits: int = 2) -> str:
    """Format median and quartiles as rich markup with `digits` decimals: `0.91 [0.90 … 0.92]`.

    Args:
        value: Median and quartiles of a measured value.
        digits: Number of decimals.

    Returns:
        The text, in which a backslash escapes the bracket for rich.
    """
    return f"{value.median:,.{digits}f} \\[{value.low:,.{digits}f} … {value.high:,.{digits}f}]"


def to_json_types(value: Any) -> Any:
    """Convert dataclasses, arrays and paths to JSON types, in dictionaries and lists of any depth.

    NaN and infinite numbers become None, because JSON cannot represent them.
    """
    return nan_to_null(json.loads(json.dumps(value, default=_plain)))


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    return str(value) if isinstance(value, Path) else dataclasses.asdict(value)
