"""The spread over training seeds, as a table on the terminal."""

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from evaluate.analysis.comparison import ERRORS, FALL_RATE
from evaluate.analysis.results import Results
from evaluate.analysis.training_seeds import SeedSpread, seed_spreads
from evaluate.terminal.format import number, percent

SHOWN = (FALL_RATE, *ERRORS)


def print_spread(results: Results, console: Console) -> None:
    """A table for each run with several seeds, if there is one."""
    runs: dict[str, dict[str, dict[str, SeedSpread]]] = {}
    for spread in seed_spreads(results.cells):
        runs.setdefault(spread.run, {}).setdefault(spread.scenario, {})[spread.metric] = spread
    for run, scenarios in runs.items():
        console.print(_table(run, scenarios))
        console.print()


def _table(run: str, scenarios: dict[str, dict[str, SeedSpread]]) -> Table:
    count = next(iter(scenarios.values()))[FALL_RATE].seeds
    title = f"{escape(run)}, {count} training seeds: mean ± standard deviation, lowest … highest"
    table = Table(
        title=title, title_justify="left", title_style="", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False
    )
    for name in ("scenario", "falls", "velocity\nerror m/s", "yaw-rate\nerror rad/s", "mean vel.\nerror m/s"):
        table.add_column(name, justify="left" if name == "scenario" else "right")
    for scenario, metrics in scenarios.items():
        table.add_row(escape(scenario), *(_figures(metrics[name]) for name in SHOWN))
    return table


def _figures(spread: SeedSpread) -> str:
    form = percent if spread.metric == FALL_RATE else number
    middle = f"{form(spread.mean)} ± {form(spread.standard_deviation)}"
    return f"{middle}\n{form(spread.lowest)} … {form(spread.highest)}"
