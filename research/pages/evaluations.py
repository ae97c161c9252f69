"""Reads a results.json of `python -m evaluate`, and makes tables and figures for README and docs."""

import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evaluate.analysis.pareto import Pareto, ParetoPoint, cost_scenario
from evaluate.analysis.results import null_to_nan
from evaluate.analysis.score import SCORES, Score
from evaluate.commands.options import command
from evaluate.hardware import HardwareConfig, parse_robot_option
from evaluate.measures.outcomes import SUCCESS_RULE
from evaluate.report.headings import EFFORT_SCENARIOS, EFFORT_TITLES, MAIN_EFFORT_TITLES, ROW_LABEL, format_effort
from evaluate.report.plots import drawing, pareto, success
from evaluate.rollouts.battery import BATTERIES, resolve
from policies.summaries import SUMMARIES
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import (
    ABSENT,
    NO_BREAK,
    p_value,
    percent,
    points_with,
    share,
    with_count,
)
from quad_env.files.reading import parse_json, read_bytes
from quad_env.files.writing import write_atomically
from quad_env.robots.robot import Robot
from research.pages.markdown import table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FLAT = "flat"
"""Name of the scenario on which the success of a policy without a score is reported."""
SCORE_WORDS = (
    "The score is the mean success over the axes, each axis and each of its severities alike; its interval counts "
    "episodes, each with all of its scenarios. p is not corrected. The hardware score is that of the scenarios with "
    "the robot's hardware profile."
)
"""Explanation above the table of scores."""
ALT = "Share of the episodes that succeed, of each policy on each axis at its severities, in per cent"
"""Alternative text of the figure of success."""
HARDWARE_SCORES = "hardware_scores"
"""Key of a results.json for the scores with the robot's hardware profile."""
KINDS = "scores", HARDWARE_SCORES
"""Keys of a results.json for the scores without and with the robot's hardware profile."""
_KEYS = "policies", "scores", "baseline", "breaking_points", "versions", "episodes", "seed"
"""Required keys of a results.json."""


def read_results(path: Path) -> dict[str, Any]:
    """Read a results.json, with NaN for null.

    Raises UsageError if the file is missing, if its evaluation is unfinished, or if it has no scores.
    """
    if not path.exists():
        raise UsageError(f"there is no {path}; `python -m evaluate --out {path.parent}` makes it")
    try:
        results = dict(null_to_nan(parse_json(read_bytes(path))))
        is_complete = results["complete"]
        has_versions = bool(results["versions"]["mujoco"] and results["versions"]["python"])
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{path} is not a results.json of `python -m evaluate` ({error!r})") from error
    if not is_complete:
        raise UsageError(f"the evaluation of {path} was interrupted: carry it on with --resume")
    if not has_versions or any(name not in results for name in _KEYS if name != "scores"):
        raise UsageError(f"{path} is not a results.json of `python -m evaluate`: it lacks one of {', '.join(_KEYS)}")
    if all(len(score["axes"]) < 2 for score in results.get("scores", ())):
        raise UsageError(f"the evaluation of {path} has no scores: they need several axes of disturbance")
    return results


def scores_of(results: dict[str, Any], kind: str = "scores") -> list[Score]:
    """Return the scores under the key `kind` of `results`, the highest first.

    The list is empty if the results have no such scores.

    Args:
        results: Contents of a results.json.
        kind: Key of the scores.

    Returns:
        The scores.
    """
    return [Score(**score) for score in results.get(kind, ())]


def scenarios_of(results: dict[str, Any]) -> list[str]:
    """Return the names of the scenarios of an evaluation, in the order of the evaluation."""
    return list(dict.fromkeys(name for policy in results["policies"].values() for name in policy["scenarios"]))


def made_by(results: dict[str, Any]) -> str:
    """Return a line of Markdown with the command that produced the results, and the versions.

    Options with default values are left out of the command.
    """
    provenance = results.get("provenance", {})
    versions = results["versions"]
    scenarios = scenarios_of(results)
    battery = next((name for name in BATTERIES if [scenario.name for scenario in resolve((name,))] == scenarios), None)
    only_on = provenance.get("only_on", {})
    options = {
        "policies": [f"{name}@{','.join(only_on[name])}" if name in only_on else name for name in results["policies"]],
        "scenarios": [battery] if battery else scenarios,
        "episodes": results["episodes"],
        "seed": results["seed"],
    }
    words = command(options | provenance.get("hardware", {}))
    rule = versions.get("success_rule") or "success/1"
    older_rule = "" if rule == SUCCESS_RULE else f"; success by the older rule {rule}"
    return f"`{words}`; MuJoCo {versions['mujoco']}, Python {versions['python']}{older_rule}."


def overview_lines(results: dict[str, Any]) -> list[str]:
    """Return the lines of a Markdown table of scores and effort, with one row per policy and a caption.

    The caption also states the success on flat ground of the policies without a score.
    """
    scores = {score.policy: share(score.score, score.ci) for score in scores_of(results)}
    hardware_scores = {score.policy: share(score.score, score.ci) for score in scores_of(results, HARDWARE_SCORES)}
    cost_on = cost_scenario(scenarios_of(results))
    cells_by_policy = {policy: entry["scenarios"] for policy, entry in results["policies"].items()}
    rows = []
    for policy in dict.fromkeys((*scores, *hardware_scores)):
        row = {"policy": f"`{policy}`", "about": SUMMARIES.get(policy, ABSENT)}
        row |= {"score": scores.get(policy, ABSENT), "hardware": hardware_scores.get(policy, ABSENT)}
        rows.append(row | _effort_cells(cells_by_policy.get(policy, {}).get(cost_on, {}).get("effort", {})))
    heads = {name: head for name, head in _overview_heads().items() if any(row[name] != ABSENT for row in rows)}
    effort_note = f"; effort {EFFORT_SCENARIOS[cost_on]}" if set(MAIN_EFFORT_TITLES) & set(heads) else ""
    without_score = {
        policy: cells for policy, cells in cells_by_policy.items() if policy not in scores | hardware_scores
    }
    caption = f"{_overview_caption(results, effort_note)}{_on_flat_ground(without_score)}"
    return [*_with_text_column(table(heads, rows).splitlines(), heads), "", caption]


def _overview_heads() -> dict[str, str]:
    """Return the headings of the table of `overview_lines`: name of the column -> heading."""
    heads = {
        "policy": "policy",
        "about": "controller",
        "score": "success",
        "hardware": "success with the hardware profile",
    }
    return heads | {name: ", ".join(filter(None, EFFORT_TITLES[name])) for name in MAIN_EFFORT_TITLES}


def _effort_cells(effort: Mapping[str, float]) -> dict[str, str]:
    """Return the main measures of effort as text: name of the measure -> cell. A missing value is a dash."""
    return {name: format_effort(name, effort.get(name, math.nan)) for name in MAIN_EFFORT_TITLES}


def _overview_caption(results: dict[str, Any], effort_note: str) -> str:
    """Return the caption of the table of `overview_lines`; `effort_note` describes the columns of effort."""
    count = with_count(results["episodes"], "episode")
    axes = len(scores_of(results)[0].axes)
    return f"Success: mean over {axes} axes of disturbance, {count} at each severity{effort_note}."


def _with_text_column(lines: list[str], heads: dict[str, str]) -> list[str]:
    """Return the `lines` of a Markdown table with the second column, `about`, aligned to the left.

    The lines are returned unchanged if `heads` has no column `about`.
    """
    if "about" not in heads:
        return lines
    return [lines[0], lines[1].replace("|---|---:|", "|---|---|", 1), *lines[2:]]


def _on_flat_ground(cells_by_policy: dict[str, Any]) -> str:
    """Return a sentence for each policy on flat ground: its success there, and its description.

    Args:
        cells_by_policy: Policy without a score -> scenario -> results on that scenario.

    Returns:
        The sentences; empty if no policy was evaluated on flat ground.
    """
    sentences = ""
    for policy, cells in cells_by_policy.items():
        if FLAT in cells:
            about = f" ({SUMMARIES[policy]})" if policy in SUMMARIES else ""
            sentences += f" `{policy}`{about} on flat ground alone: {percent(cells[FLAT]['success_rate'])}."
    return sentences


def robots_table(results: Sequence[dict[str, Any]]) -> list[str]:
    """Return the lines of the table of other robots, with one row per robot and one column per policy.

    The columns are the policies that were evaluated on all robots. A robot has a second row if it was also evaluated
    with its hardware profile.
    """
    scores_by_robot = [{score.policy: score for score in scores_of(entry)} for entry in results]
    policies = [name for name in scores_by_robot[0] if all(name in scores for scores in scores_by_robot)]
    rows = []
    for entry, scores in zip(results, scores_by_robot, strict=True):
        robot = robot_of(entry)
        about = f"{robot.name}, {robot.mass:.1f} kg on legs of {robot.leg_length:.2f} m"
        hardware_scores = {score.policy: score for score in scores_of(entry, HARDWARE_SCORES)}
        if scores:
            rows.append({ROW_LABEL: about, **_score_texts(scores, policies)})
        if hardware_scores:
            rows.append({ROW_LABEL: f"{robot.name}, hardware profile", **_score_texts(hardware_scores, policies)})
    return table({ROW_LABEL: "robot", **{name: f"`{name}`" for name in policies}}, rows).splitlines()


def _score_texts(scores: Mapping[str, Score], policies: Sequence[str]) -> dict[str, str]:
    """Return the scores of the given policies as text: policy -> cell. A missing score is a dash."""
    return {name: share(scores[name].score, scores[name].ci) if name in scores else ABSENT for name in policies}


def robot_of(results: dict[str, Any]) -> Robot:
    """Return the robot of an evaluation. Raises UsageError if the robot cannot be loaded on this computer."""
    name = results.get("provenance", {}).get("hardware", {}).get("robot", HardwareConfig.robot)
    return parse_robot_option(name, "the results' robot").robot_model


def score_table(
    scores: Sequence[Score],
    baseline: str,
    display_names: Mapping[str, str] | None = None,
    hardware_scores: Sequence[Score] = (),
) -> list[str]:
    """Create the table of scores and of their differences from the baseline.

    Args:
        scores: Scores without the robot's hardware profile.
        baseline: Name of the policy from which the differences are computed.
        display_names: Policy -> name that the table shows instead of the policy's own.
        hardware_scores: Scores with the hardware profile, which are shown in the columns on the right.

    Returns:
        Lines of Markdown.
    """
    columns = {name: column for name, column in zip(SCORES, (scores, hardware_scores), strict=True) if column}
    heads = {"policy": "policy"}
    rows: dict[str, dict[str, str]] = {}
    for name, column in columns.items():
        heads |= {name: f"{name}, %", f"{name} difference": f"minus `{baseline}`, % points"}
        for score in column:
            row = rows.setdefault(score.policy, {})
            row |= _score_cells(score, baseline, name)
    empty_row = dict.fromkeys(heads, ABSENT)
    complete_rows = []
    for policy, row in rows.items():
        name = (display_names or {}).get(policy, f"`{policy}`")
        complete_rows.append(empty_row | row | {"policy": name})
    return [SCORE_WORDS, "", *table(heads, complete_rows).splitlines()]


def _score_cells(score: Score, baseline: str, name: str) -> dict[str, str]:
    """Return the cells of a score and of its difference from the baseline: name of the column -> text."""
    percent_score = points_with(score.score, score.ci)
    difference = points_with(score.difference, score.difference_ci)
    difference_text = f"{difference.value} [{difference.interval}], {p_value(score.p_value)}"
    return {
        name: f"{percent_score.value} [{percent_score.interval}{NO_BREAK}%]",
        f"{name} difference": difference_text if score.policy != baseline else ABSENT,
    }


def draw_figures(results: dict[str, Any], picture: Path) -> None:
    """Draw the figures of an evaluation as PNG files.

    Args:
        results: Results of the evaluation.
        picture: File NAME.png for the success of every policy on every axis. The Pareto front, if there is one, is
            written to NAME_pareto.png.
    """
    front = results.get("pareto", {"front": ()})
    with drawing.plot_settings():
        heat_map = success.draw_heat_map(scores_of(results), scores_of(results, HARDWARE_SCORES))
        write_atomically(picture, figure_to_png(heat_map))
        if front["front"]:
            points = tuple(ParetoPoint(**point) for point in front["points"])
            plot = pareto.draw_pareto_front(
                Pareto(front["cost_on"], front["front"], points), tuple(results["policies"])
            )
            write_atomically(picture.with_stem(f"{picture.stem}_pareto"), figure_to_png(plot))


def picture_links(results: dict[str, Any], path: str) -> str:
    """Return Markdown links to the figures of `results`.

    `path` is the path from the page to the first figure.

    Args:
        results: Contents of a results.json.
        path: Path from the page to the first figure.

    Returns:
        The links.
    """
    has_front = bool(results.get("pareto", {}).get("front"))
    front = f" ![{pareto.ALT}]({path.removesuffix('.png')}_pareto.png)" if has_front else ""
    return f"![{ALT}]({path}){front}"


def figure_to_png(figure: "Figure") -> bytes:
    """Encode a figure as a PNG with a white background."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=160, facecolor="white", metadata={"Software": None})
    return buffer.getvalue()
