"""Checks of `python -m quad_env doctor` that need policies.

The checks test three things: the robot follows commands with a reference policy; a given policy works; a policy with a
description loads, stands and walks.
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
from policies.external.spec import PolicySpec, SpecTerm
from policies.external.spec_errors import joint_order_in_words
from quad_env.doctor.causes import self_contacts
from quad_env.doctor.check import DoctorSubject, Finding, ok, problem
from quad_env.robots.leg_names import find_contradictions
from quad_env.robots.plausibility import find_warnings
from quad_env.robots.robot import Robot

REFERENCE_POLICY = "trot_feedback"
"""Policy that tests a robot; walks on all robots of `quad_env.ROBOTS` without parameters tuned for each."""
COMMANDS = {"forward": (0.5, 0.0, 0.0), "to the left": (0.0, 0.4, 0.0), "turning left": (0.0, 0.0, 0.8)}
"""Name -> command: forward and left velocity, m/s, and yaw rate, rad/s.

The commands are for SimpleQuad and are scaled to other robots.
"""
MIN_REPORTED_DAMPING_RATIO = 0.05
"""Ratio of passive joint damping to servo damping above which the joint damping is reported."""
NAME_REMEDY = "name an existing policy: python -m quad_env policies"
INTERFACE = "one observation (48,) in, twelve targets (12,) out, rad: docs/your-policy.md"


def check_reference_policy(subject: DoctorSubject) -> Finding:
    """Check that the robot of `subject` walks with the reference policy, which works on other robots."""
    robot = subject.robot
    tracked, not_tracked = walk(policies.make(REFERENCE_POLICY, robot=robot), subject)
    if not not_tracked:
        return ok(f"{REFERENCE_POLICY}: {'; '.join(tracked)}")
    cause = f"it stands, so its masses, inertias or limits differ from those that {REFERENCE_POLICY} was made for"
    if warnings := [*find_contradictions(robot), *find_warnings(robot), *self_contacts(subject)]:
        cause = f"it stands, but {'; '.join(warnings)}"
    return problem(
        f"{REFERENCE_POLICY} {'; '.join(not_tracked)}",
        cause,
        f"correct masses and inertias in {robot.mjcf}, or search its trot: python -m train robot "
        f"{robot.source or robot.name}",
    )


def check_policy(subject: DoctorSubject) -> Finding:
    """Check that the policy of `subject` loads, fits robot and control period, and follows commands."""
    assert subject.policy is not None
    try:
        policy = policies.resolve(
            subject.policy, robot=subject.robot, control_period=CONTROL_PERIOD, trust=subject.trust
        )
    except PolicyError as error:
        return _load_problem(subject.policy, error)
    tracked, not_tracked = walk(policy, subject)
    failure = getattr(policy, "failure", None)
    if failure is not None and (failures := [text for text in failure if text]):
        return _policy_code_problem(f"{subject.policy} fails: {failures[0]}")
    if not not_tracked:
        return ok(f"{subject.policy}: {'; '.join(tracked)}")
    cause = "it was trained for something else, or reads observations or gives targets in another order"
    remedy = "compare its joints' order and signs with python -m quad_env info, or train it longer: docs/training.md"
    return problem(f"{subject.policy}: {'; '.join(not_tracked)}", cause, remedy)


def _load_problem(reference: str, error: PolicyError) -> Finding:
    """Return the finding for a policy that does not load, with cause and remedy."""
    if policies.is_reference(reference):
        return _policy_code_problem(str(error))
    remedy = error.remedy or NAME_REMEDY
    if " made for " in error.fault:
        cause = "a policy is of one robot and one control period"
        return problem(error.fault, cause, f"{remedy}, or name its robot with --robot")
    return problem(error.fault, "it is not the file that was saved, or was made for something else", remedy)


def walk(policy: Policy, subject: DoctorSubject) -> tuple[list[str], list[str]]:
    """Let a policy walk at each command of `COMMANDS`.

    Args:
        policy: Policy to test.
        subject: Subject of the checks, with the robot.

    Returns:
        tracked: Text about each command that the policy follows, for example `forward 0.49 of 0.50 m/s`.
        not_tracked: Text about each command that the policy does not follow.
    """
    results = run_walks(policy, HardwareConfig(robot=subject.name), COMMANDS, np.arange(1))
    tracked = [result.description for result in results if result.deviation <= 1.0]
    not_tracked = [result.description for result in results if not result.deviation <= 1.0]
    return tracked, not_tracked


def _policy_code_problem(observed: str) -> Finding:
    """Return the finding for a policy with an error in the policy's own code."""
    return problem(observed, "the policy's own code, or its input and output", f"correct it there: {INTERFACE}")


NO_DESCRIPTION = ok("it acts on this environment's observation by itself, without a description")
DESCRIPTION_REMEDY = "in the description: --write mine.toml writes it, to correct and to name in its place"


def check_description(subject: DoctorSubject) -> Finding:
    """Check that the policy of `subject` has a complete description that fits the robot.

    The description defines the observations and actions of a policy from another project.
    """
    try:
        policy = _load_policy(subject)
    except PolicyError as error:
        cause = "the description lacks something, or is of another network or robot"
        return problem(error.fault, cause, error.remedy or f"correct that {DESCRIPTION_REMEDY}")
    spec = policy.spec
    if spec is None:
        return _check_without_description(subject)
    observed = f"{spec.network.name} reads {spec.width} numbers, as described"
    return Finding("ok", observed, details=tuple(describe_spec(spec, subject.robot)))


def _check_without_description(subject: DoctorSubject) -> Finding:
    """Check that a policy that has no description walks with the observation of this environment."""
    walks = _run_walks(subject)
    failures = diagnosis.failure_messages(walks)
    if not failures:
        return NO_DESCRIPTION
    observed = "; ".join(failures.values())
    if diagnosis.has_policy_failure(walks):
        return problem(observed, "the network itself", "export it again")
    question, _, remedy = diagnosis.suggest_description(_load_policy(subject)).rpartition(", ")
    return problem(f"its file does not say what it reads, and {observed}", question, remedy)


def check_standing(subject: DoctorSubject) -> Finding:
    """Check that the policy of `subject` stands at zero command; diagnose the description otherwise."""
    return _check_walks(subject, (diagnosis.STAND,))


def check_walking(subject: DoctorSubject) -> Finding:
    """Check that the policy of `subject` follows moderate commands; diagnose the description otherwise."""
    return _check_walks(subject, tuple(name for name in diagnosis.COMMANDS if name != diagnosis.STAND))


def describe_spec(spec: PolicySpec, robot: Robot) -> Iterator[str]:
    """Describe a policy specification in text.

    Args:
        spec: Specification of the policy.
        robot: Robot that the policy controls.

    Yields:
        Lines about control rate, joints, servos, observation and open questions.
    """
    yield f"rate    {spec.control_rate:g} Hz"
    yield f"joints  {joint_order_in_words(spec.joints, robot)}: {' '.join(spec.joints)}"
    scale = _format_numbers(dict.fromkeys(spec.action_scale))
    spec_robot = with_spec_gains(robot, spec)
    is_damping_large = bool((robot.joint_damping > MIN_REPORTED_DAMPING_RATIO * spec_robot.servo_damping).any())
    joint_damping = f"; {robot.joint_damping_line}" if is_damping_large else ""
    yield f"servos  {spec_robot.servo}; an action of 1 is {scale} rad{joint_damping}"
    yield f"reads   {', '.join(map(_format_term, spec.terms))}"
    yield from (f"open    {remark}" for remark in spec.remarks)


def _format_term(term: SpecTerm) -> str:
    """Format an observation term: name, width, scale and history, as in `joint_velocity 12 × 0.05`."""
    scale = "" if set(term.scale) == {1.0} else f" × {_format_numbers(term.scale)}"
    history = f" of {term.history} steps" if term.history > 1 else ""
    return f"{term.name} {term.width}{scale}{history}"


def _format_numbers(values: Iterable[float]) -> str:
    """Format numbers as text, separated by spaces."""
    return " ".join(f"{value:g}" for value in values)


def _check_walks(subject: DoctorSubject, command_names: tuple[str, ...]) -> Finding:
    """Check that the policy passes the walking test at each command in `command_names`."""
    policy = _load_policy(subject)
    if policy.spec is None:
        return NO_DESCRIPTION
    walks = [walk for walk in _run_walks(subject) if walk.command_name in command_names]
    failures = diagnosis.failure_messages(walks)
    if not failures:
        return ok("; ".join({walk.command_name: walk.description for walk in walks}.values()))
    observed = "; ".join(failures.values())
    if diagnosis.has_policy_failure(walks):
        return problem(observed, "the network itself", "export it again")
    return problem(observed, diagnosis.diagnose(policy, subject.name), f"correct that {DESCRIPTION_REMEDY}")


@lru_cache(maxsize=1)
def _load_policy(subject: DoctorSubject) -> ExternalPolicy:
    """Load the policy of `subject`; raise PolicyError if it cannot be loaded."""
    assert subject.policy is not None
    reference = subject.policy.removeprefix(policies.SAFE)
    return ExternalPolicy(reference, robot=subject.robot, control_period=CONTROL_PERIOD, trust=subject.trust)


@lru_cache(maxsize=1)
def _run_walks(subject: DoctorSubject) -> list[Walk]:
    """Run the walking test at each command of `diagnosis.COMMANDS` with the policy of `subject`."""
    return diagnosis.run_walk_tests(_load_policy(subject), subject.name)
