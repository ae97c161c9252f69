"""What all commands share: options, their limits, printed tables, the JSON file and the exit code."""

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
"""Columns that every table fits into."""
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
"""Smallest and largest value of each option, by name, in all commands."""


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
    """What a command measured: figures for the JSON file, tables to print, and figures that have limits."""

    figures: dict[str, Any]
    tables: tuple[Table, ...]
    checks: tuple[RequirementCheck, ...] = ()
    notes: tuple[str, ...] = ()
    unmeasured: tuple[str, ...] = ()
    """Bars that another command measures."""


def make_command(
    kind: type[OptionsT], measure: Callable[[OptionsT], BenchmarkResult], program: str, description: str | None
) -> Callable[..., int]:
    """A function of the command line's words, by default those of the process: it parses, measures, prints and writes.

    It returns the exit code: 0, 2 with one line after a user's mistake, 130 after Ctrl-C.
    """

    def run(words: Sequence[str]) -> int:
        options = parse(kind, list(words), program=f"python -m {program}", description=description or "")
        _check(options)
        facts = machine_facts()
        write_results(measure(options), facts, options, program)
        return 0

    return lambda words=None: exit_code(lambda: run(sys.argv[1:] if words is None else words))


def _check(options: OutputOptions) -> None:
    """Raise UsageError, one line, for a number beyond its limits, an empty or double list, or no place for the file."""
    check_numbers(options, {name: limits for name, limits in OPTION_LIMITS.items() if hasattr(options, name)})
    for name, value in vars(options).items():
        if isinstance(value, tuple) and len(set(value)) < max(len(value), 1):
            option = f"--{name.replace('_', '-')}"
            raise UsageError(f"{option} names a value twice" if value else f"{option}: none given; name at least one")
    if options.json:
        make_folder_of(options.json, "--json")


def write_results(outcome: BenchmarkResult, facts: dict[str, Any], options: OutputOptions, program: str) -> None:
    """Print the tables, the notes and the figures with limits; write the JSON file."""
    console = Console(width=WIDTH, highlight=False)
    for part in outcome.tables:
        console.print(part)
    for note in outcome.notes:
        console.print(note, markup=False, soft_wrap=True)
    if outcome.checks:
        console.print(checks_table(outcome.checks, outcome.unmeasured))
    console.print(machine_line(facts), style="dim", soft_wrap=True)
    if options.json:
        record = {
            "benchmark": program,
            "options": dataclasses.asdict(options),
            "machine": facts,
            "figures": outcome.figures,
            "checks": [dataclasses.asdict(row) | {"met": row.is_met} for row in outcome.checks],
        }
        write_atomically(options.json, (json.dumps(to_json_types(record), indent=2) + "\n").encode())


def checks_table(checks: Sequence[RequirementCheck], unmeasured: Sequence[str]) -> Table:
    """The figures with their limits; an `unmeasured` one names the command that measures it."""
    rows = make_table("Limits", "figure", "bar", "measured", "")
    for each in checks:
        limits = BARS[each.bar].limits
        values = ", ".join(f"{value:.4g}{limit.unit}" for value, limit in zip(each.values, limits, strict=True))
        rows.add_row(
            BARS[each.bar].name, _limits(each.bar), values, "[green]met[/]" if each.is_met else "[red]not met[/]"
        )
    for name in unmeasured:
        rows.add_row(BARS[name].name, _limits(name), f"python -m benchmarks.{BARS[name].command}", "")
    return rows


def _limits(bar: str) -> str:
    return " or ".join(map(str, BARS[bar].limits))


def make_table(title: str, *heads: str) -> Table:
    """An empty table, its first column left-aligned, the others right-aligned."""
    made = Table(title=title, title_justify="left", title_style="bold")
    for number, head in enumerate(heads):
        made.add_column(head, justify="right" if number else "left")
    return made


def format_quartiles(value: Quartiles, digits: int = 2) -> str:
    """Median, and the quartiles in brackets."""
    return f"{value.median:,.{digits}f} \\[{value.low:,.{digits}f} … {value.high:,.{digits}f}]"


def to_json_types(value: Any) -> Any:
    """JSON types of dataclasses, arrays and paths, nested to any depth; None for numbers that are not finite."""
    return nan_to_null(json.loads(json.dumps(value, default=_plain)))


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    return str(value) if isinstance(value, Path) else dataclasses.asdict(value)
