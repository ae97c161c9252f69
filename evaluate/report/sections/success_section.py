"""The first picture of the page: who does what is asked, where, and what becomes of the other episodes."""

from html import escape

from evaluate.analysis.results import Results
from evaluate.analysis.score import WORDS, Score
from evaluate.analysis.severity_levels import severity_axes
from evaluate.report.html import grid, heading, image, note, section, table, wide
from evaluate.report.plots import success as plots
from evaluate.report.plots.drawing import svg
from evaluate.report.sections.figures import policy_label
from quad_env.cli.format import number, p_value, percent_interval, points, points_interval

LEAD = (
    "Episodes that succeed, in %: in each block the severities of an axis in this run, the mildest to the left. An "
    "episode succeeds if the robot stays up and keeps to its command in every interval."
)


def success(results: Results) -> str:
    """Heat map, outcomes, profile and scores; outcomes alone of a run of one axis."""
    pictures = [image(svg(plots.outcomes(results)), "What came of the episodes of each policy")]
    if not results.scores:
        return section("Success", grid(pictures, 2))
    if any(len(axis.levels) > 1 for axis in severity_axes(results.cells)):
        pictures.append(image(svg(plots.profile(results)), "Mean success of each policy against severity"))
    heat_map = image(
        svg(plots.heat_map(results.scores)), "Success of each policy on each axis at each severity, in per cent"
    )
    minus = heading(f"minus {escape(results.baseline)}", "% points")
    heads = {"policy": "policy", "score": heading("score", "%"), "difference": minus}
    rows = ({"policy": policy_label(results, each.policy), **_cells(each, results.baseline)} for each in results.scores)
    return section("Success", note(LEAD), wide(heat_map), grid(pictures, 2), note(WORDS), table(heads, rows))


def _cells(score: Score, baseline: str) -> dict[str, str]:
    """Column -> cell."""
    figure = f"{number(100.0 * score.score, 1)}<small>{percent_interval(score.ci)}</small>"
    ci = f"<small>{points_interval(score.difference_ci)}</small><small>{escape(p_value(score.p_value))}</small>"
    return {"score": figure, "difference": f"{points(score.difference)}{ci}" if score.policy != baseline else ""}
