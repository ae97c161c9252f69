"""Checks of `python -m quad_env doctor` in which a policy controls the robot.

The checks test if the robot follows velocity commands with a reference policy, and if the user's policy loads and
walks. For a policy from another project, the checks also test its description: the file that defines the observations
and actions of the policy.
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
"""Name of the policy with which the walking of a robot is checked.

This policy walks on all robots of `quad_env.ROBOTS` without parameters that were tuned for each robot.
"""
COMMANDS = {"forward": (0.5, 0.0, 0.0), "to the left": (0.0, 0.4, 0.0), "turning left": (0.0, 0.0, 0.8)}
"""Velocity commands at which `python -m quad_env doctor` tests the walking of a policy.

The dictionary is: name of the command -> forward and left velocity, m/s, and yaw rate, rad/s. The commands are for the
robot SimpleQuad; they are scaled to the size of other robots.
"""
MIN_REPORTED_DAMPING_RATIO = 0.05
"""Smallest ratio of passive joint damping to servo damping for which `describe_spec` reports the joint damping."""
NAME_REMEDY = "name an existing policy: python -m quad_env policies"
INTERFACE = "one observation (48,) in, twelve targets (12,) out, rad: docs/your-policy.md"


def check_reference_policy(subject: DoctorSubject) -> Finding:
    """Check that the robot follows velocity commands with the policy REFERENCE_POLICY.

    Args:
        subject: Robot that is checked.

    Returns:
        Result of the check: ok, or a problem of the robot's model with likely cause and remedy.
    """
    robot = subject.robot
    tracked, not_tracked = walk(policies.make(REFERENCE_POLICY, robot=robot, servo="own"), subject)
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
    """Check that the user's policy loads, fits robot and control period, and follows velocity commands.

    Args:
        subject: Robot and policy that are checked.

    Returns:
        Result of the check: ok, or a problem of the policy with likely cause and remedy.
    """
    assert subject.policy is not None
    try:
        policy = policies.resolve(
            subject.policy, robot=subject.robot, control_period=CONTROL_PERIOD, servo="own", trust=subject.trust
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
    """Return the result of the check of a policy that cannot be loaded, with likely cause and remedy.

    Args:
        reference: Name or path of the policy.
        error: Error that loading the policy has raised.

    Returns:
        Result of the check, of the kind `problem`.
    """
    if policies.is_reference(reference):
        return _policy_code_problem(str(error))
    remedy = error.remedy or NAME_REMEDY
    if " made for " in error.fault:
        cause = "a policy is of one robot and one control period"
        return problem(error.fault, cause, f"{remedy}, or name its robot with --robot")
    return problem(error.fault, "it is not the file that was saved, or was made for something else", remedy)


def walk(policy: Policy, subject: DoctorSubject) -> tuple[list[str], list[str]]:
    """Simulate the robot with a policy at each velocity command of `COMMANDS`.

    Args:
        policy: Policy to test.
        subject: Subject of the checks, with the robot.

    Returns:
        tracked: Text about the walk at each command that the policy follows, for example `forward 0.49 of 0.50 m/s`.
        not_tracked: Text about the walk at each command that the policy does not follow.
    """
    results = run_walks(policy, HardwareConfig(robot=subject.name), COMMANDS, np.arange(1))
    tracked = [result.description for result in results if result.deviation <= 1.0]
    not_tracked = [result.description for result in results if not result.deviation <= 1.0]
    return tracked, not_tracked


def _policy_code_problem(observed: str) -> Finding:
    """Return the result of a check, a problem, for a policy that fails because of an error in its own code.

    `observed` is the text about the failure.
    """
    return problem(observed, "the policy's own code, or its input and output", f"correct it there: {INTERFACE}")


NO_DESCRIPTION = ok("it acts on this environment's observation by itself, without a description")
DESCRIPTION_REMEDY = "in the description: --write mine.toml writes it, to correct and to name in its place"


def check_description(subject: DoctorSubject) -> Finding:
    """Check that the user's policy has a complete description that fits the robot.

    The description is a file that defines the observations and actions of a policy from another project.

    Args:
        subject: Robot and policy that are checked.

    Returns:
        Result of the check: ok, a warning or a problem.
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
    """Check that a policy without a description walks with the observation of this environment."""
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
    """Check that the user's policy stands if the commanded velocity is zero.

    Args:
        subject: Robot and policy that are checked.

    Returns:
        Result of the check: ok, or a problem with the likely error in the policy's description.
    """
    return _check_walks(subject, (diagnosis.STAND,))


def check_walking(subject: DoctorSubject) -> Finding:
    """Check that the user's policy follows moderate velocity commands.

    Args:
        subject: Robot and policy that are checked.

    Returns:
        Result of the check: ok, or a problem with the likely error in the policy's description.
    """
    return _check_walks(subject, tuple(name for name in diagnosis.COMMANDS if name != diagnosis.STAND))


def describe_spec(spec: PolicySpec, robot: Robot) -> Iterator[str]:
    """Describe the specification of a policy from another project in lines of text.

    Args:
        spec: Specification of the policy: its observations, actions, servo gains and control rate.
        robot: Robot that the policy controls.

    Yields:
        Lines about control rate, joint order, servo gains and observation terms. Then a line for each fact that the
        deployment file does not define, with the assumption that is used instead.
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
    """Format an observation term as text: its name, number of values, scale and history.

    An example is `joint_velocity 12 × 0.05`, which has twelve values with the scale 0.05.
    """
    scale = "" if set(term.scale) == {1.0} else f" × {_format_numbers(term.scale)}"
    history = f" of {term.history} steps" if term.history > 1 else ""
    return f"{term.name} {term.width}{scale}{history}"


def _format_numbers(values: Iterable[float]) -> str:
    """Format numbers as one text, in which spaces separate the numbers."""
    return " ".join(f"{value:g}" for value in values)


def _check_walks(subject: DoctorSubject, command_names: tuple[str, ...]) -> Finding:
    """Check that the user's policy passes the walking test at the given velocity commands.

    Args:
        subject: Robot and policy that are checked.
        command_names: Names of commands in `diagnosis.COMMANDS`.

    Returns:
        Result of the check: ok, or a problem with the likely error in the policy's description.
    """
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
    """Load the user's policy; raise PolicyError if it cannot be loaded."""
    assert subject.policy is not None
    reference = subject.policy.removeprefix(policies.SAFE)
    return ExternalPolicy(reference, robot=subject.robot, control_period=CONTROL_PERIOD, trust=subject.trust)


@lru_cache(maxsize=1)
def _run_walks(subject: DoctorSubject) -> list[Walk]:
    """Run the walking test with the user's policy at each velocity command of `diagnosis.COMMANDS`."""
    return diagnosis.run_walk_tests(_load_policy(subject), subject.name)
