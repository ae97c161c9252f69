"""Fall rate against severity: a curve for each policy on each axis, as a table on the terminal and as a picture."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from evaluate.analysis.results import Results
from evaluate.report.plots.drawing import style
from evaluate.statistics.intervals import Interval
from evaluate.terminal.format import counted, percent
from policies.files import write_atomically
from quad_env.scenarios.named import Scenario

COLUMNS = 4
"""Panels side by side."""


@dataclass(frozen=True)
class Curve:
    """One policy on one axis, the mildest level first."""

    policy: str
    scenarios: tuple[Scenario, ...]
    fall_rates: tuple[float, ...]
    intervals: tuple[Interval, ...]
    """Wilson, 95 %."""


def curves(results: Results) -> dict[str, list[Curve]]:
    """Axis -> a curve for each policy, through the levels that were run, in the order they were run in."""
    scenarios = {cell.scenario.name: cell.scenario for cell in results.cells}
    axes = dict.fromkeys(scenario.axis for scenario in scenarios.values() if scenario.axis)
    return {
        axis: [
            _curve(results, policy, [s for s in scenarios.values() if s.axis == axis]) for policy in results.policies
        ]
        for axis in axes
    }


def _curve(results: Results, policy: str, scenarios: Sequence[Scenario]) -> Curve:
    known = tuple(scenario for scenario in scenarios if (scenario.name, policy) in results.summaries)
    summaries = [results.summaries[scenario.name, policy] for scenario in known]
    return Curve(policy, known, tuple(s.fall_rate for s in summaries), tuple(s.fall_rate_ci for s in summaries))


def print_curves(results: Results, console: Console) -> None:
    """A block for each axis: its severities, and below them each policy's fall rates."""
    found = curves(results)
    levels = max(len(curve.scenarios) for axis in found.values() for curve in axis)
    title = f"episodes that end in a fall, of {counted(results.episodes, 'episode')} each"
    table = Table(
        title=title, title_justify="left", title_style="", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False
    )
    for name in ("", *[""] * levels):
        table.add_column(name, justify="right" if len(table.columns) else "left")
    table.show_header = False
    for axis, of_axis in found.items():
        known = max((curve.scenarios for curve in of_axis), key=len)
        unit = f", {known[0].severity_unit}" if known[0].severity_unit else ""
        table.add_row(f"[bold]{escape(axis + unit)}[/bold]", *(f"[bold]{s.severity:g}[/bold]" for s in known))
        for curve in of_axis:
            table.add_row(f" {escape(curve.policy)}", *map(percent, curve.fall_rates))
    console.print(table)


def write_picture(results: Results, path: Path) -> None:
    """Draw the curves with their 95 % intervals, a panel an axis, as SVG or PNG by the file's name."""
    import io

    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    found = curves(results)
    rows, columns = -(-len(found) // COLUMNS), min(COLUMNS, len(found))
    figure = Figure(figsize=(3.2 * columns, 2.6 * rows + 0.4), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for panel, (axis, of_axis) in zip(panels, found.items(), strict=False):
        for curve in of_axis:
            places = range(len(curve.scenarios))
            colour, mark = style(results, curve.policy)
            panel.plot(places, curve.fall_rates, marker=mark, markersize=3, color=colour, label=curve.policy)
            lows, highs = zip(*curve.intervals, strict=True) if curve.intervals else ((), ())
            panel.fill_between(places, lows, highs, color=colour, alpha=0.15, linewidth=0)
        known = max((curve.scenarios for curve in of_axis), key=len)
        panel.set_xticks(range(len(known)), [f"{scenario.severity:g}" for scenario in known])
        panel.set_title(axis.replace("_", " "), fontsize=9, loc="left")
        panel.set_xlabel(known[0].severity_unit, fontsize=8)
        panel.set_ylim(-0.03, 1.03)
        panel.tick_params(labelsize=7)
    for panel in panels[len(found) :]:
        panel.set_visible(False)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=4, fontsize=8)
    buffer = io.BytesIO()
    kind = path.suffix[1:]
    figure.savefig(buffer, format=kind, dpi=120, metadata={"Date": None} if kind == "svg" else None)
    write_atomically(path, buffer.getvalue())
