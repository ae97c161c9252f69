"""Getting up: poses and times of the recovery, by the time until robots stand after random starts."""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from evaluate.rollouts.getting_up import TIME_ALLOWED, recover_with
from policies.base import Floats
from policies.behaviour import Behaviour
from policies.behaviour.recovery import PARAMETERS_FILE, RecoveryParameters, searched_parameters
from policies.behaviour.transitions import State
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from train.search.files import as_json
from train.search.panel import Panel
from train.search.subject import Effort, Options, Outcome, Seeds, Space, Subject

LATE_COST = 2.0
"""Added to the time of a robot that does not stand in time, s."""
TIMES = (0.05, 1.5)
"""Bounds of every blend and time, s; searched as their logarithms."""
THRESHOLDS = {
    "righted": (0.2, 0.8),
    "lost": (-0.2, 0.4),
    "caught": (1.0, 10.0),
    "kick_minimum": (0.05, 0.5),
    "upright": (0.2, 0.9),
}


def subject(options: Options, effort: Effort) -> Subject[RecoveryParameters]:
    """The search of the recovery, from the parameters in force."""
    start, (low, high) = searched_parameters(), bounds()
    first = 10_000 * (options.seed + 1)
    seeds = [episode_seeds("search", first + number, effort.episodes) for number in range(effort.generations)]

    def costs(candidates: list[RecoveryParameters], seeds: Seeds) -> Floats:
        return candidate_costs(candidates, seeds, options.threads)

    space = Space(np.clip(encoded(start), low, high), low, high, decoded, costs, seeds, apart=True)
    return Subject(start, PARAMETERS_FILE, lambda found: Outcome(as_json(found)), space)


def candidate_costs(candidates: list[RecoveryParameters], seeds: Seeds, threads: int) -> Floats:
    """Mean cost of each candidate, (candidates,): s until it stands, and more if that is late."""
    members = [Behaviour(start=State.RECOVER, follow=False, recovery=each) for each in candidates]
    outcome = recover_with(Panel(members), np.tile(seeds, len(candidates)), threads)
    time = np.minimum(outcome.standing_since, TIME_ALLOWED + 1.0)
    costs: Floats = (time + LATE_COST * (time > TIME_ALLOWED)).reshape(len(candidates), -1).mean(axis=1)
    return costs


def _scale(name: str) -> tuple[Callable[[Floats], Floats], Callable[[Floats], Floats]]:
    """To the search's scale of a parameter, and back: times as logarithms, the turning speed by tens."""
    if name.endswith(("_blend", "_time")):
        return np.log, np.exp
    factor = 10.0 if name == "caught" else 1.0
    return (lambda values: values / factor), (lambda values: values * factor)


def encoded(parameters: RecoveryParameters) -> Floats:
    """The parameters as one vector, each on its scale of the search."""
    return np.concatenate([_scale(name)[0](np.atleast_1d(value)) for name, value in asdict(parameters).items()])


def decoded(vector: Floats) -> RecoveryParameters:
    """The parameters of a vector of `encoded`."""
    values: dict[str, Any] = {}
    place = 0
    for name, like in asdict(searched_parameters()).items():
        width = len(like) if isinstance(like, tuple) else 1
        rounded = tuple(round(float(value), 4) for value in _scale(name)[1](vector[place : place + width]))
        values[name] = rounded if isinstance(like, tuple) else rounded[0]
        place += width
    return RecoveryParameters(**values)


def bounds() -> tuple[Floats, Floats]:
    """Smallest and largest value of every entry of `encoded`."""
    legs = [np.tile(ends[:3], 2) for ends in (SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper)]
    ends = {
        name: legs if isinstance(like, tuple) else THRESHOLDS.get(name, TIMES)
        for name, like in asdict(searched_parameters()).items()
    }
    low, high = (
        np.concatenate([_scale(name)[0](np.atleast_1d(both[end])) for name, both in ends.items()]) for end in (0, 1)
    )
    return low, high
