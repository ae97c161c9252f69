"""Whether a policy stands and walks as its description says, and which of the usual mistakes explains it if not."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.hardware import HardwareConfig
from evaluate.rollouts.walking_test import Command, Walk, walks
from policies.base import Policy
from policies.external import ExternalPolicy
from policies.external.network_policy import NetworkPolicy
from policies.external.spec_errors import COMMON_ERRORS, ORDERS, Correction, corrections, second_corrections
from policies.policy_stack import PolicyStack
from quad_env.robots.robot import Robot
from quad_env.seeding import episode_seeds
from quad_env.sensing.height_scan import table_with

STAND = "to stand"
COMMANDS = {STAND: (0.0, 0.0, 0.0), "forward": (0.5, 0.0, 0.0), "in a curve": (0.5, 0.0, 0.8)}
"""m/s and rad/s of SimpleQuad; only in a curve is the world's frame another than the body's."""
SEEDS = episode_seeds("search", 0, 2)
SCREENED = {"in a curve": COMMANDS["in a curve"]}
"""Command of the walk that selects corrections."""
SCREENING = 2.0
"""Factor on the walk's duration: the screening walk is shorter by it."""
MOST_WALKS = 10
"""Largest number of corrections that are tried on all commands."""
NEAREST = 2
"""Number of corrections with a second one on top."""


@dataclass(frozen=True)
class ServosByRow(HardwareConfig):
    """Hardware with servo gains per robot."""

    gains: Any = None
    """Stiffness and damping, (2, n, 12)."""

    def env_kwargs(self, robot: Robot) -> dict[str, Any]:
        """Return the keyword arguments of an environment of this hardware, for the policy's `robot`."""
        return super().env_kwargs(robot) | {"servo": tuple(self.gains)}

    def mean_robot(self) -> Robot:
        """Return the environment's robot with mean gains."""
        is_one = (self.gains == self.gains[:, :1]).all()
        return self.robot_model.with_servo(*(self.gains[:, 0] if is_one else self.gains.mean(axis=1)))


def run_walk_tests(policy: Policy, robot: str, times: int = 1) -> list[Walk]:
    """Walks at each of COMMANDS on that robot, by name or path."""
    return walks(policy, HardwareConfig(robot=robot), COMMANDS, SEEDS, times)


def failure_messages(found: Sequence[Walk]) -> dict[str, str]:
    """Words about the worst walk at each command that was not followed, by command."""
    worst = {each.command_name: each for each in sorted(found, key=lambda each: each.deviation)}
    return {
        command_name: worst[command_name].description
        for command_name in COMMANDS
        if command_name in worst and worst[command_name].deviation > 1.0
    }


def failed(found: Sequence[Walk]) -> bool:
    """Whether the policy itself failed; a network may overflow from a mistake in its description."""
    return any(walk.failure and "not finite" not in walk.failure for walk in found)


def diagnose(policy: ExternalPolicy, robot: str) -> str:
    """Return the explanation of a policy's failure, in words: the correction with the best walk.

    The search undoes one mistake, then several in the order of the joints, then a second one on top of the best
    corrections. Each correction is tried on a short walk first, and the best of them on all commands, all in this
    process.

    Args:
        policy: It has a description.
        robot: Name or path.
    """
    assert policy.spec is not None
    own = HardwareConfig(robot=robot).robot_model
    singles: list[tuple[float, Correction]] = []
    for count in range(1, len(ORDERS) + 1):
        found = _deviations(policy, robot, corrections(policy.spec, own, count))
        if words := _best(found):
            return words
        singles += found
    for _, first in sorted(singles, key=_rank)[:NEAREST]:
        if words := _best(_deviations(policy, robot, second_corrections(first, own))):
            return words
    return f"no usual mistake alone explains it; tried: {', '.join(COMMON_ERRORS)}"


def _rank(scored: tuple[float, Correction]) -> float:
    """Return the deviation of a correction with its doubt."""
    deviation, correction = scored
    return deviation + correction.penalty


def _best(scored: Sequence[tuple[float, Correction]]) -> str:
    """Return the best correction, in words; empty if the policy walks with none."""
    walking = [pair for pair in scored if pair[0] <= 1.0]
    if not walking:
        return ""
    _, correction = min(walking, key=_rank)
    return f"it walks with {correction.changed_setting}: check {correction.keys_to_correct}"


def _deviations(policy: ExternalPolicy, robot: str, candidates: Iterable[Correction]) -> list[tuple[float, Correction]]:
    """Return the worst command deviation of a policy with each of the corrections that screen best.

    Args:
        policy: It has a description.
        robot: Name or path.
        candidates: Corrections of it.
    """
    own = HardwareConfig(robot=robot).robot_model
    tried_out = list(candidates)
    policies = [NetworkPolicy(each.spec, robot=own, control_period=policy.control_period) for each in tried_out]
    screened = _worst_deviations(policies, robot, SCREENED, SEEDS[:1], SCREENING)
    best = [
        place for place in np.argsort(screened, kind="stable")[:MOST_WALKS].tolist() if np.isfinite(screened[place])
    ]
    if not best:
        return []
    worst = _worst_deviations([policies[place] for place in best], robot, COMMANDS, SEEDS)
    return [(float(off), tried_out[place]) for off, place in zip(worst, best, strict=True)]


def _worst_deviations(
    policies: Sequence[Policy],
    robot: str,
    commands: Mapping[str, Command],
    seeds: NDArray[np.int64],
    shortened_by: float = 1.0,
) -> NDArray[np.float64]:
    """Return the worst command deviation of each policy, (n,); arguments as those of `walks`."""
    rows = len(commands) * len(seeds)
    gains = np.array([(each.robot.servo_stiffness, each.robot.servo_damping) for each in policies])
    hardware = ServosByRow(robot=robot, gains=np.repeat(gains.transpose(1, 0, 2), rows, axis=1))
    stack = PolicyStack(policies, replace_nonfinite=True, idle_when_fallen=True, robot=hardware.mean_robot())
    found = walks(stack, hardware, commands, seeds, len(policies), shortened_by)
    deviations = np.array([walk.deviation for walk in found], dtype=np.float64)
    worst: NDArray[np.float64] = deviations.reshape(len(policies), -1).max(axis=1)
    return worst


def remarks(policy: Policy) -> tuple[str, ...]:
    """Return the remarks on incomplete fields of a foreign policy's file, a line each."""
    return tuple(getattr(getattr(policy, "policy", policy), "remarks", ()))


def warning(policy: Policy, robot: str) -> str | None:
    """Return a line about a foreign policy that does not stand or walk; None for others."""
    inner: Any = getattr(policy, "policy", policy)  # within a safety layer
    is_described = getattr(inner, "spec", None) is not None
    if not is_described and not isinstance(inner, ExternalPolicy):
        return None
    found = run_walk_tests(inner, robot)
    inner.close()
    if not (seen := failure_messages(found)):
        return None
    first = next(iter(seen.values()))
    if failed(found):
        return first
    return f"{first}; {diagnose(inner, robot) if is_described else which_observation(inner)}"


def which_observation(policy: ExternalPolicy) -> str:
    """Return the question on a policy that does not walk and whose file does not describe its observation."""
    table = table_with(policy.robot, policy.height_scan)
    names = ", ".join(f"{name} {part.stop - part.start}" for name, part in table.slices.items())
    given = f"it was given this environment's {table.size} numbers ({names})"
    file = policy.name.rpartition(".py:")[0]
    if file or policy.name.lower().endswith(".zip"):
        remedy = "turn them into its own in a class of a Python file (docs/your-policy.md)"
    else:
        remedy = f"describe them: python -m quad_env doctor --policy {policy.name} --write mine.toml begins such a file"
    return f"{given}; if it was trained on others, such as legged_gym's or Isaac Lab's of the same size, {remedy}"
