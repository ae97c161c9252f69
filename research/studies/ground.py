"""Dependence of success on the very surfaces: `python -m research ground` runs policies on two disjoint sets of them.

Every episode on random ground has its own surface, a part of one large field. Here the same episodes, seed by seed, run
on the field of the evaluation and on another one. If the results hold for such ground in general, each share of
successes lies within the 95 % interval of the other, except about one in six by chance. The paired difference is also
tested, corrected by Holm's method.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.markup import escape
from rich.table import Table

import policies
from evaluate.analysis.comparison import SIGNIFICANT
from evaluate.rollouts import battery
from evaluate.rollouts.experiment import LabelledPolicy, Settings, evaluation_seeds, run_cell
from evaluate.statistics.intervals import share_difference_interval, wilson_interval
from evaluate.statistics.significance import holm, mcnemar
from policies.base import Floats
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.format import ABSENT, MINUS, NO_BREAK, number, share
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import SmoothRandom

LIMITS = {"episodes": (1, 65_536), "seed": (0, 2**63 - 1), "other": (0, 2**31), "threads": (1, 256)}
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Options:
    """Compare successes on two sets of surfaces."""

    policies: tuple[str, ...] = ("document_repaired", "trot", "trot_feedback", "robust")
    """Names or folders of policies."""
    scenarios: tuple[str, ...] = ("rough", "rough:4")
    """Scenarios on random ground."""
    episodes: int = 64
    """Episodes of each policy on each scenario and set of surfaces (count)."""
    seed: int = 0
    """Which set of episodes (whole number from 0)."""
    other: int = 3
    """Seed of the other field; 1, 2 and those from 1000 on are the fields of validation, searches and training."""
    threads: int = 2
    """Threads of the simulation."""


@dataclass(frozen=True)
class Pair:
    """Successes of the same episodes on the ground of the evaluation and on the other, (n,) each."""

    policy: str
    scenario: str
    here: Bools
    there: Bools

    @property
    def agrees(self) -> bool:
        """Whether each share lies within the other's 95 % interval."""
        return _within(self.here.mean(), self.there) and _within(self.there.mean(), self.here)


def main(options: Options) -> int:
    """Run and print; exit code 1 where a difference is significant. Raises UsageError."""
    check_numbers(options, LIMITS)
    found = list(pairs(options, _on_random_ground(options)))
    corrected = holm([mcnemar(pair.here, pair.there) for pair in found])
    console = Console()
    console.print(table(found, corrected))
    console.print(f"within each other's 95 % interval: {sum(pair.agrees for pair in found)} of {len(found)}")
    return int(min(corrected) < SIGNIFICANT)


def pairs(options: Options, scenarios: list[Scenario]) -> Iterator[Pair]:
    """Successes of each policy on each scenario."""
    seeds = evaluation_seeds(options.seed, options.episodes)
    for scenario in scenarios:
        for name in options.policies:
            grounds = scenario, elsewhere(scenario, options.other)
            here, there = (succeeded(name, ground, seeds, options.threads) for ground in grounds)
            yield Pair(name, scenario.name, here, there)


def elsewhere(scenario: Scenario, seed: int) -> Scenario:
    """The scenario, if its ground is random on the field of that seed."""
    if not isinstance(scenario.terrain, SmoothRandom):
        return scenario
    return replace(scenario, terrain=replace(scenario.terrain, seed=seed))


def succeeded(policy: str, scenario: Scenario, seeds: NDArray[np.int64], threads: int) -> Bools:
    """Which of the episodes succeed, (n,)."""
    labelled = LabelledPolicy(policy, policies.resolve(policy))
    return run_cell(labelled, scenario, seeds, Settings(threads, lambda *_: None)).measures.succeeded


def table(found: list[Pair], corrected: list[float]) -> Table:
    """A row a pair."""
    made = Table("scenario", "policy", "success", "there", "points more", "p (Holm)", "within")
    for pair, p_value in zip(found, corrected, strict=True):
        only_there, only_here = int((pair.there & ~pair.here).sum()), int((pair.here & ~pair.there).sum())
        interval = share_difference_interval(only_there, only_here, len(pair.here))
        change = points_more(pair.there.mean() - pair.here.mean(), interval)
        figures = map(escape, (share_of(pair.here), share_of(pair.there), change))
        made.add_row(pair.scenario, pair.policy, *figures, f"{p_value:.2g}", "yes" if pair.agrees else "no")
    return made


def _on_random_ground(options: Options) -> list[Scenario]:
    try:
        found = list(battery.resolve(options.scenarios))
    except ValueError as error:
        raise UsageError(f"--scenarios: {error}") from error
    for scenario in found:
        if not isinstance(scenario.terrain, SmoothRandom):
            raise UsageError(f"--scenarios: the ground of {scenario.name} is not random; that of rough and gravel is")
        if scenario.terrain.seed == options.other:
            raise UsageError(f"--other: {options.other} is the ground of {scenario.name} itself; give another number")
    return found


def _interval(successes: Bools | Floats) -> tuple[float, float]:
    return wilson_interval(int(successes.sum()), len(successes))


def _within(value: float, successes: Bools) -> bool:
    low, high = _interval(successes)
    return low <= value <= high


def share_of(successes: Bools | Floats) -> str:
    """`41 % [36, 47]`: the share of successes, true or 1, with its 95 % interval."""
    return share(float(successes.mean()), _interval(successes))


def points_more(difference: float, ends: tuple[float, float]) -> str:
    """`−4 [−12, +3]`: a difference of shares with its interval, points."""
    low, high = (_signed(100.0 * end) for end in ends)
    return f"{_signed(100.0 * difference)} [{low},{NO_BREAK}{high}]"


def _signed(value: float) -> str:
    """A whole number with its sign."""
    text = number(value, 0)
    return text if text == ABSENT or text.startswith(MINUS) else f"+{text}"
