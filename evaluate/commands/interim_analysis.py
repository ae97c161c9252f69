"""Interim analysis of a run with `--until settled` or `--minutes`: tests adjacent policies and can end the run early.

A run with a time limit also prints the ranking so far, before the first interim analysis.
"""

import time
from collections.abc import Callable, Iterator, Sequence

from evaluate.analysis.score import is_scored, select_scored_cells
from evaluate.cells import LabelledPolicy, PolicyScenarioResult
from evaluate.report.verdict import IDENTICAL_WORDS
from evaluate.statistics.sequential import AdjacentTest, compare_adjacent_policies, looks
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import number, percent, with_count
from quad_env.scenarios.scenario import Scenario

LINE_PERIOD = 30.0
"""Shortest time between two lines with the ranking so far, s."""


def interim_analysis(cells: Sequence[PolicyScenarioResult], limit: int, over: str = "") -> tuple[str, str]:
    """Test the adjacent policies of the present ranking, and decide if the run ends early.

    Args:
        cells: Present results of the run, one for each pair of policy and scenario, all with the same episodes.
        limit: Maximum number of episodes of each policy on each scenario.
        over: Reason for the end of the run if a time limit makes this analysis the last one; otherwise empty.

    Returns:
        line: Text to print, such as `24 of at most 96 episodes, 1 of 2 neighbours distinguished: a > b, b ~ c (p =
            0.2)`.
        ended: Reason for the end of the run; empty if the run continues.

    Raises:
        ValueError: The policies ran different episodes.
    """
    scored = select_scored_cells(cells, hardware=all(cell.scenario.hardware for cell in cells))
    values = {policy: scored.by_episode(policy) for policy in scored.cells_by_policy}
    pairs = compare_adjacent_policies(values, limit, is_last=bool(over))
    if not pairs:
        raise ValueError("policies that ran different episodes are not ranked")
    episodes = cells[0].episodes
    num_distinguished = sum(pair.distinguished for pair in pairs)
    texts = [_pair_text(pair, identical=scored.is_identical(pair.ahead, pair.behind)) for pair in pairs]
    line = f"{episodes} of at most {limit} episodes, {num_distinguished} of {len(pairs)} neighbours distinguished"
    ended = ""
    if num_distinguished == len(pairs):
        ended = "every two neighbours in the ranking are distinguished"
    elif over:
        ended = over
    elif episodes == limit:
        ended = "not every two neighbours in the ranking are distinguished"
    elif all(pair.distinguished or pair.futile for pair in pairs):
        ended = f"the neighbours not distinguished can hardly be with {limit}"
    return f"{line}: {', '.join(texts)}", ended


def after_round(
    cells: Sequence[PolicyScenarioResult], limit: int, minutes: float, *, out_of_time: bool
) -> tuple[str, str]:
    """Describe the ranking after a round of a run with a time limit, and decide if the run ends.

    An interim analysis tests the adjacent policies after the numbers of episodes that `looks` gives, and at the end.

    Args:
        cells: Present results of the run, one for each pair of policy and scenario, all with the same episodes.
        limit: Maximum number of episodes of each policy on each scenario.
        minutes: Time limit, min.
        out_of_time: True if no further round fits into the time limit.

    Returns:
        line: Text to print.
        ended: Reason for the end of the run; empty if the run continues.
    """
    episodes = cells[0].episodes
    over = f"the time limit of {minutes:g} min was reached" if out_of_time else ""
    if not _is_ranked(cells):
        return f"{with_count(episodes, 'episode')} of each policy on each scenario", over or _at_limit(episodes, limit)
    if out_of_time or episodes in looks(limit):
        return interim_analysis(cells, limit, over)
    return ranking_so_far(cells), ""


def _at_limit(episodes: int, limit: int) -> str:
    """Return the reason for the end of a run without a ranking; empty before the maximum number of `episodes`."""
    return "the maximum number of episodes was reached" if episodes == limit else ""


def _is_ranked(cells: Sequence[PolicyScenarioResult]) -> bool:
    """Return True if at least two policies have all scenarios that enter the ranking."""
    scored = select_scored_cells(cells, hardware=all(cell.scenario.hardware for cell in cells))
    return len(scored.cells_by_policy) > 1


def ranking_so_far(cells: Sequence[PolicyScenarioResult]) -> str:
    """Return a line with the mean success of each policy on the scenarios that all of them have run.

    Args:
        cells: Finished results of the run. The policies that run on every scenario have the same scenarios. Scenarios
            with the hardware profile are left out, unless there are no others.

    Returns:
        The line, for example `so far, 2 episodes on 3 scenarios: trot 67 %, stand 0 %`.
    """
    rates: dict[str, list[float]] = {}
    for cell in [cell for cell in cells if not cell.scenario.hardware] or cells:
        rates.setdefault(cell.policy, []).append(float(cell.measures.succeeded.mean()))
    count = max(map(len, rates.values()))
    means = {policy: sum(values) / count for policy, values in rates.items() if len(values) == count}
    ranked = sorted(means, key=lambda policy: -means[policy])
    extent = f"{with_count(cells[0].episodes, 'episode')} on {with_count(count, 'scenario')}"
    return f"so far, {extent}: {', '.join(f'{policy} {percent(means[policy])}' for policy in ranked)}"


class EarlyRanking:
    """Ranking of the scenarios that all policies have finished, printed while a run simulates.

    Args:
        policies: Policies of the run.
        clock: Function that returns the time, s.
    """

    def __init__(self, policies: Sequence[LabelledPolicy], clock: Callable[[], float] = time.monotonic) -> None:
        self._policies = policies
        self._clock = clock
        self._next_line = 0.0
        self._cells: dict[str, dict[str, PolicyScenarioResult]] = {}

    def add(self, cell: PolicyScenarioResult) -> str:
        """Add a finished result, and return the line to print; empty if no line is due.

        Args:
            cell: Result of one policy on one scenario.

        Returns:
            The line of `ranking_so_far` when a scenario is finished, at most once in LINE_PERIOD.
        """
        cells = self._cells.setdefault(cell.scenario.name, {})
        cells[cell.policy] = cell
        is_finished = len(cells) == sum(policy.runs_on(cell.scenario) for policy in self._policies)
        if not is_finished or self._clock() < self._next_line:
            return ""
        self._next_line = self._clock() + LINE_PERIOD
        return ranking_so_far([each for policies in self._finished_scenarios() for each in policies.values()])

    def _finished_scenarios(self) -> Iterator[dict[str, PolicyScenarioResult]]:
        """Yield the results of each scenario that all of its policies have finished: label of a policy -> result."""
        for cells in self._cells.values():
            scenario = next(iter(cells.values())).scenario
            if len(cells) == sum(policy.runs_on(scenario) for policy in self._policies):
                yield cells


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
