"""Spread over training seeds, apart from the intervals over episodes."""

from html import escape

from evaluate.analysis.comparison import RATES
from evaluate.analysis.results import Results
from evaluate.analysis.training_seeds import SeedSpread, seed_spreads
from evaluate.report.headings import FIRST
from evaluate.report.html import note, section, table
from evaluate.report.sections.figures import HEADINGS
from quad_env.cli.format import interval, number, percent, percent_interval

LEAD = (
    "Policies from folders seed-<number> of one parent count as one training, repeated. A seed is one value, its mean "
    "over the episodes. Below each mean over the seeds: the 95 % interval, which counts seeds (of errors Student's t), "
    "then the lowest and highest seed."
)


def training(results: Results) -> str:
    """A table for each training that was repeated; empty without one."""
    spreads = seed_spreads(results.cells)
    runs = dict.fromkeys(spread.run for spread in spreads)
    return section("Training seeds", note(LEAD), *(_run(run, spreads) for run in runs)) if runs else ""


def _run(run: str, spreads: list[SeedSpread]) -> str:
    mine = [spread for spread in spreads if spread.run == run]
    cells = {(spread.scenario, spread.metric): _cell(spread) for spread in mine}
    scenarios = dict.fromkeys(spread.scenario for spread in mine)
    rows = ({FIRST: escape(name), **{metric: cells[name, metric] for metric in HEADINGS}} for name in scenarios)
    title = f"<h3>{escape(run)} <small>{mine[0].seeds} seeds</small></h3>"
    return title + table({FIRST: "scenario", **HEADINGS}, rows)


def _cell(spread: SeedSpread) -> str:
    rate = spread.metric in RATES
    mean = percent(spread.mean) if rate else number(spread.mean)
    ci = percent_interval(spread.ci) if rate else interval(spread.ci)
    ends = (spread.lowest, spread.highest)
    span = percent_interval(ends) if rate else interval(ends)
    return f"{mean}<small>{ci}</small><small>{span}</small>"
