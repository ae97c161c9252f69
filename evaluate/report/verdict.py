"""Ranking in words: the best policy, and the result of the test of each adjacent pair."""

from collections.abc import Iterator, Sequence

from evaluate.analysis.comparison import SIGNIFICANT
from evaluate.analysis.ranking import AdjacentPair, Ranking
from evaluate.analysis.results import Results
from evaluate.analysis.strengths import strengths
from evaluate.statistics.intervals import Interval
from quad_env.cli.format import join_names, p_value, percent, points_with, share, with_count

MAX_REPORTED_EPISODES = 10_000
"""Largest number of needed episodes that is printed."""
IDENTICAL_WORDS = "the same to the bit"
"""Words for policies with bit-identical episodes."""
INDISTINGUISHABLE_WORDS = "cannot be distinguished"
"""Words for policies without a significant difference in the corrected test."""
UNCORRECTED_WORDS = "though its interval by itself excludes 0"
"""Words for a difference that only its own, uncorrected interval shows."""
MAX_NAMES = 3
"""Largest number of scenarios or axes that a line names."""


def ranking_verdict(ranked: Ranking) -> str:
    """Name the best policy and its lead, in one sentence."""
    if not ranked.places:
        return "No ranking: no policy has run every scenario"
    best, *others = ranked.places
    score = f"success {share(best.success, best.success_ci)}"
    if not others:
        return f"{best.policy}: {score}"
    if ranked.neighbours[0].identical:
        return f"{best.policy} comes first, {score}; {others[0].policy} is {IDENTICAL_WORDS}"
    if ranked.neighbours[0].distinguished:
        return f"{best.policy} is best: {score}, {_difference_text(ranked.neighbours[0])} more than {others[0].policy}"
    return f"{best.policy} comes first, {score}, but is not distinguished from {others[0].policy}"


def claim_text(corrected: float, ci: Interval, *, identical: bool) -> str:
    """Return the result of the corrected test on one difference of success, in words.

    Args:
        corrected: p-value, corrected together with all claims.
        ci: 95 % interval, not corrected.
        identical: Whether the episodes are bit-identical.

    Returns:
        Words with the p-value.
    """
    if identical:
        return IDENTICAL_WORDS
    if corrected < SIGNIFICANT:
        return f"distinguished, {p_value(corrected)}"
    words = f"{INDISTINGUISHABLE_WORDS}, {p_value(corrected)}"
    return f"{words}, {UNCORRECTED_WORDS}" if excludes_zero(ci) else words


def excludes_zero(ci: Interval) -> bool:
    """Return whether all values of an interval have one sign."""
    return ci[0] > 0.0 or ci[1] < 0.0


def unranked_text(results: Results) -> str:
    """Name the policies without a place in the ranking, and the reason; empty if all have one."""
    rest = [name for name in results.policies if all(each.policy != name for each in results.ranking.places)]
    return f"not ranked, for want of scenarios that the others ran: {join_names(rest)}" if rest else ""


def adjacent_pair_lines(ranked: Ranking) -> Iterator[str]:
    """Describe each adjacent pair: the result over all scenarios, and the results on single scenarios."""
    for each in ranked.neighbours:
        yield f"{_overall_text(each, ranked.episodes)}{_per_scenario_text(each, ranked)}"


def best_and_worst(results: Results) -> dict[str, tuple[str, str]]:
    """Name the axes on which each ranked policy is best and worst.

    Args:
        results: Results of the run.

    Returns:
        Policy -> axes with its highest success, and axes with its lowest success, the lowest first, with the most
        common cause of failure there. A text without content is empty.
    """
    words = {}
    for policy in [each.policy for each in results.ranking.places] or results.policies:
        found = strengths(results.cells, results.summaries, policy, hardware=results.ranking.hardware)
        top, bottom = (found[0].success, found[-1].success) if found else (0.0, 0.0)
        best = [each for each in found if each.success == top and (top > bottom or (len(found) > 1 and top == 1.0))]
        worst = [each for each in found[::-1] if each not in best and each.reason][:MAX_NAMES]
        strong = f"{', '.join(each.name for each in best[:MAX_NAMES])} ({percent(top)})" if best else ""
        words[policy] = strong, ", ".join(f"{each.name} {percent(each.success)} ({each.reason})" for each in worst)
    return words


def _difference_text(of: AdjacentPair) -> str:
    """Format the difference of a pair in points, with its interval."""
    shown = points_with(of.difference, of.ci)
    return f"{shown.value} points {shown.brackets}".rstrip()


def _overall_text(of: AdjacentPair, episodes: int) -> str:
    """Describe the result of a pair over all scenarios."""
    if of.distinguished:
        return f"{of.better} beats {of.worse} by {_difference_text(of)}"
    if of.identical:
        return f"{of.better} and {of.worse} are {IDENTICAL_WORDS} in {with_count(episodes, 'episode')} of each scenario"
    said = f"{of.better} and {of.worse} {INDISTINGUISHABLE_WORDS} with {with_count(episodes, 'episode')}"
    if episodes > 1:
        needed = (
            f"about {float(f'{of.needed:.2g}'):.0f}"
            if of.needed <= MAX_REPORTED_EPISODES
            else f"more than {MAX_REPORTED_EPISODES}"
        )
        said += f"; {needed} would be needed"
    by_itself = f", {UNCORRECTED_WORDS}" if excludes_zero(of.ci) else ""
    return f"{said} ({_difference_text(of)}, corrected {p_value(of.p_value_holm)}{by_itself})"


def _per_scenario_text(of: AdjacentPair, ranked: Ranking) -> str:
    """Describe the results of a pair on single scenarios, which could seem to contradict the overall one."""
    if len(ranked.scenarios) == 1:
        return ""
    against = [(of.worse, of.worse_on)] if of.distinguished else [(of.better, of.better_on), (of.worse, of.worse_on)]
    but = [f"{policy} is better on {_list_scenarios(on)}" for policy, on in against if on]
    said = [f"but {join_names(but)}"] if but else []
    if of.distinguished and of.better_on:
        said = [f"{_list_scenarios(of.better_on)} alone show{'s' * (len(of.better_on) == 1)} it", *said]
    elif of.distinguished:
        together = f"{ranked.axes} axes" if ranked.axes > 1 else f"{len(ranked.scenarios)} levels"
        said = [f"no single scenario shows it, the {together} together do", *said]
    return "".join(f"; {each}" for each in said)


def _list_scenarios(scenarios: Sequence[str]) -> str:
    """List up to MAX_NAMES scenarios, and the number of the others."""
    more = len(scenarios) - MAX_NAMES
    return join_names([*scenarios[:MAX_NAMES], f"{more} more"] if more > 0 else scenarios)
