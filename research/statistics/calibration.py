"""Error rates of confidence intervals and tests on synthetic data: `python -m research calibration`.

Each row is about one interval or test, which is repeated on many data sets with a known true value. The row shows how
often the interval contains the true value, or how often the test finds a difference that does not exist. A second table
shows the error rates of evaluations with `--until settled`, also on synthetic data.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from quad_env.cli.command_line import UsageError, check_numbers
from research.pages.blocks import read_page, write_block
from research.statistics import checks, settled
from research.statistics.checks import CalibrationCheck

LIMITS = {
    "sets": (2, 10_000_000),
    "runs": (1, 10_000_000),
    "episodes": (2, 1_000_000),
    "fall_probabilities": (0.001, 0.999),
    "seed": (0, 2**31),
}
"""Name of an option -> smallest and largest valid value."""
PLACE = "settled"
"""Name of the part of a Markdown page with the error rates of evaluations with `--until settled`.

The command `calibration` writes the part between the lines `<!-- settled -->` and `<!-- /settled -->`.
"""


@dataclass(frozen=True)
class CalibrationOptions:
    """Options of the command `calibration`: checks to run, and numbers of data sets and episodes."""

    sets: int = 2000
    """Number of synthetic data sets for each check."""
    episodes: tuple[int, ...] = (64, 128)
    """Numbers of episodes in a data set; each check is repeated for each number."""
    fall_probabilities: tuple[float, ...] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
    """Fall probabilities of the synthetic policies, 0 to 1."""
    runs: int = 1000
    """Number of simulated evaluations with `--until settled` for each set of scenarios."""
    only: str = ""
    """Run only the checks with this text in their name; all checks if empty."""
    seed: int = 0
    """Seed of the synthetic data sets, >= 0."""
    page: Path | None = None
    """Markdown file; the table of evaluations with `--until settled` is written between `<!-- settled -->` and
    `<!-- /settled -->`."""


def main(options: CalibrationOptions) -> int:
    """Run the command `calibration`: run the checks and print their error rates.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: An option is invalid.
    """
    if not options.episodes or not options.fall_probabilities:
        raise UsageError("--episodes and --fall-probabilities must each have at least one value")
    check_numbers(options, LIMITS)
    all_checks = checks.all_checks(options.episodes, options.fall_probabilities)
    rows = [check for check in all_checks if options.only in check.name]
    batteries = [battery for battery in settled.BATTERIES if options.only in battery.name]
    if not rows and not batteries:
        raise UsageError(f"--only: no row is named like {options.only}")
    if options.page is not None:
        read_page(options.page, PLACE)
    if rows:
        _run(rows, options)
    if batteries:
        table = settled.markdown_table(batteries, options.runs, options.seed)
        print("\n".join(table))
        write_block(options.page, table, PLACE)
    return 0


def _run(rows: list[CalibrationCheck], options: CalibrationOptions) -> None:
    """Run the checks in `rows`, and print the result of each check as soon as it is known.

    The result is the fraction of the data sets on which the interval contains the true value, or the test is
    significant.
    """
    standard_error = 100.0 * np.sqrt(0.05 * 0.95 / options.sets)
    print(f"share of {options.sets} data sets, %; its standard error is {standard_error:.1f}")
    head = "interval holds the truth, or test claims a difference"
    print(f"{head:54} {'n':>4} {'falls':>6} {'share':>6} {'meant':>6}")
    num_outside = 0
    for check in track(rows, "intervals and tests", console=Console(stderr=True)):
        share = checks.rejection_rate(check, options.sets, options.seed)
        low, high = check.bounds
        is_within = low <= share <= high
        num_outside += not is_within
        figures = " ".join(f"{_percent(value):>6}" for value in (check.fall_probability, share, check.expected))
        verdict = "" if is_within else f"  not in {100 * low:g} to {100 * high:g}"
        print(f"{check.name:54} {check.count:4} {figures}{verdict}", flush=True)
    print(f"{num_outside} of {len(rows)} rows out of bounds")


def _percent(value: float) -> str:
    """Format a fraction, 0 to 1, in per cent with one decimal; NaN gives an empty text."""
    return "" if np.isnan(value) else f"{100 * value:.1f}"
