"""Every figure of a results.json as Markdown: the comparison, breaking points, and what each disturbance does."""

from typing import Any

from evaluate.analysis.breaking_point_text import CAVEAT, breaking_point_text
from evaluate.analysis.breaking_points import AxisBreakingPoint
from evaluate.analysis.sensitivity import LEAD, Sensitivity, effect_text
from evaluate.analysis.severity_levels import amount
from evaluate.terminal.format import ABSENT, interval, number, percent, percent_interval


def every_figure(found: dict[str, Any]) -> list[str]:
    """Lines of the comparison, breaking points and effects of disturbances as tables, with NaN for null."""
    names = list(found["policies"])
    run = scenarios_of(found)
    lines = [
        "In brackets 95 % intervals.",
        "",
        "| scenario | policy | falls | velocity error, m/s | yaw-rate error, rad/s | mean velocity error, m/s |",
        "|---|---|---|---|---|---|",
    ]
    for scenario in run:
        cells = {name: found["policies"][name]["scenarios"].get(scenario) for name in names}
        lines += [f"| {scenario} | `{name}` | {_row(cell)} |" for name, cell in cells.items() if cell]
    if found["breaking_points"]:
        lines += ["", CAVEAT, "", *_breaking_points(found["breaking_points"], names)]
    if found["sensitivities"]:
        lines += ["", LEAD, "", *_effects(found["sensitivities"], names)]
    return lines


def scenarios_of(found: dict[str, Any]) -> list[str]:
    """Names of the scenarios, in the order of the run."""
    return list(dict.fromkeys(name for policy in found["policies"].values() for name in policy["scenarios"]))


def _effects(found: list[dict[str, Any]], names: list[str]) -> list[str]:
    """What each disturbance does: an axis a row, a policy a column."""
    each = [Sensitivity(**entry) for entry in found]
    cells = {(one.axis, one.policy): effect_text(one) for one in each}
    axes = {one.axis: f"{one.axis}, {amount(one.severity, one.unit)}" for one in each}
    return _by_axis("disturbance", axes, cells, names)


def _breaking_points(points: list[dict[str, Any]], names: list[str]) -> list[str]:
    """Severity at which half of the episodes end in a fall: an axis a row, a policy a column."""
    each = [AxisBreakingPoint(**point) for point in points]
    cells = {(one.axis, one.policy): breaking_point_text(one) for one in each}
    axes = {one.axis: ", ".join(filter(None, (one.axis, one.unit))) for one in each}
    return _by_axis("half of the episodes fall at", axes, cells, names)


def _by_axis(head: str, axes: dict[str, str], cells: dict[tuple[str, str], str], names: list[str]) -> list[str]:
    """A table of cells by axis and policy; `axes` gives each one's words."""
    rows = [
        f"| {words} | {' | '.join(cells.get((axis, name), ABSENT) for name in names)} |" for axis, words in axes.items()
    ]
    return [f"| {head} | {' | '.join(f'`{name}`' for name in names)} |", f"|---|{'---|' * len(names)}", *rows]


def _row(cell: dict[str, Any]) -> str:
    """The figures of one policy on one scenario."""
    return " | ".join(
        (
            f"{percent(cell['fall_rate'])} [{percent_interval(cell['fall_rate_ci'])}]",
            f"{number(cell['velocity_error'])} [{interval(cell['velocity_error_ci'])}]",
            f"{number(cell['yaw_rate_error'])} [{interval(cell['yaw_rate_error_ci'])}]",
            number(cell["mean_velocity_error"]),
        )
    )
