"""A results.json of `python -m evaluate` for README and docs: read, checked, shown as tables."""

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
"""Scenario with the success of a policy without a score."""
SCORE_WORDS = (
    "The score is the mean success over the axes, each axis and each of its severities alike; its interval counts "
    "episodes, each with all of its scenarios. p is not corrected. The hardware score is that of the scenarios with "
    "the robot's hardware profile."
)
"""Text above the table of scores."""
ALT = "Share of the episodes that succeed, of each policy on each axis at its severities, in per cent"
"""Text of the figure for readers who do not see it."""
HARDWARE_SCORES = "hardware_scores"
"""Key of the scores with the hardware profile."""
KINDS = "scores", HARDWARE_SCORES
"""Keys of the scores."""
_KEYS = "policies", "scores", "baseline", "breaking_points", "versions", "episodes", "seed"


def read_results(path: Path) -> dict[str, Any]:
    """Read a results.json, with NaN for null.

    Raises:
        UsageError: The file is missing, damaged, unfinished, or without scores.
    """
    if not path.exists():
        raise UsageError(f"there is no {path}; `python -m evaluate --out {path.parent}` makes it")
    try:
        found = dict(null_to_nan(parse_json(read_bytes(path))))
        complete, versions = found["complete"], found["versions"]["mujoco"] and found["versions"]["python"]
        whole = bool(versions) and all(name in found for name in _KEYS if name != "scores")
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{path} is not a results.json of `python -m evaluate` ({error!r})") from error
    if not complete:
        raise UsageError(f"the evaluation of {path} was interrupted: carry it on with --resume")
    if not whole:
        raise UsageError(f"{path} is not a results.json of `python -m evaluate`: it lacks one of {', '.join(_KEYS)}")
    if all(len(each["axes"]) < 2 for each in found.get("scores", ())):
        raise UsageError(f"the evaluation of {path} has no scores: they need several axes of disturbance")
    return found


def scores_of(found: dict[str, Any], kind: str = "scores") -> list[Score]:
    """Return the scores in `found` under the key `kind`, the highest first; empty without any."""
    return [Score(**each) for each in found.get(kind, ())]


def scenarios_of(found: dict[str, Any]) -> list[str]:
    """Return the names of the scenarios, in the order of the run."""
    return list(dict.fromkeys(name for policy in found["policies"].values() for name in policy["scenarios"]))


def made_by(found: dict[str, Any]) -> str:
    """Return the command of these results, without options at their defaults, and the versions."""
    provenance, versions, scenarios = found.get("provenance", {}), found["versions"], scenarios_of(found)
    battery = next((name for name in BATTERIES if [one.name for one in resolve((name,))] == scenarios), None)
    only_on = provenance.get("only_on", {})
    chosen = {
        "policies": [f"{name}@{','.join(only_on[name])}" if name in only_on else name for name in found["policies"]],
        "scenarios": [battery] if battery else scenarios,
        "episodes": found["episodes"],
        "seed": found["seed"],
    }
    words = command(chosen | provenance.get("hardware", {}))
    rule = versions.get("success_rule") or "success/1"
    older = "" if rule == SUCCESS_RULE else f"; success by the older rule {rule}"
    return f"`{words}`; MuJoCo {versions['mujoco']}, Python {versions['python']}{older}."


def overview_lines(found: dict[str, Any]) -> list[str]:
    """Create a table of scores and effort, a row per policy, with its caption; in lines.

    The caption has the success on flat ground of policies without a score.
    """
    ideal, real = ({each.policy: share(each.score, each.ci) for each in scores_of(found, kind)} for kind in KINDS)
    place = cost_scenario(scenarios_of(found))
    heads = {"policy": "policy", "about": "controller", "score": "success", "real": "success with the hardware profile"}
    heads |= {name: ", ".join(filter(None, EFFORT_TITLES[name])) for name in MAIN_EFFORT_TITLES}
    cells_by_policy = {policy: of["scenarios"] for policy, of in found["policies"].items()}
    rows = []
    for policy in dict.fromkeys((*ideal, *real)):
        row = {"policy": f"`{policy}`", "about": SUMMARIES.get(policy, ABSENT)}
        row |= {"score": ideal.get(policy, ABSENT), "real": real.get(policy, ABSENT)}
        measured = cells_by_policy.get(policy, {}).get(place, {}).get("effort", {})
        effort = dict.fromkeys(MAIN_EFFORT_TITLES, math.nan) | measured
        rows.append(row | {name: format_effort(name, effort[name]) for name in MAIN_EFFORT_TITLES})
    shown = {name: head for name, head in heads.items() if any(row[name] != ABSENT for row in rows)}
    count = with_count(found["episodes"], "episode")
    axes = len(scores_of(found)[0].axes)
    effort_note = f"; effort {EFFORT_SCENARIOS[place]}" if set(MAIN_EFFORT_TITLES) & set(shown) else ""
    said = f"Success: mean over {axes} axes of disturbance, {count} at each severity{effort_note}."
    without_score = {policy: cells for policy, cells in cells_by_policy.items() if policy not in {*ideal, *real}}
    return [*_with_text_column(table(shown, rows).splitlines(), shown), "", said + _on_flat_ground(without_score)]


def _with_text_column(lines: list[str], heads: dict[str, str]) -> list[str]:
    """Align the column `about`, the second, to the left."""
    if "about" not in heads:
        return lines
    return [lines[0], lines[1].replace("|---|---:|", "|---|---|", 1), *lines[2:]]


def _on_flat_ground(cells_by_policy: dict[str, Any]) -> str:
    """Return a sentence for each policy without a score: its success on flat ground, and its description."""
    sentences = ""
    for policy, cells in cells_by_policy.items():
        if FLAT in cells:
            about = f" ({SUMMARIES[policy]})" if policy in SUMMARIES else ""
            sentences += f" `{policy}`{about} on flat ground alone: {percent(cells[FLAT]['success_rate'])}."
    return sentences


def robots_table(found: Sequence[dict[str, Any]]) -> list[str]:
    """Create the table of other robots: the score of each policy that all of them have.

    A further row has the scores with the hardware profile, if it was evaluated.
    """
    of_each = [{score.policy: score for score in scores_of(one)} for one in found]
    names, rows = [name for name in of_each[0] if all(name in each for each in of_each)], []
    for one, ideal, robot in zip(found, of_each, map(robot_of, found), strict=True):
        about = f"{robot.name}, {robot.mass:.1f} kg on legs of {robot.leg_length:.2f} m"
        real = {score.policy: score for score in scores_of(one, HARDWARE_SCORES)}
        for words, of in ((about, ideal), (f"{robot.name}, hardware profile", real)):
            shown = {name: share(of[name].score, of[name].ci) if name in of else ABSENT for name in names}
            rows += [{ROW_LABEL: words, **shown}] if of else []
    return table({ROW_LABEL: "robot", **{name: f"`{name}`" for name in names}}, rows).splitlines()


def robot_of(found: dict[str, Any]) -> Robot:
    """Return the robot of the evaluation. Raises UsageError if it is not available here."""
    name = found.get("provenance", {}).get("hardware", {}).get("robot", HardwareConfig.robot)
    return parse_robot_option(name, "the results' robot").robot_model


def score_table(
    of: Sequence[Score], baseline: str, display_names: Mapping[str, str] | None = None, real: Sequence[Score] = ()
) -> list[str]:
    """Create the table of scores and differences from the baseline.

    Args:
        scores: Scores without the hardware profile.
        baseline: Baseline of the differences.
        display_names: Policy -> name to show instead.
        hardware_scores: Scores with the hardware profile, for columns on the right.

    Returns:
        Lines of Markdown.
    """
    found = {name: kind for name, kind in zip(SCORES, (of, real), strict=True) if kind}
    heads, rows = {"policy": "policy"}, {each.policy: dict[str, str]() for kind in found.values() for each in kind}
    for name, kind in found.items():
        heads |= {name: f"{name}, %", f"{name} difference": f"minus `{baseline}`, % points"}
        for each in kind:
            rows[each.policy] |= _score_cells(each, baseline, name)
    names = {policy: (display_names or {}).get(policy, f"`{policy}`") for policy in rows}
    full = ({"policy": names[policy], **dict.fromkeys([*heads][1:], ABSENT), **row} for policy, row in rows.items())
    return [SCORE_WORDS, "", *table(heads, list(full)).splitlines()]


def _score_cells(each: Score, baseline: str, name: str) -> dict[str, str]:
    """Format a score and its difference."""
    shown = points_with(each.score, each.ci)
    difference = points_with(each.difference, each.difference_ci)
    score = f"{shown.value} [{shown.interval}{NO_BREAK}%]"
    minus = f"{difference.value} [{difference.interval}], {p_value(each.p_value)}"
    return {name: score, f"{name} difference": minus if each.policy != baseline else ABSENT}


def draw_figures(found: dict[str, Any], picture: Path) -> None:
    """Draw the figures of `found`: success of every policy on every axis as a PNG `picture`.

    The Pareto front, if any, goes to NAME_pareto.png.
    """
    front = found.get("pareto", {"front": ()})
    with drawing.plot_settings():
        write_atomically(
            picture, figure_to_png(success.draw_heat_map(scores_of(found), scores_of(found, HARDWARE_SCORES)))
        )
        if front["front"]:
            points = tuple(ParetoPoint(**each) for each in front["points"])
            drawn = pareto.draw_pareto_front(Pareto(front["cost_on"], front["front"], points), tuple(found["policies"]))
            write_atomically(picture.with_stem(f"{picture.stem}_pareto"), figure_to_png(drawn))


def picture_links(found: dict[str, Any], where: str) -> str:
    """Return links to the figures of `found` in Markdown; `where` is the path of the first from the page."""
    front = f" ![{pareto.ALT}]({where.removesuffix('.png')}_pareto.png)" if found.get("pareto", {}).get("front") else ""
    return f"![{ALT}]({where}){front}"


def figure_to_png(figure: "Figure") -> bytes:
    """Encode a figure on white as a PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=160, facecolor="white", metadata={"Software": None})
    return buffer.getvalue()
