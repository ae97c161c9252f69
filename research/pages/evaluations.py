"""Functions that read an evaluation's results.json, and create tables and plots for README and docs."""

import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evaluate.analysis.pareto import Pareto, ParetoPoint, cost_scenario
from evaluate.analysis.results import null_to_nan
from evaluate.analysis.score import SCORES, Score
from evaluate.commands.options import DEFAULT_BATTERY, FULL_BATTERY, command
from evaluate.hardware import HardwareConfig, parse_robot_option
from evaluate.measures.outcomes import SUCCESS_RULE
from evaluate.report.headings import EFFORT_SCENARIOS, EFFORT_TITLES, MAIN_EFFORT_TITLES, ROW_LABEL, format_effort
from evaluate.report.plots import drawing, pareto, success
from evaluate.rollouts.battery import BATTERIES, resolve
from policies.registry import shipped_summaries
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
"""Name of the scenario on flat ground, on which the success of a policy that has no score is reported."""
SCORE_WORDS = (
    "The score is the mean success over the axes, each axis and each of its severities alike; its interval counts "
    "episodes, each with all of its scenarios. p is not corrected. The hardware score is that of the scenarios with "
    "the robot's hardware profile."
)
"""Text above the table of scores, which explains the scores."""
ALT = "Share of the episodes that succeed, of each policy on each axis at its severities, in per cent"
"""Alternative text (for screen readers) of the plot of success on every disturbance axis."""
HARDWARE_SCORES = "hardware_scores"
"""Key in results.json of the policies' scores on the scenarios with the robot's hardware profile.

The hardware profile consists of models of the real robot's motors, delays and sensors.
"""
KINDS = "scores", HARDWARE_SCORES
"""Keys in results.json of the policies' scores without and with the robot's hardware profile.

The hardware profile consists of models of the real robot's motors, delays and sensors.
"""
_KEYS = "policies", "scores", "baseline", "breaking_points", "versions", "episodes", "seed"
"""Keys that results.json must have."""


def read_results(path: Path) -> dict[str, Any]:
    """Read the results of an evaluation from its file results.json.

    Args:
        path: Path of the file.

    Returns:
        Content of the file, with NaN instead of null.

    Raises:
        UsageError: The file is missing or invalid, the evaluation is unfinished, or there are no scores.
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
    """Return the scores of all policies in an evaluation, the highest first.

    The score of a policy is its mean success over the disturbance axes (kinds of disturbance).

    Args:
        results: Content of results.json.
        kind: Key of the scores in results.json: `scores` for the scenarios without the robot's hardware profile (models
            of its real motors, delays and sensors), `hardware_scores` for the scenarios with it.

    Returns:
        One score per policy; empty if the evaluation has no scores of this kind.
    """
    return [Score(**score) for score in results.get(kind, ())]


def scenarios_of(results: dict[str, Any]) -> list[str]:
    """Return the names of all scenarios in the content of results.json, in their order."""
    return list(dict.fromkeys(name for policy in results["policies"].values() for name in policy["scenarios"]))


def made_by(results: dict[str, Any]) -> str:
    """Return a line of Markdown with the command that produced the results, and with software versions.

    The command does not show options with default values. `results` is the content of results.json.
    """
    provenance = results.get("provenance", {})
    versions = results["versions"]
    scenarios = scenarios_of(results)
    battery = next((name for name in BATTERIES if [scenario.name for scenario in resolve((name,))] == scenarios), None)
    only_on = provenance.get("only_on", {})
    is_full = (battery,) == FULL_BATTERY
    options = {
        "policies": [f"{name}@{','.join(only_on[name])}" if name in only_on else name for name in results["policies"]],
        "scenarios": [*DEFAULT_BATTERY] if is_full else [battery] if battery else scenarios,
        "full": is_full,
        "episodes": results["episodes"],
        "seed": results["seed"],
    }
    words = command(options | provenance.get("hardware", {}))
    rule = versions.get("success_rule") or "success/1"
    older_rule = "" if rule == SUCCESS_RULE else f"; success by the older rule {rule}"
    return f"`{words}`; MuJoCo {versions['mujoco']}, Python {versions['python']}{older_rule}."


def overview_lines(results: dict[str, Any]) -> list[str]:
    """Return the lines of a Markdown table of scores and effort, one row per policy, and its caption.

    The score of a policy is its mean success over the disturbance axes (kinds of disturbance). Effort means measures
    such as the cost of transport. The caption also states the success on flat ground of the policies that have no
    score. `results` is the content of results.json.
    """
    scores = {score.policy: share(score.score, score.ci) for score in scores_of(results)}
    hardware_scores = {score.policy: share(score.score, score.ci) for score in scores_of(results, HARDWARE_SCORES)}
    cost_on = cost_scenario(scenarios_of(results))
    cells_by_policy = {policy: entry["scenarios"] for policy, entry in results["policies"].items()}
    summaries = shipped_summaries(results["policies"], robot_of(results))
    rows = []
    for policy in dict.fromkeys((*scores, *hardware_scores)):
        row = {"policy": f"`{policy}`", "about": summaries.get(policy, ABSENT)}
        row |= {"score": scores.get(policy, ABSENT), "hardware": hardware_scores.get(policy, ABSENT)}
        rows.append(row | _effort_cells(cells_by_policy.get(policy, {}).get(cost_on, {}).get("effort", {})))
    heads = {name: head for name, head in _overview_heads().items() if any(row[name] != ABSENT for row in rows)}
    effort_note = f"; effort {EFFORT_SCENARIOS[cost_on]}" if set(MAIN_EFFORT_TITLES) & set(heads) else ""
    without_score = {
        policy: cells for policy, cells in cells_by_policy.items() if policy not in scores | hardware_scores
    }
    caption = f"{_overview_caption(results, effort_note)}{_on_flat_ground(without_score, summaries)}"
    return [*_with_text_column(table(heads, rows).splitlines(), heads), "", caption]


def _overview_heads() -> dict[str, str]:
    """Return the column headings of the table in `overview_lines`: name of the column -> heading."""
    heads = {
        "policy": "policy",
        "about": "controller",
        "score": "success",
        "hardware": "success with the hardware profile",
    }
    return heads | {name: ", ".join(filter(None, EFFORT_TITLES[name])) for name in MAIN_EFFORT_TITLES}


def _effort_cells(effort: Mapping[str, float]) -> dict[str, str]:
    """Format the main effort measures of a policy, for example the cost of transport, as cells of a table.

    Args:
        effort: Name of an effort measure -> value.

    Returns:
        Name of the measure -> text of the cell; a dash if the value is missing.
    """
    return {name: format_effort(name, effort.get(name, math.nan)) for name in MAIN_EFFORT_TITLES}


def _overview_caption(results: dict[str, Any], effort_note: str) -> str:
    """Return the caption of the table in `overview_lines`.

    `results` is the content of results.json; `effort_note` is a text about the columns with measures of
    effort, for example the cost of transport; it is empty if the table has no effort columns.
    """
    count = with_count(results["episodes"], "episode")
    axes = len(scores_of(results)[0].axes)
    return f"Success: mean over {axes} axes of disturbance, {count} at each severity{effort_note}."


def _with_text_column(lines: list[str], heads: dict[str, str]) -> list[str]:
    """Align the column with the description of the policy to the left, in the lines of a Markdown table.

    Args:
        lines: Lines of the table, with the description in the second column, `about`.
        heads: Name of the column -> heading.

    Returns:
        The changed lines; the same lines if the table has no column `about`.
    """
    if "about" not in heads:
        return lines
    return [lines[0], lines[1].replace("|---|---:|", "|---|---|", 1), *lines[2:]]


def _on_flat_ground(cells_by_policy: Mapping[str, Any], summaries: Mapping[str, str]) -> str:
    """Return sentences about the success on flat ground, one for each policy that has no score.

    Args:
        cells_by_policy: Policy that has no score -> scenario -> results on that scenario.
        summaries: Name of a policy -> its summary in one line.

    Returns:
        The sentences; empty if no policy was evaluated on flat ground.
    """
    sentences = ""
    for policy, cells in cells_by_policy.items():
        if FLAT in cells:
            about = f" ({summaries[policy]})" if policy in summaries else ""
            sentences += f" `{policy}`{about} on flat ground alone: {percent(cells[FLAT]['success_rate'])}."
    return sentences


def robots_table(results: Sequence[dict[str, Any]]) -> list[str]:
    """Return the lines of the Markdown table of scores on several robots, with one row per robot.

    A robot has a second row if it was also evaluated with its hardware profile (models of its real motors and sensors).
    The table has one column for each policy that was evaluated on all robots. `results` has one evaluation per robot,
    the content of its results.json.
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
    """Format scores of policies as table cells: policy -> text; a dash if the score is missing."""
    return {name: share(scores[name].score, scores[name].ci) if name in scores else ABSENT for name in policies}


def robot_of(results: dict[str, Any]) -> Robot:
    """Load the robot of an evaluation; raise UsageError if it cannot be loaded on this machine.

    `results` is the content of the evaluation's results.json.
    """
    name = results.get("provenance", {}).get("hardware", {}).get("robot", HardwareConfig.robot)
    return parse_robot_option(name, "the results' robot").robot_model


def score_table(
    scores: Sequence[Score],
    baseline: str,
    display_names: Mapping[str, str] | None = None,
    hardware_scores: Sequence[Score] = (),
) -> list[str]:
    """Create the Markdown table of the scores, and of their differences from a baseline policy.

    The score of a policy is its mean success over the disturbance axes (kinds of disturbance). The hardware profile
    consists of models of the real robot's motors, delays and sensors.

    Args:
        scores: Scores of the scenarios without the robot's hardware profile, one per policy.
        baseline: Name of the policy from which the differences are computed.
        display_names: Policy -> text that the table shows instead of the policy's name.
        hardware_scores: Scores of the scenarios with the hardware profile, for additional columns on the right.

    Returns:
        Lines of Markdown.
    """
    columns = {name: column for name, column in zip(SCORES, (scores, hardware_scores), strict=True) if column}
    baseline_name = (display_names or {}).get(baseline, f"`{baseline}`")
    heads = {"policy": "policy"}
    rows: dict[str, dict[str, str]] = {}
    for name, column in columns.items():
        heads |= {name: f"{name}, %", f"{name} difference": f"minus {baseline_name}, % points"}
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
    """Format a score, and its difference from the score of the baseline, as cells of a table.

    Args:
        score: Score of a policy.
        baseline: Name of the baseline policy.
        name: Name of the column of the score.

    Returns:
        Name of the column -> text.
    """
    percent_score = points_with(score.score, score.ci)
    difference = points_with(score.difference, score.difference_ci)
    difference_text = f"{difference.value} [{difference.interval}]"
    if not math.isnan(score.p_value):
        difference_text += f", {p_value(score.p_value)}"
    return {
        name: f"{percent_score.value} [{percent_score.interval}{NO_BREAK}%]",
        f"{name} difference": difference_text if score.policy != baseline else ABSENT,
    }


def draw_figures(results: dict[str, Any], picture: Path) -> None:
    """Draw the plots of an evaluation as PNG files: success on every axis, and the Pareto front.

    Args:
        results: Content of results.json.
        picture: File NAME.png for the success of every policy on every disturbance axis. The Pareto front of success
            and cost of transport is written to NAME_pareto.png if the evaluation has one.
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
    """Return Markdown that shows the plots of an evaluation, which `draw_figures` has drawn.

    Args:
        results: Content of results.json.
        path: Path from the page to the plot of success, NAME.png.

    Returns:
        Markdown for the plot of success, and for the Pareto front if the evaluation has one.
    """
    has_front = bool(results.get("pareto", {}).get("front"))
    front = f" ![{pareto.ALT}]({path.removesuffix('.png')}_pareto.png)" if has_front else ""
    return f"![{ALT}]({path}){front}"


def figure_to_png(figure: "Figure") -> bytes:
    """Encode a Matplotlib figure as a PNG image with a white background."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=160, facecolor="white", metadata={"Software": None})
    return buffer.getvalue()
