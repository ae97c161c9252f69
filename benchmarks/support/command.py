"""Common parts of all benchmark commands: options with their limits, tables, JSON file, exit code."""

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
"""Width of the console to which tables are printed, characters."""
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
"""Name of an option -> its smallest and largest valid value, in all commands that have the option."""


@dataclass(frozen=True)
class OutputOptions:
    """Options of every command."""

    quick: bool = False
    """Sizes so small that the figures mean nothing: whether the command works."""
    json: Path | None = None
    """File for the figures (JSON); replaced if there."""


@dataclass(frozen=True)
class MeasurementOptions(OutputOptions):
    """Options of every measurement."""

    rounds: int = 15
    """Interleaved rounds (count). Figures are medians over them, in brackets the quartiles."""


OptionsT = TypeVar("OptionsT", bound=OutputOptions)


@dataclass(frozen=True)
class BenchmarkResult:
    """Result of a command: values for the JSON file, tables to print, and checked requirements."""

    figures: dict[str, Any]
    """Name -> measured values, for the entry `figures` of the JSON file."""
    tables: tuple[Table, ...]
    """Tables to print."""
    checks: tuple[RequirementCheck, ...] = ()
    """Requirements that the command checked, with their measured values."""
    notes: tuple[str, ...] = ()
    """Lines to print below the tables."""
    unmeasured: tuple[str, ...] = ()
    """Names of requirements that another command measures."""


def make_command(
    kind: type[OptionsT], measure: Callable[[OptionsT], BenchmarkResult], program: str, description: str | None
) -> Callable[..., int]:
    """Create the main function of a command: parse the options, measure, print, write the JSON file.

    Args:
        kind: Dataclass of the options.
        measure: Function that runs the benchmark with the parsed options.
        program: Name of the command: NAME in `python -m NAME`.
        description: Text for --help.

    Returns:
        Function of a list of command-line arguments; None takes the arguments of the process. It returns the exit code:
        0 after success, 2 after a user error with a one-line message, 130 after Ctrl-C.
    """

    def run(arguments: Sequence[str]) -> int:
        options = parse(kind, list(arguments), program=f"python -m {program}", description=description or "")
        _check(options)
        facts = machine_facts()
        write_results(measure(options), facts, options, program)
        return 0

    return lambda arguments=None: exit_code(lambda: run(sys.argv[1:] if arguments is None else arguments))


def _check(options: OutputOptions) -> None:
    """Check the options of a command, and make the folder of the JSON file.

    Args:
        options: Parsed options.

    Raises:
        UsageError: A number is outside its limits, a list is empty or has a value twice, or the folder cannot be made.
    """
    check_numbers(options, {name: limits for name, limits in OPTION_LIMITS.items() if hasattr(options, name)})
    for name, value in vars(options).items():
        if isinstance(value, tuple) and len(set(value)) < max(len(value), 1):
            option = f"--{name.replace('_', '-')}"
            raise UsageError(f"{option} names a value twice" if value else f"{option}: none given; name at least one")
    if options.json:
        make_folder_of(options.json, "--json")


def write_results(result: BenchmarkResult, facts: dict[str, Any], options: OutputOptions, program: str) -> None:
    """Print the result of a command, and write the JSON file if the option `json` is set.

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
    """Create the table of requirements.

    Args:
        checks: Requirements with measured values.
        unmeasured: Names of other requirements. The table shows the commands that measure them.

    Returns:
        The table.
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
    """Format the limits of the requirement `bar`, for example `≥ 0.9 or ≤ 6 µs`."""
    return " or ".join(map(str, BARS[bar].limits))


def make_table(title: str, *heads: str) -> Table:
    """Create a table without rows, with a `title` and column `heads`; the first column is left-aligned."""
    table = Table(title=title, title_justify="left", title_style="bold")
    for index, head in enumerate(heads):
        table.add_column(head, justify="right" if index else "left")
    return table


def format_quartiles(value: Quartiles, digits: int = 2) -> str:
    """Format median and quartiles as rich markup with `digits` decimals: `0.91 [0.90 … 0.92]`.

    Args:
        value: Quartiles.
        digits: Number of decimals.

    Returns:
        The text.
    """
    return f"{value.median:,.{digits}f} \\[{value.low:,.{digits}f} … {value.high:,.{digits}f}]"


def to_json_types(value: Any) -> Any:
    """Convert dataclasses, arrays and paths to JSON types, in dictionaries and lists of any depth.

    Numbers that are not finite become None.
    """
    return nan_to_null(json.loads(json.dumps(value, default=_plain)))


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    return str(value) if isinstance(value, Path) else dataclasses.asdict(value)
