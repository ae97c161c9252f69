"""The first pictures and tables of the page: success and scores, and breaking points."""

from collections.abc import Mapping
from html import escape

from evaluate.analysis.breaking_points import CAVEAT, HALF, AxisBreakingPoint, Of, figure_and_interval
from evaluate.analysis.results import Results
from evaluate.analysis.score import FLAT, SCORES, WORDS, Score, ranked
from evaluate.analysis.severity_levels import severity_axes
from evaluate.report.headings import FIRST
from evaluate.report.html import grid, heading, image, note, section, table, wide
from evaluate.report.plots import success as success_plots
from evaluate.report.plots.drawing import svg
from evaluate.report.sections.axis_section import anchor
from evaluate.report.sections.figures import policy_label
from quad_env.cli.format import ABSENT, NO_BREAK, number, p_value, percent, percent_interval, points, points_interval

SUCCESS_LEAD = (
    "Episodes that succeed, in %: in each block the severities of an axis in this run, the mildest to the left. An "
    "episode succeeds if the robot stays upright and tracks its command within tolerance in every interval. Set apart "
    "on the right: with the robot's hardware profile."
)
BREAKING_LEAD = (
    "Severities at which half of the episodes no longer succeed, and fall, with their 95 % intervals. "
    f"{CAVEAT} “None up to” is the hardest level tried; “already at” the mildest."
)


def success(results: Results) -> str:
    """Scores, heat map and outcomes; outcomes alone of a run of one axis."""
    outcomes = image(svg(success_plots.outcomes(results)), "What came of the episodes of each policy")
    if not (results.scores or results.hardware_scores):
        return section("Success", grid([outcomes]))
    heat_map = image(
        svg(success_plots.heat_map(results.scores, results.hardware_scores)),
        "Success of each policy on each axis at each severity, in per cent",
    )
    pictures = note(SUCCESS_LEAD), wide(heat_map), grid([outcomes])
    return section("Success", _scores(results), note(WORDS), *pictures)


def _scores(results: Results) -> str:
    """The table of scores, with the hardware profile on the right; policies without scores come last."""
    found = {name: kind for name, kind in zip(SCORES, (results.scores, results.hardware_scores), strict=True) if kind}
    heads, cells = {"policy": "policy"}, {policy: dict[str, str]() for policy in ranked(*found.values())}
    for name, kind in found.items():
        minus = heading(f"minus {escape(results.baseline)}", "% points")
        heads |= {name: heading(name, "%"), f"{name} difference": minus}
        for score in kind:
            own = _score_cells(score, results.baseline)
            cells[score.policy] |= {name: own["score"], f"{name} difference": own["difference"]}
    for policy in results.policies:
        if policy not in cells and (flat := results.summaries.get((FLAT, policy))):
            cells[policy] = {next(iter(found)): f"{FLAT}: {percent(flat.success_rate)}"}
    blank = dict.fromkeys(heads, "")
    return table(heads, ({**blank, "policy": policy_label(results, name), **own} for name, own in cells.items()))


def _score_cells(score: Score, baseline: str) -> dict[str, str]:
    """Column -> cell."""
    figure = f"{number(100.0 * score.score, 1)}<small>{percent_interval(score.ci)}</small>"
    ci = f"<small>{points_interval(score.difference_ci)}</small><small>{escape(p_value(score.p_value))}</small>"
    return {"score": figure, "difference": f"{points(score.difference)}{ci}" if score.policy != baseline else ""}


def overview(results: Results) -> str:
    """Breaking points, an axis a row; empty where no axis has levels enough."""
    found = {point.axis for point in results.breaking_points}
    axes = {axis.name: axis.quantity for axis in severity_axes(results.cells) if axis.name in found}
    tables = (_breaking_points(results, axes, of) for of in HALF)
    return section("Breaking points", note(BREAKING_LEAD), *tables) if axes else ""


def _breaking_points(results: Results, axes: Mapping[str, str], of: Of) -> str:
    """A table, headed by what breaks, of the policies that have a breaking point."""
    cells = {(point.axis, point.policy): _breaking_cell(point) for point in results.breaking_points if point.of == of}
    policies = {name: policy_label(results, name) for name in results.policies if any(name == one for _, one in cells)}
    rows = [
        {FIRST: f'<a href="#{anchor(axis)}">{escape(axis)}</a><small>{escape(words)}</small>'}
        | {policy: cells.get((axis, policy), ABSENT) for policy in policies}
        for axis, words in axes.items()
    ]
    return f"<h3>{HALF[of].capitalize()}</h3>{table({FIRST: 'axis', **policies}, rows, 'text')}" if cells else ""


def _breaking_cell(point: AxisBreakingPoint) -> str:
    figure, ends = figure_and_interval(point)
    return f"{escape(figure)}<small>{escape(ends.replace(NO_BREAK, ' '))}</small>" if ends else escape(figure)
