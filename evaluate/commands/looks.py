"""Looks at a run --until settled: which neighbours in the ranking are distinguished, and whether the run ends."""

from collections.abc import Sequence

from evaluate.analysis.score import is_scored, select_scored_cells
from evaluate.cells import LabelledPolicy, PolicyScenarioResult
from evaluate.report.verdict import IDENTICAL_WORDS
from evaluate.statistics.sequential import AdjacentTest, compare_adjacent_policies
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import number
from quad_env.scenarios.scenario import Scenario


def interim_analysis(cells: Sequence[PolicyScenarioResult], limit: int) -> tuple[str, str]:
    """The ranking of cells with at most so many episodes each, as in `24 of at most 96 episodes, 1 of 2 neighbours
    distinguished: a > b, b ~ c (p = 0.2)`; and why the run ends here, empty where it goes on."""
    found = select_scored_cells(cells, hardware=all(cell.scenario.hardware for cell in cells))
    pairs = compare_adjacent_policies({policy: found.by_episode(policy) for policy in found.cells_by_policy}, limit)
    if not pairs:
        raise ValueError("policies that ran different episodes are not ranked")
    episodes, known = cells[0].episodes, sum(each.distinguished for each in pairs)
    shown = (_shown(each, identical=found.is_identical(each.ahead, each.behind)) for each in pairs)
    line = f"{episodes} of at most {limit} episodes, {known} of {len(pairs)} neighbours distinguished"
    ended = ""
    if known == len(pairs) or episodes == limit:
        ended = f"{'not ' * (known < len(pairs))}every two neighbours in the ranking are distinguished"
    elif all(each.distinguished or each.futile for each in pairs):
        ended = f"the neighbours not distinguished can hardly be with {limit}"
    return f"{line}: {', '.join(shown)}", ended


def _shown(of: AdjacentTest, *, identical: bool) -> str:
    if identical:
        return f"{of.ahead} = {of.behind} ({IDENTICAL_WORDS})"
    if of.distinguished:
        return f"{of.ahead} > {of.behind}"
    return f"{of.ahead} ~ {of.behind} (p = {number(of.p_value, 2)})"


def check_ranked(policies: Sequence[LabelledPolicy], scenarios: Sequence[Scenario]) -> None:
    """Raise UsageError where no two policies would be ranked."""
    ranked = [each for each in scenarios if is_scored(each, all(other.hardware for other in scenarios))] or scenarios
    if sum(all(map(policy.runs_on, ranked)) for policy in policies) < 2:
        raise UsageError("--until settled: name two policies or more that run on every scenario")
