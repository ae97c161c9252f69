"""Ranking in words: the best policy, and the test result of each pair of adjacent policies."""

from collections.abc import Iterator, Sequence

from evaluate.analysis.comparison import SIGNIFICANT
from evaluate.analysis.ranking import AdjacentPair, Ranking
from evaluate.analysis.results import Results
from evaluate.analysis.strengths import Strength, strengths
from evaluate.statistics.intervals import Interval
from quad_env.cli.format import join_names, p_value, percent, points_with, share, with_count

MAX_REPORTED_EPISODES = 10_000
"""Upper limit of the printed number of episodes that are needed to distinguish two policies."""
IDENTICAL_WORDS = "the same to the bit"
"""Words that are printed about two policies if all of their episodes are bit-identical."""
INDISTINGUISHABLE_WORDS = "cannot be distinguished"
"""Words that are printed about two policies if the corrected test shows no significant difference."""
UNCORRECTED_WORDS = "though its interval by itself excludes 0"
"""Words that are printed about a difference that is not significant, although its own interval excludes 0."""
MAX_NAMES = 3
"""Largest number of scenarios or disturbance axes that one printed list names."""


def ranking_verdict(ranked: Ranking) -> str:
    """Return one sentence with the best policy, its success, and its difference from the second policy."""
    if not ranked.places:
        return "No ranking: no policy has run every scenario"
    best, *others = ranked.places
    score = f"success {share(best.success, best.success_ci)}"
    if not others:
        return f"{best.policy}: {score}"
    second = others[0]
    pair = ranked.neighbours[0]
    if pair.identical:
        return f"{best.policy} comes first, {score}; {second.policy} is {IDENTICAL_WORDS}"
    if pair.distinguished:
        return f"{best.policy} is best: {score}, {_difference_text(pair)} more than {second.policy}"
    return f"{best.policy} comes first, {score}, but is not distinguished from {second.policy}"


def claim_text(corrected: float, ci: Interval, *, identical: bool) -> str:
    """Describe in words if a difference in success between two policies is significant.

    Args:
        corrected: p-value of the difference, corrected for the number of all tests.
        ci: 95 % interval of the difference, not corrected for the number of tests.
        identical: True if the episodes of the two policies are bit-identical.

    Returns:
        Text; it contains the p-value, if the episodes are not identical.
    """
    if identical:
        return IDENTICAL_WORDS
    if corrected < SIGNIFICANT:
        return f"distinguished, {p_value(corrected)}"
    words = f"{INDISTINGUISHABLE_WORDS}, {p_value(corrected)}"
    return f"{words}, {UNCORRECTED_WORDS}" if excludes_zero(ci) else words


def excludes_zero(ci: Interval) -> bool:
    """Return True if 0 is outside of the interval `ci`, that is, if both of its ends have the same sign."""
    return ci[0] > 0.0 or ci[1] < 0.0


def unranked_text(results: Results) -> str:
    """Return a text with the policies that are not ranked, and the reason; empty if all are ranked."""
    ranked = {place.policy for place in results.ranking.places}
    policies = [name for name in results.policies if name not in ranked]
    return f"not ranked, for want of scenarios that the others ran: {join_names(policies)}" if policies else ""


def adjacent_pair_lines(ranked: Ranking) -> Iterator[str]:
    """Yield a line of text on the difference in success of each pair of adjacent policies.

    The line describes the difference over all scenarios, and the differences on single scenarios.
    """
    for pair in ranked.neighbours:
        yield f"{_overall_text(pair, ranked.episodes)}{_per_scenario_text(pair, ranked)}"


def best_and_worst(results: Results) -> dict[str, tuple[str, str]]:
    """Return the disturbance axes on which each ranked policy is best and worst, as text.

    Args:
        results: Results of the run.

    Returns:
        Name of a policy -> two texts. The first text names the axes with the highest success of the policy. The second
        text names the axes with its lowest success, the lowest first, and the most common cause of failure on each
        axis. A text may be empty.
    """
    policies = [place.policy for place in results.ranking.places] or results.policies
    hardware = results.ranking.hardware
    return {
        policy: _best_and_worst_texts(strengths(results.cells, results.summaries, policy, hardware=hardware))
        for policy in policies
    }


def _best_and_worst_texts(on_axes: Sequence[Strength]) -> tuple[str, str]:
    """Return the disturbance axes on which one policy is best, and on which it is worst, as two texts.

    The first text is empty if there is only one axis, or if all axes have the same success below 100 %.

    Args:
        on_axes: Success of the policy on each axis, the highest first.

    Returns:
        Text with the best axes, and text with the worst axes and the most common cause of failure on each.
    """
    if not on_axes:
        return "", ""
    top = on_axes[0].success
    is_best_known = top > on_axes[-1].success or (len(on_axes) > 1 and top == 1.0)
    best = [axis for axis in on_axes if axis.success == top and is_best_known]
    worst = [axis for axis in reversed(on_axes) if axis not in best and axis.reason][:MAX_NAMES]
    best_text = f"{', '.join(axis.name for axis in best[:MAX_NAMES])} ({percent(top)})" if best else ""
    worst_text = ", ".join(f"{axis.name} {percent(axis.success)} ({axis.reason})" for axis in worst)
    return best_text, worst_text


def _difference_text(pair: AdjacentPair) -> str:
    """Format the score difference of two neighbours in the ranking, in percentage points, with interval."""
    difference = points_with(pair.difference, pair.ci)
    return f"{difference.value} points {difference.brackets}".rstrip()


def _overall_text(pair: AdjacentPair, episodes: int) -> str:
    """Describe the difference in success of two neighbours in the ranking over all scenarios, in words.

    `episodes` is the number of episodes of each policy on each scenario.
    """
    if pair.distinguished:
        return f"{pair.better} beats {pair.worse} by {_difference_text(pair)}"
    count = with_count(episodes, "episode")
    if pair.identical:
        return f"{pair.better} and {pair.worse} are {IDENTICAL_WORDS} in {count} of each scenario"
    text = f"{pair.better} and {pair.worse} {INDISTINGUISHABLE_WORDS} with {count}"
    if episodes > 1:
        text += f"; {_needed_text(pair.needed)} would be needed"
    uncorrected = f", {UNCORRECTED_WORDS}" if excludes_zero(pair.ci) else ""
    return f"{text} ({_difference_text(pair)}, corrected {p_value(pair.p_value_holm)}{uncorrected})"


def _needed_text(episodes: float) -> str:
    """Format the number of `episodes` needed to distinguish two policies: two digits, or `more than` …."""
    if episodes <= MAX_REPORTED_EPISODES:
        return f"about {float(f'{episodes:.2g}'):.0f}"
    return f"more than {MAX_REPORTED_EPISODES}"


def _per_scenario_text(pair: AdjacentPair, ranked: Ranking) -> str:
    """Describe the differences in success of two neighbours in the ranking on single scenarios, in words.

    The text is needed, because a result on a single scenario may seem to contradict the result over all scenarios. The
    text is empty if there is only one scenario.
    """
    if len(ranked.scenarios) == 1:
        return ""
    clauses = []
    if pair.distinguished and pair.better_on:
        verb = "shows" if len(pair.better_on) == 1 else "show"
        clauses.append(f"{_list_scenarios(pair.better_on)} alone {verb} it")
    elif pair.distinguished:
        together = f"{ranked.axes} axes" if ranked.axes > 1 else f"{len(ranked.scenarios)} levels"
        clauses.append(f"no single scenario shows it, the {together} together do")
    contrary = [(pair.worse, pair.worse_on)]
    if not pair.distinguished:
        contrary.insert(0, (pair.better, pair.better_on))
    exceptions = [f"{policy} is better on {_list_scenarios(scenarios)}" for policy, scenarios in contrary if scenarios]
    if exceptions:
        clauses.append(f"but {join_names(exceptions)}")
    return "".join(f"; {clause}" for clause in clauses)


def _list_scenarios(scenarios: Sequence[str]) -> str:
    """Return a text with the names of up to MAX_NAMES `scenarios`, and the number of further scenarios."""
    more = len(scenarios) - MAX_NAMES
    return join_names([*scenarios[:MAX_NAMES], f"{more} more"] if more > 0 else scenarios)
