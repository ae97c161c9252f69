"""What the parameters of a policy are worth in the search for success: what becomes of it on many grounds."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.metrics import Measures, measure
from evaluate.measures.outcomes import OUTCOMES, RULES, SUCCESS_RULE
from evaluate.measures.tracking import VELOCITY_CAP
from evaluate.rollouts.rollout import STEPS, run_each
from policies.base import Floats, Policy
from train.scenarios import Purpose, practice
from train.search.trot_cost import Panel

EXERCISES = (
    *("flat=1.5", "flat=3", "push=35", "push=65", "rough=0.12", "rough=0.24", "slope=15", "slope=25", "stairs=0.1"),
    *("soft=0.02", "slippery=0.1", "force=60", "payload=20", "weak_motors=20", "slow_motors=5", "slow_motors=2"),
    *("latency=0.02", "latency=0.04", "latency=0.08", "noise=0.8", "surprise=1"),
)
"""Scenarios of the search unless others are asked for, all of one weight: from where a trot succeeds to where it seldom
does."""
OUTCOME_COSTS = dict(zip(OUTCOMES, (0.0, 1.0, 1.5, 2.0, 2.0, 2.0), strict=True))
"""Cost of what came of an episode; what is graded on top adds up to less than to the next one."""
DEVIATION_COST, ERROR_COST, OVERSPEED_COST = 0.25, 0.15, 0.1
"""Largest cost of what is graded: the worst command interval, the velocity error, and the share of joint readings above
the rated speed, without which a search leaves the robot behind that the motors could move."""
LARGEST_DEVIATION = 4.0
"""Deviation from the command, per what is allowed, from which on it costs no more."""
LARGEST_OVERSPEED = 0.1
"""Share of joint readings above the rated speed from which on they cost no more."""
WORDS = (
    "Cost of an episode: "
    + ", ".join(f"{name} {cost:g}" for name, cost in OUTCOME_COSTS.items())
    + f", and on top of that up to {DEVIATION_COST:g} for the worst command interval, as a share of "
    f"{LARGEST_DEVIATION:g} times what is allowed, {ERROR_COST:g} for the velocity error, as a share of "
    f"{VELOCITY_CAP:g} m/s, and {OVERSPEED_COST:g} for overspeed, as a share of {LARGEST_OVERSPEED:g}."
)
"""The cost in words."""


def episode_costs(measures: Measures) -> Floats:
    """Cost of each episode, (episodes,): of its outcome, and of how far it was from a better one."""
    outcome = np.array([OUTCOME_COSTS[each] for each in measures.outcome])
    deviation = RULES[SUCCESS_RULE].deviations(measures.commands, measures.mean_velocities)
    # What was not walked to its end, or not at all, is billed in full.
    worst = np.minimum(np.nan_to_num(deviation, nan=np.inf), LARGEST_DEVIATION).max(axis=1) / LARGEST_DEVIATION
    overspeed = np.minimum(np.nan_to_num(measures.overspeed, nan=1.0) / LARGEST_OVERSPEED, 1.0)
    error = measures.velocity_error / VELOCITY_CAP
    graded: Floats = DEVIATION_COST * worst + ERROR_COST * error + OVERSPEED_COST * overspeed
    return outcome + graded


def judge(
    candidates: Sequence[Policy], exercises: Sequence[str], seeds: NDArray[np.int64], steps: int, threads: int
) -> Floats:
    """Mean cost of each candidate over the exercises and seeds, (candidates,)."""
    costs = [episode_costs(measures) for measures in walked(candidates, exercises, seeds, "search", steps, threads)]
    mean: Floats = np.reshape(costs, (len(exercises), len(candidates), -1)).mean(axis=(0, 2))
    return mean


def walked(
    members: Sequence[Policy],
    exercises: Sequence[str],
    seeds: NDArray[np.int64],
    purpose: Purpose,
    steps: int = STEPS,
    threads: int = 1,
) -> list[Measures]:
    """What episodes from those seeds measure on each exercise, on ground of that purpose, member after member."""
    panel, scenarios = Panel(members, len(exercises)), [practice(each, purpose) for each in exercises]
    every_seed = np.tile(seeds, len(members))
    return [measure(each) for each in run_each(panel, scenarios, every_seed, nthread=threads, steps=steps)]
