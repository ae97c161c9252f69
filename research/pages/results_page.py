"""A results.json, with NaN for null, as Markdown: the README's table, and every figure for its page of results."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from evaluate.analysis.breaking_point_text import CAVEAT, HALF, breaking_point_text
from evaluate.analysis.breaking_points import AxisBreakingPoint
from evaluate.analysis.comparison import RATES
from evaluate.analysis.score import WORDS, Score
from evaluate.analysis.sensitivity import LEAD, Sensitivity, effect_text
from evaluate.analysis.severity_levels import amount, place
from evaluate.report.headings import FIRST, IN_A_LINE
from evaluate.report.markdown import FIGURES, table
from evaluate.rollouts.battery import resolve
from evaluate.rollouts.hardware import Hardware, hardware_of
from policies.summaries import explained
from quad_env.cli.format import (
    ABSENT,
    counted,
    interval,
    listed,
    number,
    p_value,
    percent,
    percent_interval,
    points,
    points_interval,
    share,
)
from quad_env.robots.robot import Robot

ROWS = ("flat", "push", "push:4", "rough", "rough:4", "slope", "payload:4", "latency:4")
"""Conditions of the table, of those that the run has."""
_ON_EVERY_ROW = "flat"


def legend(found: dict[str, Any]) -> str:
    """What each of a run's policies is, a line each, in one of Markdown."""
    return "<br>".join(f"`{name}`: {text}." for name, text in explained(found["policies"]).items())


def newcomers_table(found: dict[str, Any]) -> list[str]:
    """Lines of the table, of a results.json with NaN for null; below it policies that walk on flat ground alone."""
    rows = [name for name in ROWS if any(name in each["scenarios"] for each in found["policies"].values())]
    names = [name for name, each in found["policies"].items() if set(rows) <= set(each["scenarios"])]
    lines = [
        _headline(found, names),
        "",
        "In each cell: share of the episodes in which the robot does what it is asked to do; in brackets that in which"
        " it falls.",
        "",
        *table({FIRST: "condition", **_code(names)}, (_condition(found, row, names) for row in rows)).splitlines(),
    ]
    alone = [name for name in found["policies"] if name not in names]
    if alone:
        figures = [f"`{name}` {_short(found, name, _ON_EVERY_ROW)}" for name in alone]
        lines += ["", f"On flat ground alone: {listed(figures)}."]
    return lines


def robots_table(found: Sequence[dict[str, Any]]) -> list[str]:
    """Lines of the table of other robots, a robot a row: the score of each policy that all of them have."""
    scores = [{each["policy"]: each for each in one["scores"]} for one in found]
    names = [name for name in scores[0] if all(name in each for each in scores)]
    rows = [
        {FIRST: f"{robot.name}, {robot.mass:.1f} kg on legs of {robot.leg_length:.2f} m"}
        | {name: share(policies[name]["score"], tuple(policies[name]["ci"])) for name in names}
        for robot, policies in zip(map(_robot, found), scores, strict=True)
    ]
    return table({FIRST: "robot", **_code(names)}, rows).splitlines()


def _code(names: Iterable[str]) -> dict[str, str]:
    """Name -> the name as code: columns of policies."""
    return {name: f"`{name}`" for name in names}


def _robot(found: dict[str, Any]) -> Robot:
    """The robot of a results.json. Raises UsageError where it is not to be had here."""
    name = found.get("provenance", {}).get("hardware", {}).get("robot", Hardware.robot)
    return hardware_of(name, "the results' robot").quadruped


def _headline(found: dict[str, Any], names: list[str]) -> str:
    """The scores; without them, on how many of the scenarios that all walked each policy succeeds most often."""
    if scores := found.get("scores"):
        figures = [f"`{each['policy']}` {share(each['score'], tuple(each['ci']))}" for each in scores]
        count, axes = counted(found["episodes"], "episode"), len(scores[0]["axes"])
        return f"**Success, mean over {axes} axes of disturbance, {count} at each severity: {listed(figures)}.**"
    ran = {name: found["policies"][name]["scenarios"] for name in names}
    common = set.intersection(*map(set, ran.values()))
    counts = dict.fromkeys(names, 0)
    for scenario in common:
        rates = {name: cells[scenario]["success_rate"] for name, cells in ran.items()}
        for name, rate in rates.items():
            counts[name] += 0.0 < rate == max(rates.values())
    first, *rest = sorted(counts, key=lambda name: -counts[name])
    others = [f"`{name}` on {counts[name]}" for name in rest if counts[name]]
    also = f", {listed(others)}" if others else ""
    return (
        f"**On {counted(len(common), 'scenario')} of {counted(found['episodes'], 'episode')} each, the same for all, "
        f"`{first}` succeeds most often, or as often as the best, on {counts[first]}{also}.**"
    )


def _condition(found: dict[str, Any], scenario: str, names: list[str]) -> dict[str, str]:
    """A row of the short table."""
    words = "flat ground" if scenario == _ON_EVERY_ROW else place(resolve((scenario,), _robot(found))[0])
    return {FIRST: words, **{name: _short(found, name, scenario) for name in names}}


def _short(found: dict[str, Any], policy: str, scenario: str) -> str:
    figures = found["policies"][policy]["scenarios"][scenario]
    return f"{percent(figures['success_rate'])} ({percent(figures['fall_rate'])})"


def every_figure(found: dict[str, Any]) -> list[str]:
    """Lines of the comparison, breaking points and effects of disturbances as tables, with NaN for null."""
    names = list(found["policies"])
    rows = [
        {"scenario": scenario, "policy": f"`{name}`", **_row(cell)}
        for scenario in scenarios_of(found)
        for name in names
        if (cell := found["policies"][name]["scenarios"].get(scenario))
    ]
    heads = {"scenario": "scenario", "policy": "policy", **{metric: IN_A_LINE[metric] for metric in FIGURES}}
    lines = ["In brackets 95 % intervals.", "", *table(heads, rows).splitlines()]
    if scores := found.get("scores"):
        lines = [*score_table([Score(**each) for each in scores], found["baseline"]), "", *lines]
    if found["breaking_points"]:
        lines += ["", CAVEAT, "", *_breaking_points(found["breaking_points"], names)]
    if found["sensitivities"]:
        lines += ["", LEAD, "", *_effects(found["sensitivities"], names)]
    return lines


def score_table(scores: Sequence[Score], baseline: str, called: Mapping[str, str] | None = None) -> list[str]:
    """Each policy's score and its difference from the baseline's, in Markdown; `called`: what to call policies."""
    names = called or {}
    rows = [
        {
            "policy": names.get(each.policy, f"`{each.policy}`"),
            "score": f"{number(100.0 * each.score, 1)} [{percent_interval(each.ci)}]",
            "difference": f"{points(each.difference)} [{points_interval(each.difference_ci)}], {p_value(each.p_value)}"
            if each.policy != baseline
            else ABSENT,
        }
        for each in scores
    ]
    heads = {"policy": "policy", "score": "score, %", "difference": f"minus `{baseline}`, % points"}
    return [WORDS, "", *table(heads, rows).splitlines()]


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
    """Severities at which half of the episodes fail: an axis a row, a policy a column."""
    each = [AxisBreakingPoint(**point) for point in points]
    axes = {one.axis: ", ".join(filter(None, (one.axis, one.unit))) for one in each}
    lines: list[str] = []
    for of, head in HALF.items():
        if cells := {(one.axis, one.policy): breaking_point_text(one) for one in each if one.of == of}:
            lines += ["", *_by_axis(head, axes, cells, names)]
    return lines[1:]


def _by_axis(head: str, axes: dict[str, str], cells: dict[tuple[str, str], str], names: list[str]) -> list[str]:
    """A table of cells by axis and policy; `axes` gives each one's words."""
    rows = [{FIRST: words, **{name: cells.get((axis, name), ABSENT) for name in names}} for axis, words in axes.items()]
    return table({FIRST: head, **_code(names)}, rows).splitlines()


def _row(cell: dict[str, Any]) -> dict[str, str]:
    """The figures of one policy on one scenario, by metric."""
    return {
        metric: f"{percent(value)} [{percent_interval(ci)}]" if metric in RATES else f"{number(value)} [{interval(ci)}]"
        for metric in FIGURES
        for value, ci in [(cell[metric], cell[f"{metric}_ci"])]
    }
