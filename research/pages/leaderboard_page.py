"""Functions that create the Markdown page of a leaderboard, which compares policies on one robot.

The page has a table of the success rates, a table for each scenario, and the sources of the published policies.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from evaluate.analysis.comparison import FALL_RATE, SUCCESS_RATE, Comparison
from evaluate.analysis.pareto import cost_scenario
from evaluate.analysis.results import Results
from evaluate.analysis.summary import summarise
from evaluate.cells import apply_success_rule
from evaluate.measures.outcomes import ISAAC_LAB, RULES
from evaluate.report.headings import EFFORT_TITLES, MAIN_EFFORT_TITLES, ROW_LABEL, format_effort
from evaluate.report.page import list_warnings
from evaluate.report.table import summary_figures
from evaluate.report.verdict import IDENTICAL_WORDS, claim_text
from quad_env.cli.format import ABSENT, estimate, number, points_with, share, with_count
from quad_env.robots.robot import Robot
from research.pages.markdown import IN_A_LINE, table
from research.pages.policy_list import PolicyList

COMPARED = SUCCESS_RATE, "velocity_error"
"""Names of the metrics for which the page compares each policy with the reference policy.

The page shows the metric of the policy minus the metric of the reference policy.
"""
COST = "cost_of_transport"
"""Name of the effort measure 'cost of transport' in the results of an evaluation."""


def mean_success(results: Results) -> dict[str, float]:
    """Return a dictionary: policy -> mean success rate over all scenarios, 0 to 1, the highest first."""
    rates = {
        policy: float(
            np.mean([summary.success_rate for (_, name), summary in results.summaries.items() if name == policy])
        )
        for policy in results.policies
    }
    return dict(sorted(rates.items(), key=lambda entry: -entry[1]))


def render_page(results: Results, policy_list: PolicyList, robots: Mapping[str, Robot], made_by: str) -> str:
    """Render the page of a leaderboard.

    Args:
        results: Results of all policies on all scenarios.
        policy_list: List of the policies of the leaderboard.
        robots: Name of a policy -> robot with the servo gains that the policy uses.
        made_by: Line with the command that makes the page, and with software versions.

    Returns:
        Text of the page, Markdown.
    """
    robot = next(iter(robots.values()))
    policies = list(mean_success(results))
    compared = "Our controllers and published policies" if policy_list.published else "Our controllers"
    lines = [
        f"# Leaderboard of {robot.name}",
        "",
        f"{compared} on {robot.name} ({robot.mass:.1f} kg), "
        f"each with its own servo gains: the same {with_count(results.episodes, 'episode')} of each scenario for all. "
        "Success, errors, intervals (95 %) and tests: [numbers.md](numbers.md). Differences are paired by episode, "
        f"minus `{results.baseline}`. Intervals are each by itself; p of success is corrected together with all claims "
        "of this page (Holm).",
        "",
        *(f"{line}.\n" for line in list_warnings(results)),
        made_by,
        "",
        *_overview(results, robots, policies),
        *(line for scenario in results.scenarios for line in _scenario(results, scenario, policies)),
        f"{ISAAC_LAB}: success by the thresholds of Isaac Lab, that is {RULES[ISAAC_LAB].description}.",
        "",
        *_sources(policy_list),
    ]
    return "\n".join(lines)


def _overview(results: Results, robots: Mapping[str, Robot], policies: Sequence[str]) -> Iterator[str]:
    """Yield the lines of the first table of the page: servo gains, success on every scenario, and effort.

    Effort means measures such as the cost of transport.

    Args:
        results: Results of all policies on all scenarios.
        robots: Name of a policy -> robot with the servo gains that the policy uses.
        policies: Names of the policies, in the order of the rows.

    Yields:
        Lines of Markdown.
    """
    scores = {score.policy: share(score.score, score.ci) for score in results.scores}
    effort_on = cost_scenario(results.scenarios) or results.scenarios[0]
    rows = []
    for policy in policies:
        row = {ROW_LABEL: policy, "gains": format_gains(robots[policy]), "mean": scores.get(policy, ABSENT)}
        for scenario in results.scenarios:
            row[scenario] = f"{number(100.0 * results.summaries[scenario, policy].success_rate, 0)} %"
        effort = results.summaries[effort_on, policy].effort
        rows.append(row | {name: format_effort(name, effort[name]) for name in MAIN_EFFORT_TITLES})
    heads = {ROW_LABEL: "policy", "gains": "servo: N·m/rad; N·m·s/rad", **{name: name for name in results.scenarios}}
    heads |= {"mean": "mean"}
    heads |= {name: ", ".join(filter(None, (*EFFORT_TITLES[name], effort_on))) for name in MAIN_EFFORT_TITLES}
    yield from ("## Success", "", table(heads, rows), "")


def format_gains(robot: Robot) -> str:
    """Format the stiffnesses, N·m/rad, and dampings, N·m·s/rad, of a robot's servos, as in `20, 40; 1, 2`."""
    gains = (np.ravel(robot.servo_stiffness), np.ravel(robot.servo_damping))
    return "; ".join(", ".join(dict.fromkeys(f"{value:.4g}" for value in values)) for values in gains)


def _scenario(results: Results, scenario: str, policies: Sequence[str]) -> Iterator[str]:
    """Yield the lines of the table of a scenario: results, and differences from the reference policy.

    The reference policy is the policy with which all other policies are compared.

    Args:
        results: Results of all policies on all scenarios.
        scenario: Name of the scenario.
        policies: Names of the policies, in the order of the rows.

    Yields:
        Lines of Markdown.
    """
    cells = {cell.policy: cell for cell in results.cells if cell.scenario.name == scenario}
    differences = {
        (comparison.a, comparison.metric): comparison
        for comparison in results.comparisons
        if comparison.scenario == scenario and comparison.b == results.baseline
    }
    heads = {name: IN_A_LINE[name] for name in (SUCCESS_RATE, FALL_RATE, "velocity_error", "yaw_rate_error")}
    heads |= {COST: "cost of transport", ISAAC_LAB: ISAAC_LAB}
    heads |= {f"{name} minus": f"{IN_A_LINE[name].partition(',')[0]}: minus `{results.baseline}`" for name in COMPARED}
    rows = []
    for policy in policies:
        isaac_lab = summarise(apply_success_rule(cells[policy], RULES[ISAAC_LAB]), results.hardware.robot_model)
        figures = summary_figures(results.summaries[scenario, policy], " ")
        figures[ISAAC_LAB] = share(isaac_lab.success_rate, isaac_lab.success_rate_ci)
        figures |= {f"{name} minus": _difference(differences.get((policy, name))) for name in COMPARED}
        rows.append({ROW_LABEL: policy} | figures)
    yield from (f"## {scenario}", "", table({ROW_LABEL: "policy", **heads}, rows), "")


def _difference(comparison: Comparison | None) -> str:
    """Format the difference of a policy from the reference policy, with its 95 % interval.

    A difference of the success rate is followed by the result of the significance test.

    Args:
        comparison: Comparison of the policy with the reference policy; None for the reference policy itself.

    Returns:
        The text; a dash for the reference policy itself.
    """
    if comparison is None:
        return ABSENT
    if comparison.metric != SUCCESS_RATE:
        if comparison.identical:
            return IDENTICAL_WORDS
        return estimate(comparison.difference, comparison.ci).with_interval
    difference = points_with(comparison.difference, comparison.ci).with_interval
    claim = claim_text(comparison.p_value_holm, comparison.ci, identical=comparison.identical)
    return f"{difference}, {claim}"


def _sources(policy_list: PolicyList) -> Iterator[str]:
    """Yield the lines of the table of the published policies' files, with link and SHA-256 hash.

    The generator is empty if the list has no published policy.
    """
    rows = [
        {ROW_LABEL: policy.name, "file": f"[{path}]({policy.url(path)})", "sha256": f"`{sha256}`"}
        for policy in policy_list.published
        for path, sha256 in policy.files.items()
    ]
    if rows:
        yield from ("## Sources", "", table({ROW_LABEL: "policy", "file": "file", "sha256": "SHA-256"}, rows), "")
