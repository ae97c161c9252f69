"""Checks of `python -m quad_env doctor` that need policies: does the robot follow commands, does a policy work, does
one with a description load, stand and walk as described.
"""

from collections.abc import Iterable, Iterator
from functools import lru_cache

import numpy as np

import policies
from evaluate.hardware import HardwareConfig
from evaluate.rollouts import diagnosis
from evaluate.rollouts.walking_test import Walk, run_walks
from policies import ExternalPolicy, PolicyError
from policies.base import CONTROL_PERIOD, Policy
from policies.external.network_policy import with_spec_gains
from policies.external.spec import ObservationTerm, PolicySpec
from policies.external.spec_errors import joint_order_in_words
from quad_env.doctor.causes import self_contacts
from quad_env.doctor.check import DoctorSubject, Finding, ok, problem
from quad_env.robots.leg_names import find_contradictions
from quad_env.robots.plausibility import find_warnings
from quad_env.robots.robot import Robot

REFERENCE_POLICY = "trot_feedback"
"""It walks on every robot that has a name here, without a search."""
COMMANDS = {"forward": (0.5, 0.0, 0.0), "to the left": (0.0, 0.4, 0.0), "turning left": (0.0, 0.0, 0.8)}
"""Of SimpleQuad: m/s and rad/s; scaled to the size of other robots."""
MIN_REPORTED_DAMPING_RATIO = 0.05
"""Least ratio of the joints' own damping to the servos' that is reported."""
NAME_REMEDY = "name an existing policy: python -m quad_env policies"
INTERFACE = "one observation (48,) in, twelve targets (12,) out, rad: docs/your-policy.md"


def walks(subject: DoctorSubject) -> Finding:
    """Whether the robot walks with a policy that works on others."""
    robot = subject.robot
    tracked, not_tracked = walk(policies.make(REFERENCE_POLICY, robot=robot), subject)
    if not not_tracked:
        return ok(f"{REFERENCE_POLICY}: {'; '.join(tracked)}")
    cause = f"it stands, so its masses, inertias or limits differ from those that {REFERENCE_POLICY} was made for"
    if noticed := [*find_contradictions(robot), *find_warnings(robot), *self_contacts(subject)]:
        cause = f"it stands, but {'; '.join(noticed)}"
    return problem(
        f"{REFERENCE_POLICY} {'; '.join(not_tracked)}",
        cause,
        f"correct masses and inertias in {robot.mjcf}, or search its trot: python -m train robot "
        f"{robot.source or robot.name}",
    )


def policy(subject: DoctorSubject) -> Finding:
    """Whether the named policy loads, is for this robot and control period, and follows commands."""
    assert subject.policy is not None
    try:
        chosen = policies.resolve(
            subject.policy, robot=subject.robot, control_period=CONTROL_PERIOD, trust=subject.trust
        )
    except PolicyError as error:
        if policies.is_reference(subject.policy):
            return _failing(str(error))
        seen, remedy = error.fault, error.remedy or NAME_REMEDY
        if " made for " in seen:
            cause = "a policy is of one robot and one control period"
            return problem(seen, cause, f"{remedy}, or name its robot with --robot")
        return problem(seen, "it is not the file that was saved, or was made for something else", remedy)
    tracked, not_tracked = walk(chosen, subject)
    failure = getattr(chosen, "failure", None)
    if failure is not None and (failures := [each for each in failure if each]):
        return _failing(f"{subject.policy} fails: {failures[0]}")
    if not not_tracked:
        return ok(f"{subject.policy}: {'; '.join(tracked)}")
    cause = "it was trained for something else, or reads observations or gives targets in another order"
    remedy = "compare its joints' order and signs with python -m quad_env info, or train it longer: docs/training.md"
    return problem(f"{subject.policy}: {'; '.join(not_tracked)}", cause, remedy)


def walk(policy: Policy, subject: DoctorSubject) -> tuple[list[str], list[str]]:
    """Words about each of COMMANDS that it follows, such as `forward 0.49 of 0.50 m/s`, and about each other one."""
    found = run_walks(policy, HardwareConfig(robot=subject.name), COMMANDS, np.arange(1))
    tracked, not_tracked = (
        [each.description for each in found if (each.deviation <= 1.0) is followed] for followed in (True, False)
    )
    return tracked, not_tracked


def _failing(seen: str) -> Finding:
    return problem(seen, "the policy's own code, or its input and output", f"correct it there: {INTERFACE}")


NO_DESCRIPTION = ok("it acts on this environment's observation by itself, without a description")
DESCRIPTION_REMEDY = "in the description: --write mine.toml writes it, to correct and to name in its place"


def description(subject: DoctorSubject) -> Finding:
    """Whether a policy's description is whole, and fits the robot and the network; what it says."""
    try:
        policy = _loaded(subject)
    except PolicyError as error:
        cause = "the description lacks something, or is of another network or robot"
        return problem(error.fault, cause, error.remedy or f"correct that {DESCRIPTION_REMEDY}")
    if (found := policy.spec) is None:
        return _without_description(subject)
    seen = f"{found.network.name} reads {found.width} numbers, as described"
    return Finding("ok", seen, details=tuple(describe_spec(found, subject.robot)))


def _without_description(subject: DoctorSubject) -> Finding:
    """Return whether a policy without a description of its observation walks on this environment's."""
    found = _walks(subject)
    if not (seen := diagnosis.failure_messages(found)):
        return NO_DESCRIPTION
    words = "; ".join(seen.values())
    if diagnosis.has_policy_failure(found):
        return problem(words, "the network itself", "export it again")
    asked, _, remedy = diagnosis.suggest_description(_loaded(subject)).rpartition(", ")
    return problem(f"its file does not say what it reads, and {words}", asked, remedy)


def standing(subject: DoctorSubject) -> Finding:
    """Whether the policy stands at command zero; what may be wrong in its description."""
    return _finding(subject, (diagnosis.STAND,))


def walking(subject: DoctorSubject) -> Finding:
    """Whether the policy follows moderate commands; what may be wrong in its description."""
    return _finding(subject, tuple(way for way in diagnosis.COMMANDS if way != diagnosis.STAND))


def describe_spec(described: PolicySpec, robot: Robot) -> Iterator[str]:
    """What a description says, in lines."""
    yield f"rate    {described.control_rate:g} Hz"
    yield f"joints  {joint_order_in_words(described.joints, robot)}: {' '.join(described.joints)}"
    scale = _numbers(dict.fromkeys(described.action_scale))
    commanded = with_spec_gains(robot, described)
    matters = bool((robot.joint_damping > MIN_REPORTED_DAMPING_RATIO * commanded.servo_damping).any())
    own = f"; {robot.joint_damping_line}" if matters else ""
    yield f"servos  {commanded.servo}; an action of 1 is {scale} rad{own}"
    yield f"reads   {', '.join(map(_words, described.terms))}"
    yield from (f"open    {remark}" for remark in described.remarks)


def _words(term: ObservationTerm) -> str:
    """Such as `joint_velocity 12 × 0.05`, of 5 control steps where it has a history."""
    scale = "" if set(term.scale) == {1.0} else f" × {_numbers(term.scale)}"
    return f"{term.name} {term.width}{scale}{f' of {term.history} steps' if term.history > 1 else ''}"


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:g}" for value in values)


def _finding(subject: DoctorSubject, ways: tuple[str, ...]) -> Finding:
    """What became of the walks at those commands."""
    if _loaded(subject).spec is None:
        return NO_DESCRIPTION
    found = [walk for walk in _walks(subject) if walk.command_name in ways]
    if not (seen := diagnosis.failure_messages(found)):
        return ok("; ".join({walk.command_name: walk.description for walk in found}.values()))
    if diagnosis.has_policy_failure(found):
        return problem("; ".join(seen.values()), "the network itself", "export it again")
    return problem(
        "; ".join(seen.values()),
        diagnosis.diagnose(_loaded(subject), subject.name),
        f"correct that {DESCRIPTION_REMEDY}",
    )


@lru_cache(maxsize=1)
def _loaded(subject: DoctorSubject) -> ExternalPolicy:
    """The policy. Raises PolicyError."""
    assert subject.policy is not None
    reference = subject.policy.removeprefix(policies.SAFE)
    return ExternalPolicy(reference, robot=subject.robot, control_period=CONTROL_PERIOD, trust=subject.trust)


@lru_cache(maxsize=1)
def _walks(subject: DoctorSubject) -> list[Walk]:
    return diagnosis.run_walk_tests(_loaded(subject), subject.name)
