"""Checks of `python -m quad_env doctor` that need policies: does the robot follow commands, does a policy work."""

import numpy as np

import policies
from evaluate.rollouts.hardware import Hardware
from evaluate.rollouts.walking_test import walks as walks_of
from policies import PolicyError
from policies.base import CONTROL_PERIOD, Policy
from quad_env.doctor.check import Finding, Subject, ok, problem

WALKER = "trot_feedback"
"""It walks on every robot that has a name here, without a search."""
COMMANDS = {"forward": (0.5, 0.0, 0.0), "to the left": (0.0, 0.4, 0.0), "turning left": (0.0, 0.0, 0.8)}
"""Of SimpleQuad: m/s and rad/s; scaled to the size of other robots."""
NAME_ANOTHER = "name an existing policy: python -m quad_env policies"
SHAPE = "one observation (48,) in, twelve targets (12,) out, rad: docs/your-policy.md"


def walks(subject: Subject) -> Finding:
    """Whether the robot walks with a policy that works on others."""
    robot = subject.robot
    good, bad = walk(policies.make(WALKER, robot=robot), subject)
    if not bad:
        return ok(f"{WALKER}: {'; '.join(good)}")
    return problem(
        f"{WALKER} {'; '.join(bad)}",
        f"it stands, so masses, inertias or limits are unlike those that {WALKER} was made for",
        f"correct masses and inertias in {robot.mjcf}, or search its trot: python -m train robot "
        f"{robot.source or robot.name}",
    )


def policy(subject: Subject) -> Finding:
    """Whether the named policy loads, is for this robot and control period, and follows commands."""
    assert subject.policy is not None
    try:
        chosen = policies.resolve(
            subject.policy, robot=subject.robot, control_period=CONTROL_PERIOD, trust=subject.trust
        )
    except PolicyError as error:
        if policies.is_reference(subject.policy):
            return _failing(str(error))
        seen, remedy = error.fault, error.remedy or NAME_ANOTHER
        if " was trained for " in seen:
            cause = "a policy is of one robot and one control period"
            return problem(seen, cause, f"{remedy}, or name its robot with --robot")
        return problem(seen, "it is not the file that was saved, or was made for something else", remedy)
    good, bad = walk(chosen, subject)
    failure = getattr(chosen, "failure", None)
    if failure is not None and (failures := [each for each in failure if each]):
        return _failing(f"{subject.policy} fails: {failures[0]}")
    if not bad:
        return ok(f"{subject.policy}: {'; '.join(good)}")
    cause = "it was trained for something else, or reads observations or gives targets in another order"
    remedy = "compare its joints' order and signs with python -m quad_env info, or train it longer: docs/training.md"
    return problem(f"{subject.policy}: {'; '.join(bad)}", cause, remedy)


def walk(policy: Policy, subject: Subject) -> tuple[list[str], list[str]]:
    """Words about each of COMMANDS that it follows, such as `forward 0.49 of 0.50 m/s`, and about each other one."""
    found = walks_of(policy, Hardware(robot=subject.name), COMMANDS, np.arange(1))
    good, bad = ([each.words for each in found if (each.deviation <= 1.0) is followed] for followed in (True, False))
    return good, bad


def _failing(seen: str) -> Finding:
    return problem(seen, "the policy's own code, or its input and output", f"correct it there: {SHAPE}")
