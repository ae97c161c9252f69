"""Whether a policy stands and walks as its description says, and which of the usual mistakes explains it if not."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluate.rollouts.hardware import Hardware
from evaluate.rollouts.walking_test import Walk, walks
from policies.base import Actions, Policy
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


def tried(policy: Policy, robot: str, times: int = 1) -> list[Walk]:
    """Walks at each of COMMANDS on that robot, by name or path."""
    return walks(policy, Hardware(robot=robot), COMMANDS, SEEDS, times)


def faults(found: Sequence[Walk]) -> dict[str, str]:
    """Words about the worst walk at each command that was not followed, by command."""
    worst = {each.way: each for each in sorted(found, key=lambda each: each.deviation)}
    return {way: worst[way].words for way in COMMANDS if way in worst and worst[way].deviation > 1.0}


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
        return np.concatenate([policy.act(own) for policy, own in zip(self._policies, shares, strict=True)])


def cause(policy: Foreign, robot: str) -> Correction | None:
    """The correction with which a policy that fails walks best, in this process; None where it walks with none."""
    assert policy.description is not None
    own = Hardware(robot=robot).quadruped
    for undone in (corrections, combined):
        groups: dict[bytes, list[tuple[Correction, Policy]]] = {}
        for each in undone(policy.description, own):
            made = DescribedPolicy(each.description, robot=own, control_period=policy.control_period)
            gains = made.robot.servo_stiffness.tobytes() + made.robot.servo_damping.tobytes()
            groups.setdefault(gains, []).append((each, made))  # robots of a batch have the same servos
        found = [pair for group in groups.values() for pair in _deviations(group, robot)]
        best, correction = min(found, key=lambda pair: pair[0])
        if best <= 1.0:
            return correction
    return None


def _deviations(group: Sequence[tuple[Correction, Policy]], robot: str) -> list[tuple[float, Correction]]:
    """How far each is off its commands at worst."""
    found = tried(Abreast([policy for _, policy in group]), robot, len(group))
    worst = np.reshape([walk.deviation for walk in found], (len(group), -1)).max(axis=1)
    return [(float(each), correction) for each, (correction, _) in zip(worst, group, strict=True)]


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
