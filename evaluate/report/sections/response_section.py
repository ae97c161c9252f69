"""The section on speed response: curves, and the dead zones in a table."""

import math
from html import escape

from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import severity_axes
from evaluate.measures.response import AXES, RESPONDS, Response
from evaluate.report.html import grid, heading, image, note, section, table
from evaluate.report.plots.response_plot import COMPONENTS, intervals, response
from evaluate.report.sections.figures import policy_label
from evaluate.terminal.format import ABSENT, number

LEVEL = "flat"
"""Axis of level ground without a disturbance, on which a response is looked at where it was run."""


def responses(results: Results) -> str:
    """Achieved against commanded speed on level ground; empty where no robot ended a command interval upright."""
    every = severity_axes(results)
    scenario = next((axis for axis in every if axis.name == LEVEL), every[0]).nominal.name
    if not any(len(intervals(results, scenario, policy, 0)[0]) for policy in results.policies):
        return ""
    images = [
        image(response(results, scenario, component), f"Mean against commanded {name} of each policy on {scenario}")
        for component, (name, _) in enumerate(COMPONENTS)
    ]
    lead = note(
        "Median speed over the command intervals that the robot ended upright, after their first second, against the "
        "speed commanded; bands hold the middle half. On the grey line it did as told."
    )
    dead = note(
        f"Slope: of the straight line through all intervals. Dead zone: commands below it get less than "
        f"{100 * RESPONDS:.0f} % of the speed."
    )
    title = f"Speed response on {escape(scenario)}"
    return section(title, lead, grid(images, 3), dead, _dead_zones(results, scenario))


def _dead_zones(results: Results, scenario: str) -> str:
    heads = ["policy"]
    for name, unit in COMPONENTS:
        heads += [f"{name}<small>slope</small>", heading("dead zone", unit)]
    rows = []
    for policy in results.policies:
        if (scenario, policy) in results.summaries:
            found = results.summaries[scenario, policy].response
            rows.append([policy_label(results, policy), *(cell for axis in AXES for cell in _cells(found[axis]))])
    return table(heads, rows)


def _cells(found: Response) -> tuple[str, str]:
    zone = "all" if math.isinf(found.dead_zone) else number(found.dead_zone, 1)
    return number(found.gain, 2), zone if not math.isnan(found.dead_zone) else ABSENT
