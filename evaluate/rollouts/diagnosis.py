"""Whether a policy stands and walks as its description says, and which of the usual mistakes explains it if not."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from evaluate.rollouts.hardware import Hardware
from evaluate.rollouts.walking_test import Walk, walks
from policies.base import Policy, PolicyError
from policies.foreign import Foreign
from policies.foreign.described import DescribedPolicy
from policies.foreign.mistakes import MISTAKES, Correction, combined, corrections
from policies.safety import Safe
from quad_env.seeding import episode_seeds

STAND = "to stand"
COMMANDS = {STAND: (0.0, 0.0, 0.0), "forward": (0.5, 0.0, 0.0), "in a curve": (0.5, 0.0, 0.8)}
"""m/s and rad/s of SimpleQuad; only in a curve is the world's frame another than the body's."""
SEEDS = episode_seeds("search", 0, 2)
TRIED = f"none of the usual mistakes alone explains it ({', '.join(MISTAKES)})"


def described(policy: Policy) -> Foreign | None:
    """The policy, without its safety layer, if it has a description; None if not."""
    inner = policy.policy if isinstance(policy, Safe) else policy
    return inner if isinstance(inner, Foreign) and inner.description is not None else None


def tried(policy: Policy, robot: str, *, to_first_fall: bool = False) -> list[Walk]:
    """Walks at each of COMMANDS on that robot, by name or path."""
    return walks(policy, Hardware(robot=robot), COMMANDS, SEEDS, to_first_fall=to_first_fall)


def faults(found: Sequence[Walk]) -> dict[str, str]:
    """Words about the worst walk at each command that was not followed, by command."""
    worst = sorted((each for each in found if each.deviation > 1.0), key=lambda each: each.deviation)
    return {each.way: each.words for each in worst}


def cause(policy: Foreign, robot: str) -> Correction | None:
    """The correction with which a policy that fails walks best, in this process; None where it walks with none."""
    assert policy.description is not None
    own = Hardware(robot=robot).quadruped
    make = partial(DescribedPolicy, robot=own, control_period=policy.control_period)
    for undone in (corrections, combined):
        found = [(_deviation(make, each, robot), each) for each in undone(policy.description, own)]
        best, correction = min(found, key=lambda each: each[0])
        if best <= 1.0:
            return correction
    return None


def _deviation(make: partial[DescribedPolicy], correction: Correction, robot: str) -> float:
    try:
        found = tried(make(correction.description), robot, to_first_fall=True)
    except PolicyError:
        return np.inf
    return max(walk.deviation for walk in found)


def finding(correction: Correction | None) -> str:
    """The cause in words."""
    return TRIED if correction is None else f"it walks with {correction.words}: check {correction.keys}"


def warning(policy: Foreign, robot: str) -> str | None:
    """A line about a policy that does not stand or walk as its description says; None for one that does."""
    found = tried(policy, robot)
    policy.close()
    if not (seen := faults(found)):
        return None
    failed = any(walk.failure for walk in found)
    return f"{next(iter(seen.values()))}{'' if failed else f'; {finding(cause(policy, robot))}'}"
