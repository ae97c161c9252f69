"""Simulation of evaluations with `--until settled`: error rate, and number of episodes that they need.

With this option, an evaluation ranks the policies by score and adds episodes step by step. A sequential test compares
each policy with the next one in the ranking. The evaluation stops if each pair has a significant difference, or is
unlikely to get one. In this module, the outcomes of the episodes are random numbers, and the true scores of the
synthetic policies are known. A reported difference is false if the true scores are equal or have the opposite order.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from rich.console import Console
from rich.progress import track

from evaluate.report.headings import ROW_LABEL
from evaluate.statistics import sequential
from evaluate.statistics.intervals import CONFIDENCE, Floats
from quad_env.cli.format import number
from research.pages import markdown

MAX_EPISODES = 96
"""Maximum number of episodes on each scenario in a simulated evaluation with `--until settled`."""
VARIANCE_SHARES = {"episode": 0.02, "scenario": 0.4, "policy": 0.01, "own": 0.57}
"""Source of the variance of an episode's outcome -> fraction of the variance; the sum is 1.

A part of the randomness is common to all policies and scenarios of an episode (`episode`). Other parts are common to
all policies on one scenario (`scenario`), or to all scenarios of one policy (`policy`). The rest of the
randomness is independent (`own`)."""
EASIEST_SUCCESS = 0.9
"""True success rate of the worst policy on the easiest scenario.

The success rates of this policy on the other scenarios are evenly spaced down to HARDEST_SUCCESS."""
HARDEST_SUCCESS = 0.05
"""True success rate of the worst policy on the hardest scenario."""
FIXED_PLANS = tuple(range(4, MAX_EPISODES + 1, 2))
"""Numbers of episodes of the simulated evaluations of fixed size.

An evaluation of fixed size has a number of episodes that is chosen beforehand, and compares the policies only once.
Evaluations with `--until settled` are compared with evaluations of fixed size.
"""


@dataclass(frozen=True)
class Battery:
    """Set of scenarios, with synthetic policies that have known scores on these scenarios.

    The score of a policy is its mean success rate over the scenarios.
    """

    points: tuple[float, ...]
    """True score (mean success rate) of each policy minus score of the worst policy, percentage points."""
    scenarios: int
    """Number of scenarios on which all policies are evaluated."""

    @property
    def name(self) -> str:
        """Name of the battery in the table of results.

        The name states the number of policies, the distance between their true scores, and the number of scenarios.
        """
        gaps = [high - low for low, high in pairwise(sorted(set(self.points)))]
        if not gaps:
            spacing = "alike"
        elif 0 in np.diff(self.points):
            spacing = f"in pairs {gaps[0]:g} points apart"
        else:
            spacing = f"{gaps[0]:g} points apart"
        return f"settled: {len(self.points)} policies {spacing}, {self.scenarios} scenarios"

    def values(self, generator: np.random.Generator, count: int = MAX_EPISODES) -> dict[str, Floats]:
        """Draw random outcomes of episodes, and compute the success rate of each policy in each episode.

        Args:
            generator: Random generator.
            count: Number of episodes on each scenario.

        Returns:
            Index of a policy, as text -> fraction of the scenarios on which this policy succeeds, for each episode,
            (count,).
        """
        from scipy.special import ndtri

        policies = len(self.points)
        scenarios = self.scenarios
        shapes = ((1, 1, count), (1, scenarios, count), (policies, 1, count), (policies, scenarios, count))
        noise = sum(
            np.sqrt(share) * generator.normal(size=shape)
            for share, shape in zip(VARIANCE_SHARES.values(), shapes, strict=True)
        )
        success = np.linspace(EASIEST_SUCCESS, HARDEST_SUCCESS, scenarios) + np.array(self.points)[:, None] / 100.0
        succeeded = noise < ndtri(success)[..., None]
        return {str(index): row for index, row in enumerate(succeeded.mean(axis=1))}


BATTERIES = tuple(
    Battery(points, scenarios)
    for points in ((0, 0), (0, 5), (0, 0, 0, 0, 0, 0), (0, 0, 5, 5, 10, 10))
    for scenarios in (4, 12, 51)
)
"""Batteries (sets of scenarios with synthetic policies): 2 or 6 policies on 4, 12 or 51 scenarios.

The two policies have equal scores, or scores that are 5 percentage points apart. The six policies have equal scores,
or are three pairs of equal policies with scores that are 5 percentage points apart.
"""


@dataclass(frozen=True)
class SequentialRunResult:
    """Result of a simulated evaluation with `--until settled`, made by `simulate_run`."""

    episodes: int
    """Number of episodes after which the evaluation stopped."""
    has_false_claim: bool
    """True if the evaluation reports a significant difference between two policies that is false.

    The true scores of the two policies are then equal, or have the opposite order."""
    has_found_all: bool
    """True if the evaluation finds all true differences between policies that are adjacent in the ranking."""
    fixed: tuple[bool, ...]
    """Results of evaluations of fixed size on the same outcomes of episodes.

    There is one result for each number of episodes in FIXED_PLANS. A result is True if the evaluation finds all true
    differences between policies that are adjacent in the ranking."""


def simulate_run(battery: Battery, generator: np.random.Generator) -> SequentialRunResult:
    """Simulate one evaluation with `--until settled` on random outcomes of episodes.

    A sequential test compares adjacent policies of the ranking at several interim analyses, after a quarter, a half,
    three quarters and all of MAX_EPISODES. The evaluation stops at the first interim analysis at which each pair has a
    significant difference, or is unlikely to get one.

    Args:
        battery: Scenarios and synthetic policies.
        generator: Random generator of the outcomes of episodes.

    Returns:
        The result of the evaluation, and of evaluations of fixed size on the same outcomes.
    """
    values = battery.values(generator)
    fixed = tuple(_found_by_fixed(battery, values, count) for count in FIXED_PLANS)
    for episodes in sequential.looks(MAX_EPISODES):
        values_so_far = {name: row[:episodes] for name, row in values.items()}
        tests = sequential.compare_adjacent_policies(values_so_far, MAX_EPISODES)
        if all(test.distinguished or test.futile for test in tests):
            break
    differences = [battery.points[int(test.ahead)] - battery.points[int(test.behind)] for test in tests]
    claims = [(points, test.distinguished) for points, test in zip(differences, tests, strict=True)]
    return SequentialRunResult(
        episodes=episodes,
        has_false_claim=any(is_claimed and points <= 0.0 for points, is_claimed in claims),
        has_found_all=all(is_claimed and points > 0.0 for points, is_claimed in claims if points),
        fixed=fixed,
    )


def _found_by_fixed(battery: Battery, values: dict[str, Floats], count: int) -> bool:
    """Return True if an evaluation of fixed size finds all true differences between adjacent policies.

    An evaluation of fixed size has a number of episodes that is chosen beforehand. Two policies are adjacent if they
    are neighbours in the ranking by measured score.

    Args:
        battery: Scenarios and synthetic policies.
        values: Index of a policy, as text -> fraction of the scenarios on which this policy succeeds, for each episode,
            (n,) with n >= `count`.
        count: Number of episodes, after which adjacent policies are compared by paired t-tests with the Bonferroni
            correction.

    Returns:
        True if all true differences are significant and have the right sign.
    """
    from scipy.special import stdtr

    ranked = sorted(values, key=lambda name: -values[name][:count].mean())
    level = (1.0 - CONFIDENCE) / (len(ranked) - 1)
    for ahead, behind in pairwise(ranked):
        points = battery.points[int(ahead)] - battery.points[int(behind)]
        differences = (values[ahead] - values[behind])[:count]
        error = differences.std(ddof=1) / np.sqrt(count)
        p_value = 2.0 * stdtr(count - 1, -differences.mean() / error) if error > 0.0 else 1.0
        if points and (points < 0.0 or p_value > level):
            return False
    return True


def simulate_runs(battery: Battery, runs: int, seed: int) -> dict[str, float]:
    """Simulate many evaluations with `--until settled`, and evaluations of fixed size on the same data.

    Args:
        battery: Scenarios and synthetic policies.
        runs: Number of simulated evaluations.
        seed: Seed of the simulated evaluations.

    Returns:
        Dictionary: `wrong`, fraction of the evaluations that report a false difference; `found`, fraction of the
        evaluations that find all true differences; `episodes`, mean number of episodes; `fixed`, number of episodes of
        the smallest evaluation of fixed size that finds all true differences at least as often. `found` and `fixed` are
        NaN if the policies do not differ.
    """
    results = [simulate_run(battery, np.random.default_rng([seed, number])) for number in range(runs)]
    power = np.mean([result.has_found_all for result in results])
    episodes = np.mean([result.episodes for result in results])
    fixed_power = np.maximum.accumulate(np.mean([result.fixed for result in results], axis=0))
    has_differences = len(set(battery.points)) > 1
    sufficient = [count for count, value in zip(FIXED_PLANS, fixed_power, strict=True) if value >= power]
    return {
        "wrong": float(np.mean([result.has_false_claim for result in results])),
        "found": float(power) if has_differences else np.nan,
        "episodes": float(episodes),
        "fixed": float(next(iter(sufficient), MAX_EPISODES)) if power > 0.0 and has_differences else np.nan,
    }


def markdown_table(batteries: Sequence[Battery], runs: int, seed: int) -> list[str]:
    """Create the Markdown table of the results of `simulate_runs`, with one row per battery.

    A battery is a set of scenarios with synthetic policies.

    Args:
        batteries: Sets of scenarios, each with synthetic policies.
        runs: Number of simulated evaluations for each battery.
        seed: Seed of the simulated evaluations.

    Returns:
        Lines of Markdown.
    """
    heads = {ROW_LABEL: f"{runs} runs each", "wrong": "wrong claims, %", "found": "all found, %"}
    heads |= {"episodes": "mean episodes", "most": f"fewer than {MAX_EPISODES}, %", "fixed": "fixed plan, episodes"}
    rows = []
    for battery in track(batteries, "runs until settled", console=Console(stderr=True)):
        figures = simulate_runs(battery, runs, seed)
        rows.append(
            {
                ROW_LABEL: battery.name,
                "episodes": number(figures["episodes"], 1),
                "fixed": number(figures["fixed"], 0),
                "wrong": number(100.0 * figures["wrong"], 1),
                "found": number(100.0 * figures["found"], 1),
                "most": number(100.0 * (1.0 - figures["episodes"] / MAX_EPISODES), 1),
            }
        )
    return [markdown.table(heads, rows)]
