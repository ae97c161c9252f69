"""The ranking in words: which policy is best, and what is shown of each two neighbours."""

from collections.abc import Iterator, Sequence

from evaluate.analysis.comparison import SIGNIFICANT
from evaluate.analysis.ranking import AdjacentPair, Ranking
from evaluate.analysis.results import Results
from evaluate.analysis.strengths import strengths
from evaluate.statistics.intervals import Interval
from quad_env.cli.format import join_names, p_value, percent, points_with, share, with_count

MAX_REPORTED_EPISODES = 10_000
"""Episodes beyond which no number is given."""
SAME = "the same to the bit"
"""Words for policies with bit-identical episodes."""
ALIKE = "cannot be distinguished"
"""Words for policies without a significant difference in the corrected test."""
BY_ITSELF = "though its interval by itself excludes 0"
"""Words for a difference that only its own, uncorrected interval shows."""
NAMED = 3
"""Scenarios or axes that are named in a line."""


def verdict(ranked: Ranking) -> str:
    """Which policy is best, and by how much."""
    if not ranked.places:
        return "No ranking: no policy has run every scenario"
    best, *others = ranked.places
    score = f"success {share(best.success, best.success_ci)}"
    if not others:
        return f"{best.policy}: {score}"
    if ranked.neighbours[0].identical:
        return f"{best.policy} comes first, {score}; {others[0].policy} is {SAME}"
    if ranked.neighbours[0].distinguished:
        return f"{best.policy} is best: {score}, {_size(ranked.neighbours[0])} more than {others[0].policy}"
    return f"{best.policy} comes first, {score}, but is not distinguished from {others[0].policy}"


def claim(corrected: float, ci: Interval, *, identical: bool) -> str:
    """Return the result of the corrected test on one difference of success, in words.

    Args:
        corrected: Its p-value, corrected together with all claims.
        ci: Its 95 % interval, which is not corrected.
        identical: Whether the episodes are the same to the bit.
    """
    if identical:
        return SAME
    if corrected < SIGNIFICANT:
        return f"distinguished, {p_value(corrected)}"
    words = f"{ALIKE}, {p_value(corrected)}"
    return f"{words}, {BY_ITSELF}" if excludes_zero(ci) else words


def excludes_zero(ci: Interval) -> bool:
    """Return whether an interval has one sign."""
    return ci[0] > 0.0 or ci[1] < 0.0


def unranked(results: Results) -> str:
    """Which policies have no place in the ranking, and why; empty where all have one."""
    rest = [name for name in results.policies if all(each.policy != name for each in results.ranking.places)]
    return f"not ranked, for want of scenarios that the others ran: {join_names(rest)}" if rest else ""


def lines(ranked: Ranking) -> Iterator[str]:
    """For each two neighbours: what all scenarios together show of them, and what single ones do."""
    for each in ranked.neighbours:
        yield f"{_overall_text(each, ranked.episodes)}{_per_scenario_text(each, ranked)}"


def best_and_worst(results: Results) -> dict[str, tuple[str, str]]:
    """Ranked policy -> where it is best, everywhere with the same success, and where it is worst, that first, with the
    most common cause of failure there; empty where there is nothing to say."""
    words = {}
    for policy in [each.policy for each in results.ranking.places] or results.policies:
        found = strengths(results.cells, results.summaries, policy, hardware=results.ranking.hardware)
        top, bottom = (found[0].success, found[-1].success) if found else (0.0, 0.0)
        best = [each for each in found if each.success == top and (top > bottom or (len(found) > 1 and top == 1.0))]
        worst = [each for each in found[::-1] if each not in best and each.reason][:NAMED]
        strong = f"{', '.join(each.name for each in best[:NAMED])} ({percent(top)})" if best else ""
        words[policy] = strong, ", ".join(f"{each.name} {percent(each.success)} ({each.reason})" for each in worst)
    return words


def _size(of: AdjacentPair) -> str:
    shown = points_with(of.difference, of.ci)
    return f"{shown.value} points {shown.brackets}".rstrip()


def _overall_text(of: AdjacentPair, episodes: int) -> str:
    if of.distinguished:
        return f"{of.better} beats {of.worse} by {_size(of)}"
    if of.identical:
        return f"{of.better} and {of.worse} are {SAME} in {with_count(episodes, 'episode')} of each scenario"
    said = f"{of.better} and {of.worse} {ALIKE} with {with_count(episodes, 'episode')}"
    if episodes > 1:
        needed = (
            f"about {float(f'{of.needed:.2g}'):.0f}"
            if of.needed <= MAX_REPORTED_EPISODES
            else f"more than {MAX_REPORTED_EPISODES}"
        )
        said += f"; {needed} would be needed"
    by_itself = f", {BY_ITSELF}" if excludes_zero(of.ci) else ""
    return f"{said} ({_size(of)}, corrected {p_value(of.p_value_holm)}{by_itself})"


def _per_scenario_text(of: AdjacentPair, ranked: Ranking) -> str:
    """What single scenarios show, so that they do not seem to contradict all of them together."""
    if len(ranked.scenarios) == 1:
        return ""
    against = [(of.worse, of.worse_on)] if of.distinguished else [(of.better, of.better_on), (of.worse, of.worse_on)]
    but = [f"{policy} is better on {_named(on)}" for policy, on in against if on]
    said = [f"but {join_names(but)}"] if but else []
    if of.distinguished and of.better_on:
        said = [f"{_named(of.better_on)} alone show{'s' * (len(of.better_on) == 1)} it", *said]
    elif of.distinguished:
        together = f"{ranked.axes} axes" if ranked.axes > 1 else f"{len(ranked.scenarios)} levels"
        said = [f"no single scenario shows it, the {together} together do", *said]
    return "".join(f"; {each}" for each in said)


def _named(scenarios: Sequence[str]) -> str:
    more = len(scenarios) - NAMED
    return join_names([*scenarios[:NAMED], f"{more} more"] if more > 0 else scenarios)
