"""Speed response: achieved against commanded speed as curves, and dead zones in a table."""

import math
from collections.abc import Mapping
from html import escape

import numpy as np

from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import severity_axes
from evaluate.measures.response import AXES, RESPONDS, known
from evaluate.report.headings import FIRST
from evaluate.report.html import grid, heading, image, note, section, table
from evaluate.report.plots.drawing import Margins, cell_of, figure, same_ticks, style, svg
from evaluate.report.sections.figures import policy_label
from evaluate.statistics.intervals import Floats
from quad_env.cli.format import number

BINS = 9
"""Bins of a component's commands."""
FEWEST = 3
"""Command intervals that a bin needs to be shown."""
LEVEL = "flat"
"""Axis of level ground without a disturbance, on which a response is looked at where it was run."""


def responses(results: Results) -> str:
    """Achieved against commanded speed on level ground; empty where no robot ended a command interval upright."""
    every = severity_axes(results.cells)
    scenario = next((axis for axis in every if axis.name == LEVEL), every[0]).nominal.name
    cells = [cell for policy in results.policies if (cell := cell_of(results, scenario, policy))]
    images = []
    for component, (axis, unit) in enumerate(AXES.items()):
        name = axis.replace("_", " ")
        intervals = {c.policy: known(c.measures.commands, c.measures.mean_velocities, component) for c in cells}
        if not any(len(commanded) for commanded, _ in intervals.values()):
            return ""
        drawn = _response(results, intervals, name, unit)
        images.append(image(drawn, f"Mean against commanded {name} of each policy on {scenario}"))
    lead = note(
        "Median speed over the command intervals that the robot ended upright, after their first second, against the "
        "speed commanded; bands hold the middle half. The grey line is perfect tracking."
    )
    dead = note(
        f"Slope: of the straight line through all intervals. Dead zone: below it less than "
        f"{100 * RESPONDS:.0f} % of the commanded speed is achieved."
    )
    title = f"Speed response on {escape(scenario)}"
    return section(title, lead, grid(images, 3), dead, _dead_zones(results, scenario))


def _response(results: Results, intervals: Mapping[str, tuple[Floats, Floats]], name: str, unit: str) -> bytes:
    """Mean speed against commanded speed, a line a policy; the band holds the middle half of its intervals."""
    drawn, axes = figure(3.0, 3.2, Margins(left=0.75))
    limit = float(max(np.abs(np.concatenate([commanded for commanded, _ in intervals.values()])).max(), 0.1))
    axes.plot((-limit, limit), (-limit, limit), color="#888888", linewidth=1)
    for policy, (commanded, achieved) in intervals.items():
        colour, mark = style(results, policy)
        centre, low, middle, high = _quartiles(commanded, achieved, limit)
        if len(centre):
            axes.fill_between(centre, low, high, color=colour, alpha=0.15, linewidth=0)
            axes.plot(centre, middle, color=colour, marker=mark, markersize=4, linewidth=1.4)
    axes.set(xlim=(-1.05 * limit, 1.05 * limit), xlabel=f"commanded {name}, {unit}", ylabel=f"mean, {unit}")
    same_ticks(axes)
    return svg(drawn)


def _quartiles(commanded: Floats, achieved: Floats, limit: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Mean command of each bin, and the quartiles of what came of it."""
    inner = np.linspace(-limit, limit, BINS + 1)[1:-1]
    where = np.digitize(commanded, inner)
    rows = [
        (commanded[where == k].mean(), *np.quantile(achieved[where == k], (0.25, 0.5, 0.75)))
        for k in range(BINS)
        if (where == k).sum() >= FEWEST
    ]
    centre, low, middle, high = np.array(rows, dtype=np.float64).reshape(-1, 4).T
    return centre, low, middle, high


def _dead_zones(results: Results, scenario: str) -> str:
    """A policy a row; the columns of each component of a command."""
    heads, rows = {FIRST: "policy"}, []
    for axis, unit in AXES.items():
        name = axis.replace("_", " ")
        heads |= {f"{axis} slope": heading(name, "slope"), f"{axis} zone": heading(name, f"dead zone, {unit}")}
    for policy in results.policies:
        if summary := results.summaries.get((scenario, policy)):
            row = {FIRST: policy_label(results, policy)}
            for axis, found in summary.response.items():
                zone = "all" if math.isinf(found.dead_zone) else number(found.dead_zone, 1)
                row |= {f"{axis} slope": number(found.gain, 2), f"{axis} zone": zone}
            rows.append(row)
    return table(heads, rows)
