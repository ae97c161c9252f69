"""Every figure of a results.json as Markdown: the comparison, breaking points, and what each disturbance does."""

import math
from typing import Any

from evaluate.analysis.breaking_point_text import CAVEAT, breaking_point_text
from evaluate.analysis.breaking_points import AxisBreakingPoint
from evaluate.analysis.sensitivity import LEAD, Sensitivity, effect_text
from evaluate.analysis.severity_levels import amount
from evaluate.terminal.format import ABSENT, interval, number, percent, percent_interval


def every_figure(found: dict[str, Any]) -> list[str]:
    """Lines of the comparison, breaking points and effects of disturbances as tables."""
    names = list(found["policies"])
    run = scenarios_of(found)
    lines = [
        "In brackets 95 % intervals.",
        "",
        "| scenario | policy | falls | velocity error, m/s | yaw-rate error, rad/s | mean velocity error, m/s |",
        "|---|---|---|---|---|---|",
    ]
    for scenario in run:
        walked = [name for name in names if scenario in found["policies"][name]["scenarios"]]
        lines += [f"| {scenario} | `{name}` | {row(_cell(found, name, scenario))} |" for name in walked]
    if found["breaking_points"]:
        lines += ["", CAVEAT, "", *breaking_points(found["breaking_points"], names)]
    if found["sensitivities"]:
        lines += ["", LEAD, "", *effects(found["sensitivities"], names)]
    return lines


def scenarios_of(found: dict[str, Any]) -> list[str]:
    """Names of the scenarios, in the order of the run."""
    return list(dict.fromkeys(name for policy in found["policies"].values() for name in policy["scenarios"]))


def effects(found: list[dict[str, Any]], names: list[str]) -> list[str]:
    """What each disturbance does: an axis a row, a policy a column."""
    each = [Sensitivity(**_without_null(entry)) for entry in found]
    cells = {(one.axis, one.policy): effect_text(one) for one in each}
    axes = {one.axis: f"{one.axis}, {amount(one.severity, one.unit)}" for one in each}
    return _by_axis("disturbance", axes, cells, names)


def breaking_points(points: list[dict[str, Any]], names: list[str]) -> list[str]:
    """Severity at which half of the episodes end in a fall: an axis a row, a policy a column."""
    cells = {
        (point["axis"], point["policy"]): breaking_point_text(AxisBreakingPoint(**_fields(point))) for point in points
    }
    axes = {point["axis"]: ", ".join(filter(None, (point["axis"], point["unit"]))) for point in points}
    return _by_axis("half of the episodes fall at", axes, cells, names)


def _by_axis(head: str, axes: dict[str, str], cells: dict[tuple[str, str], str], names: list[str]) -> list[str]:
    """A table of cells by axis and policy; `axes` gives each one's words."""
    rows = [
        f"| {words} | {' | '.join(cells.get((axis, name), ABSENT) for name in names)} |" for axis, words in axes.items()
    ]
    return [f"| {head} | {' | '.join(f'`{name}`' for name in names)} |", f"|---|{'---|' * len(names)}", *rows]


def _fields(point: dict[str, Any]) -> dict[str, Any]:
    """Fields of an AxisBreakingPoint; an end that JSON cannot hold is beyond the severities tried."""
    fields: dict[str, Any] = _without_null(point)
    return fields | {"ci": tuple(fields["ci"])}


def _cell(found: dict[str, Any], policy: str, scenario: str) -> dict[str, Any]:
    """Figures of one policy on one scenario, nan where one does not exist."""
    figures: dict[str, Any] = _without_null(found["policies"][policy]["scenarios"][scenario])
    return figures


def _without_null(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_null(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_without_null(entry) for entry in value]
    return math.nan if value is None else value


def row(cell: dict[str, Any]) -> str:
    """The figures of one policy on one scenario."""
    return " | ".join(
        (
            f"{percent(cell['fall_rate'])} [{percent_interval(cell['fall_rate_ci'])}]",
            f"{number(cell['velocity_error'])} [{interval(cell['velocity_error_ci'])}]",
            f"{number(cell['yaw_rate_error'])} [{interval(cell['yaw_rate_error_ci'])}]",
            number(cell["mean_velocity_error"]),
        )
    )
