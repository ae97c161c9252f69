"""Diagnosis of external policies that do not walk: search for a mistake in the policy's description.

An external policy was trained elsewhere. Its description defines its observations, joint order, signs, scales and servo
gains.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.hardware import HardwareConfig, ServosByRow
from evaluate.rollouts.walking_test import Command, Walk, run_walks
from policies.base import Policy
from policies.external import ExternalPolicy
from policies.external.network_policy import NetworkPolicy
from policies.external.spec_errors import COMMON_ERRORS, ORDERS, Correction, corrections, second_corrections
from policies.policy_stack import PolicyStack
from quad_env.seeding import episode_seeds
from quad_env.sensing.height_scan import table_with

STAND = "to stand"
COMMANDS = {STAND: (0.0, 0.0, 0.0), "forward": (0.5, 0.0, 0.0), "in a curve": (0.5, 0.0, 0.8)}
"""Name of a test command -> commanded forward and lateral velocity, m/s, and yaw rate, rad/s, for SimpleQuad.

The walk in a curve is needed to detect a wrong frame, because world frame and base frame differ only in a curve.
"""
SEEDS = episode_seeds("search", 0, 2)
SCREENING_COMMANDS = {"in a curve": COMMANDS["in a curve"]}
"""Name -> command of the short walk that selects corrections of a policy's description for full tests.

A command is forward and lateral velocity, m/s, and yaw rate, rad/s, for SimpleQuad.
"""
SCREENING_SPEEDUP = 2.0
"""Duration of a full test walk, divided by the duration of the short walk that selects corrections."""
MAX_FULL_TESTS = 10
"""Maximum number of corrections of a policy's description that get a full test after the short walk.

A full test has a walk for each test command: stand, walk forward, and walk in a curve.
"""
NUM_COMBINED_CORRECTIONS = 2
"""Number of best single corrections of a policy's description that are also tested with a second correction."""


def run_walk_tests(policy: Policy, robot: str, copies: int = 1) -> list[Walk]:
    """Test a policy: run a short walk for each command in COMMANDS and each of two seeds.

    Args:
        policy: Policy to test.
        robot: Name of the robot, or path of its model file.
        copies: Number of repetitions of all walks.

    Returns:
        Results of the walks, sorted by repetition, then by command, then by seed.
    """
    return run_walks(policy, HardwareConfig(robot=robot), COMMANDS, SEEDS, copies)


def failure_messages(walks: Sequence[Walk]) -> dict[str, str]:
    """Describe the worst of the `walks` for each command that the policy did not follow: command -> text."""
    worst = {walk.command_name: walk for walk in sorted(walks, key=lambda walk: walk.deviation)}
    return {name: worst[name].description for name in COMMANDS if name in worst and worst[name].deviation > 1.0}


def has_policy_failure(walks: Sequence[Walk]) -> bool:
    """Return True if the policy raised an error or returned no action in any of the `walks`.

    Actions that are not finite do not count, because a wrong description can make the outputs of a correct network
    overflow.
    """
    return any(walk.failure and "not finite" not in walk.failure for walk in walks)


def diagnose(policy: ExternalPolicy, robot: str) -> str:
    """Search for the mistake in the description of an external policy due to which it does not walk.

    The search corrects common mistakes and tests the corrected policies. It first corrects one mistake at a time, and
    then several mistakes in the order of the joints at once. Finally it adds a second correction to each of the best
    corrections. All corrections are tested on a short walk, and the best corrections also with all test commands.

    Args:
        policy: External policy with a description of its observations and actions.
        robot: Name of the robot, or path of its model file.

    Returns:
        A sentence with the correction with which the policy walks best, or with the list of mistakes that were tried.
    """
    assert policy.spec is not None
    robot_model = HardwareConfig(robot=robot).robot_model
    singles: list[tuple[float, Correction]] = []
    for count in range(1, len(ORDERS) + 1):
        scored = _deviations(policy, robot, corrections(policy.spec, robot_model, count))
        if explanation := _explain(scored):
            return explanation
        singles += scored
    for _, first in sorted(singles, key=_rank)[:NUM_COMBINED_CORRECTIONS]:
        if explanation := _explain(_deviations(policy, robot, second_corrections(first, robot_model))):
            return explanation
    return f"no usual mistake alone explains it; tried: {', '.join(COMMON_ERRORS)}"


def _rank(scored: tuple[float, Correction]) -> float:
    """Return the sort key of a correction of a policy's description: largest deviation plus penalty.

    `scored` is the pair of the largest deviation and the correction. The deviation is the velocity error of the
    corrected policy divided by the tolerance of the success rule.
    """
    deviation, correction = scored
    return deviation + correction.penalty


def _explain(scored: Sequence[tuple[float, Correction]]) -> str:
    """Return a part of a sentence that names the best correction of a policy's description.

    Args:
        scored: Pairs of largest deviation and correction. The deviation is the velocity error of the corrected policy
            divided by the tolerance of the success rule; a policy with a deviation of at most 1 walks.

    Returns:
        The text; empty if the policy walks with none of the corrections.
    """
    walking = [pair for pair in scored if pair[0] <= 1.0]
    if not walking:
        return ""
    _, correction = min(walking, key=_rank)
    return f"it walks with {correction.changed_setting}: check {correction.keys_to_correct}"


def _deviations(policy: ExternalPolicy, robot: str, candidates: Iterable[Correction]) -> list[tuple[float, Correction]]:
    """Test corrections of a policy's description: all on a short walk, then the best with all commands.

    Args:
        policy: External policy with a description of its observations and actions.
        robot: Name of the robot, or path of its model file.
        candidates: Corrections to test.

    Returns:
        Pairs of largest deviation and correction, sorted by the deviation on the short walk. The deviation is the
        largest velocity error for any command, divided by the tolerance of the success rule.
    """
    robot_model = HardwareConfig(robot=robot).robot_model
    tested = list(candidates)
    policies = [
        NetworkPolicy(correction.spec, robot=robot_model, control_period=policy.control_period) for correction in tested
    ]
    screened = _largest_deviations(policies, robot, SCREENING_COMMANDS, SEEDS[:1], SCREENING_SPEEDUP)
    ranked = np.argsort(screened, kind="stable")[:MAX_FULL_TESTS].tolist()
    best_ids = [index for index in ranked if np.isfinite(screened[index])]
    if not best_ids:
        return []
    deviations = _largest_deviations([policies[index] for index in best_ids], robot, COMMANDS, SEEDS)
    return [(float(deviation), tested[index]) for deviation, index in zip(deviations, best_ids, strict=True)]


def _largest_deviations(
    policies: Sequence[Policy],
    robot: str,
    commands: Mapping[str, Command],
    seeds: NDArray[np.int64],
    shortened_by: float = 1.0,
) -> NDArray[np.float64]:
    """Return the largest deviation of each policy from its commands over several test walks.

    Args:
        policies: Policies to test together in one simulation, each with its own servo gains.
        robot: Name of the robot, or path of its model file.
        commands: Name -> command for SimpleQuad: forward and lateral velocity, m/s, and yaw rate, rad/s.
        seeds: Seeds of the episodes.
        shortened_by: Duration of a full test walk, divided by the duration of these walks.

    Returns:
        Largest velocity error of each policy over its walks, divided by the tolerance of the success rule,
        (len(policies),). The value is infinite if the robot falls or the policy raises an error.
    """
    rows = len(commands) * len(seeds)
    gains = np.array([policy.robot.gains for policy in policies])
    hardware = ServosByRow(robot=robot, gains=np.repeat(gains.transpose(1, 0, 2), rows, axis=1))
    stack = PolicyStack(policies, replace_nonfinite=True, idle_when_fallen=True, robot=hardware.mean_robot())
    walks = run_walks(stack, hardware, commands, seeds, len(policies), shortened_by)
    deviations = np.array([walk.deviation for walk in walks], dtype=np.float64)
    largest: NDArray[np.float64] = deviations.reshape(len(policies), -1).max(axis=1)
    return largest


def remarks(policy: Policy) -> tuple[str, ...]:
    """Return a line of text for each incomplete field in the description file of an external `policy`."""
    return tuple(getattr(getattr(policy, "policy", policy), "remarks", ()))


def warning(policy: Policy, robot: str) -> str | None:
    """Test an external policy on short walks, and return a warning if it does not stand or walk.

    Args:
        policy: Policy to test. The test is skipped if the policy is not external, that is, trained elsewhere.
        robot: Name of the robot, or path of its model file.

    Returns:
        The warning; None if the policy stands and walks, or if the test was skipped.
    """
    # A safety layer wraps the external policy, which is its attribute `policy`.
    inner: Any = getattr(policy, "policy", policy)
    is_described = getattr(inner, "spec", None) is not None
    if not is_described and not isinstance(inner, ExternalPolicy):
        return None
    walks = run_walk_tests(inner, robot)
    inner.close()
    messages = failure_messages(walks)
    if not messages:
        return None
    first = next(iter(messages.values()))
    if has_policy_failure(walks):
        return first
    return f"{first}; {diagnose(inner, robot) if is_described else suggest_description(inner)}"


def suggest_description(policy: ExternalPolicy) -> str:
    """Return advice for the user of an external policy that has no description of its observation.

    The text lists the observation terms that this environment gave to the policy, and suggests a remedy.
    """
    table = table_with(policy.robot, policy.height_scan)
    names = ", ".join(f"{name} {part.stop - part.start}" for name, part in table.slices.items())
    given = f"it was given this environment's {table.size} numbers ({names})"
    file = policy.name.rpartition(".py:")[0]
    if file or policy.name.lower().endswith(".zip"):
        remedy = "turn them into its own in a class of a Python file (docs/your-policy.md)"
    else:
        remedy = f"describe them: python -m quad_env doctor --policy {policy.name} --write mine.toml begins such a file"
    return f"{given}; if it was trained on others, such as legged_gym's or Isaac Lab's of the same size, {remedy}"
