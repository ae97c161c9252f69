"""Whether a policy stands and walks as its description says, and which of the usual mistakes explains it if not."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.rollouts.hardware import Hardware
from evaluate.rollouts.walking_test import Walk, walks
from policies.base import Actions, Policy
from policies.foreign import Foreign
from policies.foreign.described import DescribedPolicy
from policies.foreign.mistakes import GAINS, MISTAKES, ORDERS, Correction, corrections
from quad_env.seeding import episode_seeds

STAND = "to stand"
COMMANDS = {STAND: (0.0, 0.0, 0.0), "forward": (0.5, 0.0, 0.0), "in a curve": (0.5, 0.0, 0.8)}
"""m/s and rad/s of SimpleQuad; only in a curve is the world's frame another than the body's."""
SEEDS = episode_seeds("search", 0, 2)


class Corrected(DescribedPolicy):
    """A policy by a corrected description; where its network overflows, its robot falls."""

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        return np.nan_to_num(super()._act(observation))


def tried(policy: Policy, robot: str) -> list[Walk]:
    """Walks at each of COMMANDS on that robot, by name or path."""
    return walks(policy, Hardware(robot=robot), COMMANDS, SEEDS)


def faults(found: Sequence[Walk]) -> dict[str, str]:
    """Words about the worst walk at each command that was not followed, by command."""
    worst = {each.way: each for each in sorted(found, key=lambda each: each.deviation)}
    return {way: worst[way].words for way in COMMANDS if way in worst and worst[way].deviation > 1.0}


def failed(found: Sequence[Walk]) -> bool:
    """Whether the policy itself failed; a network may overflow from a mistake in its description."""
    return any(walk.failure and "not finite" not in walk.failure for walk in found)


def cause(policy: Foreign, robot: str) -> str:
    """What explains that it fails, in words: the correction with which it walks best, tried in this process.

    Other gains than the policy's may suit it better than its own: they explain only what nothing else does.
    """
    for count in range(1, len(ORDERS) + 1):
        walking = [pair for pair in _deviations(policy, robot, count) if pair[0] <= 1.0]
        if walking:
            _, correction = min(walking, key=lambda pair: (pair[1].mistake == GAINS, round(pair[0], 1)))
            return f"it walks with {correction.words}: check {correction.keys}"
    return f"no usual mistake alone explains it; tried: {', '.join(MISTAKES)}"


def _deviations(policy: Foreign, robot: str, count: int) -> Iterator[tuple[float, Correction]]:
    """How far off its commands it is at worst with each correction, of so many mistakes of the order."""
    assert policy.description is not None
    own = Hardware(robot=robot).quadruped
    for each in corrections(policy.description, own, count):
        made = Corrected(each.description, robot=own, control_period=policy.control_period)
        yield max(walk.deviation for walk in tried(made, robot)), each


def warning(policy: Policy, robot: str) -> str | None:
    """A line about a policy that does not stand or walk as its description says; None for others."""
    inner: Any = getattr(policy, "policy", policy)  # within a safety layer
    if getattr(inner, "description", None) is None:
        return None
    found = tried(inner, robot)
    inner.close()
    if not (seen := faults(found)):
        return None
    return f"{next(iter(seen.values()))}{'' if failed(found) else f'; {cause(inner, robot)}'}"
