"""The spread over training seeds, as the results and the terminal show it."""

from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from evaluate.comparison import ERRORS, FALL_RATE
from evaluate.format import number, percent
from evaluate.statistics.training_seeds import SeedSpread, seed_spreads, training_runs

if TYPE_CHECKING:
    from evaluate.results import Results

SHOWN = (FALL_RATE, *ERRORS)
_FIGURES = ("seeds", "mean", "lowest", "highest", "standard_deviation", "ci")


def as_json(results: "Results") -> dict[str, Any]:
    """`training_seeds` of results.json: run -> its policies, and scenario -> metric -> figures; NaN for none."""
    out: dict[str, Any] = {
        run: {"policies": list(policies), "scenarios": {}} for run, policies in training_runs(results.policies).items()
    }
    for spread in seed_spreads(results.cells):
        metrics = out[spread.run]["scenarios"].setdefault(spread.scenario, {})
        metrics[spread.metric] = {name: getattr(spread, name) for name in _FIGURES}
    return out


def print_spread(results: "Results", console: Console) -> None:
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
