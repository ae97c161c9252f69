"""Runs until settled on made-up batteries whose true scores are known: wrong claims, and their episodes."""

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
"""Most episodes."""
SHARES = {"episode": 0.02, "scenario": 0.4, "policy": 0.01, "own": 0.57}
"""Of the variance of an outcome's luck: common to an episode, to it on a scenario, to it with a policy."""
EASIEST_SUCCESS, HARDEST_SUCCESS = 0.9, 0.05
"""Success of the worst policy on the easiest scenario and on the hardest, evenly spread in between."""
FIXED_PLANS = tuple(range(4, MAX_EPISODES + 1, 2))
"""Numbers of episodes of the fixed plans."""


@dataclass(frozen=True)
class Battery:
    """Policies on so many scenarios, and their true scores, in points more than the worst has."""

    points: tuple[float, ...]
    scenarios: int

    @property
    def name(self) -> str:
        """What the battery is, in words."""
        apart = [high - low for low, high in pairwise(sorted(set(self.points)))]
        alike = "alike" if not apart else f"{'in pairs ' if 0 in np.diff(self.points) else ''}{apart[0]:g} points apart"
        return f"settled: {len(self.points)} policies {alike}, {self.scenarios} scenarios"

    def values(self, generator: np.random.Generator, count: int = MAX_EPISODES) -> dict[str, Floats]:
        """Share of the scenarios that each policy succeeds on in each episode, (count,), by its number as its name."""
        from scipy.special import ndtri

        policies, scenarios = len(self.points), self.scenarios
        shapes = ((1, 1, count), (1, scenarios, count), (policies, 1, count), (policies, scenarios, count))
        luck = sum(np.sqrt(s) * generator.normal(size=n) for s, n in zip(SHARES.values(), shapes, strict=True))
        chances = np.linspace(EASIEST_SUCCESS, HARDEST_SUCCESS, scenarios) + np.array(self.points)[:, None] / 100.0
        return {str(number): row for number, row in enumerate((luck < ndtri(chances)[..., None]).mean(axis=1))}


BATTERIES = tuple(
    Battery(points, scenarios)
    for points in ((0, 0), (0, 5), (0, 0, 0, 0, 0, 0), (0, 0, 5, 5, 10, 10))
    for scenarios in (4, 12, 51)
)
"""Two policies and six, alike and 5 points apart; from a quick battery to the default one."""


@dataclass(frozen=True)
class SequentialRunResult:
    """A run until settled."""

    episodes: int
    has_false_claim: bool
    """Whether it claims a difference of two neighbours that are alike or the other way round."""
    has_found_all: bool
    """Whether it distinguishes all neighbours that differ."""
    fixed: tuple[bool, ...]
    """The same of plans with FIXED episodes."""


def simulate_run(battery: Battery, generator: np.random.Generator) -> SequentialRunResult:
    """One made-up run, looked at as `python -m evaluate --until settled` does."""
    values = battery.values(generator)
    fixed = tuple(_found_by_fixed(battery, values, count) for count in FIXED_PLANS)
    for episodes in sequential.looks(MAX_EPISODES):
        pairs = sequential.compare_adjacent_policies(
            {name: each[:episodes] for name, each in values.items()}, MAX_EPISODES
        )
        if all(pair.distinguished or pair.futile for pair in pairs):
            break
    apart = [(battery.points[int(pair.ahead)] - battery.points[int(pair.behind)], pair.distinguished) for pair in pairs]
    has_false_claim = any(known and points <= 0.0 for points, known in apart)
    return SequentialRunResult(
        episodes, has_false_claim, all(known and points > 0.0 for points, known in apart if points), fixed
    )


def _found_by_fixed(battery: Battery, values: dict[str, Floats], count: int) -> bool:
    """Whether paired t-tests after so many episodes, corrected for the neighbours, distinguish all that differ."""
    from scipy.special import stdtr

    order = sorted(values, key=lambda name: -values[name][:count].mean())
    for ahead, behind in pairwise(order):
        points, difference = battery.points[int(ahead)] - battery.points[int(behind)], values[ahead] - values[behind]
        error = difference[:count].std(ddof=1) / np.sqrt(count)
        p_value = 2.0 * stdtr(count - 1, -difference[:count].mean() / error) if error > 0.0 else 1.0
        if points and (points < 0.0 or p_value > (1.0 - CONFIDENCE) / (len(order) - 1)):
            return False
    return True


def simulate_runs(battery: Battery, runs: int, seed: int) -> dict[str, float]:
    """Shares of the runs, mean number of episodes, and that of a fixed plan of the same power."""
    ended = [simulate_run(battery, np.random.default_rng([seed, number])) for number in range(runs)]
    power, episodes = np.mean([each.has_found_all for each in ended]), np.mean([each.episodes for each in ended])
    of_fixed = np.maximum.accumulate(np.mean([each.fixed for each in ended], axis=0))
    differ = len(set(battery.points)) > 1
    enough = [count for count, of in zip(FIXED_PLANS, of_fixed, strict=True) if of >= power]
    return {
        "wrong": float(np.mean([each.has_false_claim for each in ended])),
        "found": float(power) if differ else np.nan,
        "episodes": float(episodes),
        "fixed": float(next(iter(enough), MAX_EPISODES)) if power > 0.0 and differ else np.nan,
    }


def markdown_table(batteries: Sequence[Battery], runs: int, seed: int) -> list[str]:
    """A table in Markdown of the figures of these batteries."""
    heads = {ROW_LABEL: f"{runs} runs each", "wrong": "wrong claims, %", "found": "all found, %"}
    heads |= {"episodes": "mean episodes", "most": f"fewer than {MAX_EPISODES}, %", "fixed": "fixed plan, episodes"}
    rows = []
    for battery in track(batteries, "runs until settled", console=Console(stderr=True)):
        of = simulate_runs(battery, runs, seed)
        row = {"episodes": number(of["episodes"], 1), "fixed": number(of["fixed"], 0)}
        shares = {"wrong": of["wrong"], "found": of["found"], "most": 1.0 - of["episodes"] / MAX_EPISODES}
        rows.append({ROW_LABEL: battery.name} | row | {name: number(100.0 * each, 1) for name, each in shares.items()})
    return [markdown.table(heads, rows)]
