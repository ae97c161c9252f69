"""Interim analysis of a run with `--until settled`: tests adjacent policies and can end the run early."""

from collections.abc import Sequence

from evaluate.analysis.score import is_scored, select_scored_cells
from evaluate.cells import LabelledPolicy, PolicyScenarioResult
from evaluate.report.verdict import IDENTICAL_WORDS
from evaluate.statistics.sequential import AdjacentTest, compare_adjacent_policies
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import number
from quad_env.scenarios.scenario import Scenario


def interim_analysis(cells: Sequence[PolicyScenarioResult], limit: int) -> tuple[str, str]:
    """Test the adjacent policies of the present ranking, and decide if the run ends early.

    Args:
        cells: Present results of the run, one for each pair of policy and scenario, all with the same episodes.
        limit: Maximum number of episodes of each policy on each scenario.

    Returns:
        line: Text to print, such as `24 of at most 96 episodes, 1 of 2 neighbours distinguished: a > b, b ~ c (p =
            0.2)`.
        ended: Reason for the end of the run; empty if the run continues.

    Raises:
        ValueError: The policies ran different episodes.
    """
    scored = select_scored_cells(cells, hardware=all(cell.scenario.hardware for cell in cells))
    pairs = compare_adjacent_policies({policy: scored.by_episode(policy) for policy in scored.cells_by_policy}, limit)
    if not pairs:
        raise ValueError("policies that ran different episodes are not ranked")
    episodes = cells[0].episodes
    num_distinguished = sum(pair.distinguished for pair in pairs)
    texts = [_pair_text(pair, identical=scored.is_identical(pair.ahead, pair.behind)) for pair in pairs]
    line = f"{episodes} of at most {limit} episodes, {num_distinguished} of {len(pairs)} neighbours distinguished"
    ended = ""
    if num_distinguished == len(pairs):
        ended = "every two neighbours in the ranking are distinguished"
    elif episodes == limit:
        ended = "not every two neighbours in the ranking are distinguished"
    elif all(pair.distinguished or pair.futile for pair in pairs):
        ended = f"the neighbours not distinguished can hardly be with {limit}"
    return f"{line}: {', '.join(texts)}", ended


def _pair_text(pair: AdjacentTest, *, identical: bool) -> str:
    """Return the order of two policies as text: `a > b` if a is significantly better, otherwise `a ~ b`.

    Args:
        pair: Test of two policies that are adjacent in the ranking.
        identical: True if all episodes of the two policies are bit-identical.

    Returns:
        The text, with the p-value if the difference is not significant.
    """
    if identical:
        return f"{pair.ahead} = {pair.behind} ({IDENTICAL_WORDS})"
    if pair.distinguished:
        return f"{pair.ahead} > {pair.behind}"
    return f"{pair.ahead} ~ {pair.behind} (p = {number(pair.p_value, 2)})"


def check_ranked(policies: Sequence[LabelledPolicy], scenarios: Sequence[Scenario]) -> None:
    """Check that a run with `--until settled` has at least two policies that can be ranked.

    This run adds episodes until adjacent policies of the ranking are distinguished.

    Args:
        policies: Policies of the run.
        scenarios: Scenarios of the run.

    Raises:
        UsageError: Fewer than two policies run on every scored scenario.
    """
    hardware = all(scenario.hardware for scenario in scenarios)
    ranked = [scenario for scenario in scenarios if is_scored(scenario, hardware)] or scenarios
    num_ranked = sum(all(map(policy.runs_on, ranked)) for policy in policies)
    if num_ranked < 2:
        raise UsageError("--until settled: name two policies or more that run on every scenario")
