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


class Abreast(Policy):
    """Policies for one robot, each for as many of those of a batch."""

    name = "abreast"

    def __init__(self, policies: Sequence[Policy]) -> None:
        super().__init__(robot=policies[0].robot, control_period=policies[0].control_period)
        self.height_scan = policies[0].height_scan
        self._policies = policies

    def _allocate(self, num_envs: int) -> None:
        for policy in self._policies:
            policy.reset(num_envs // len(self._policies))

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        shares = np.split(observation, len(self._policies))
        actions = [policy.act(own) for policy, own in zip(self._policies, shares, strict=True)]
        return np.nan_to_num(np.concatenate(actions))  # a network that overflows falls


def tried(policy: Policy, robot: str, times: int = 1) -> list[Walk]:
    """Walks at each of COMMANDS on that robot, by name or path."""
    return walks(policy, Hardware(robot=robot), COMMANDS, SEEDS, times)


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
    groups: dict[bytes, list[tuple[Correction, Policy]]] = {}
    for each in corrections(policy.description, own, count):
        made = DescribedPolicy(each.description, robot=own, control_period=policy.control_period)
        gains = made.robot.servo_stiffness.tobytes() + made.robot.servo_damping.tobytes()
        groups.setdefault(gains, []).append((each, made))  # robots of a batch have the same servos
    for group in groups.values():
        found = tried(Abreast([made for _, made in group]), robot, len(group))
        worst = np.reshape([walk.deviation for walk in found], (len(group), -1)).max(axis=1)
        yield from ((float(off), correction) for off, (correction, _) in zip(worst, group, strict=True))


def remarks(policy: Policy) -> tuple[str, ...]:
    """Return what the file of a foreign policy leaves open, a line each."""
    return tuple(getattr(getattr(policy, "policy", policy), "remarks", ()))


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
