"""Checks of `python -m quad_env doctor` of a policy by its description: does it load, stand and walk as described."""

from collections.abc import Iterable, Iterator
from functools import lru_cache

import policies
from evaluate.rollouts import diagnosis
from evaluate.rollouts.walking_test import Walk
from policies import Foreign, PolicyError
from policies.base import CONTROL_PERIOD
from policies.foreign.described import with_gains
from policies.foreign.description import PolicyDescription, Term
from policies.foreign.mistakes import order_of
from quad_env.doctor.check import Finding, Subject, ok, problem
from quad_env.robots.robot import Robot

NO_DESCRIPTION = ok("it acts on this environment's observation by itself, without a description")
CORRECT = "in the description: --write mine.toml writes it, to correct and to name in its place"


def description(subject: Subject) -> Finding:
    """Whether a policy's description is whole, and fits the robot and the network; what it says."""
    try:
        policy = _loaded(subject)
    except PolicyError as error:
        cause = "the description lacks something, or is of another network or robot"
        return problem(error.fault, cause, error.remedy or f"correct that {CORRECT}")
    if (found := policy.description) is None:
        return NO_DESCRIPTION
    seen = f"{found.network.name} reads {found.width} numbers, as described"
    return Finding("ok", seen, details=tuple(understood(found, subject.robot)))


def standing(subject: Subject) -> Finding:
    """Whether the policy stands at command zero; what may be wrong in its description."""
    return _finding(subject, (diagnosis.STAND,))


def walking(subject: Subject) -> Finding:
    """Whether the policy follows moderate commands; what may be wrong in its description."""
    return _finding(subject, tuple(way for way in diagnosis.COMMANDS if way != diagnosis.STAND))


def understood(described: PolicyDescription, robot: Robot) -> Iterator[str]:
    """What a description says, in lines."""
    yield f"rate    {described.control_rate:g} Hz"
    yield f"joints  {order_of(described.joints, robot)}: {' '.join(described.joints)}"
    scale = _numbers(dict.fromkeys(described.action_scale))
    yield f"servos  {with_gains(robot, described).servo}; an action of 1 is {scale} rad"
    yield f"reads   {', '.join(map(_words, described.terms))}"


def _words(term: Term) -> str:
    """Such as `joint_velocity 12 × 0.05`, of 5 control steps where it has a history."""
    scale = "" if set(term.scale) == {1.0} else f" × {_numbers(term.scale)}"
    return f"{term.name} {term.width}{scale}{f' of {term.history} steps' if term.history > 1 else ''}"


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:g}" for value in values)


def _finding(subject: Subject, ways: tuple[str, ...]) -> Finding:
    """What became of the walks at those commands."""
    if _loaded(subject).description is None:
        return NO_DESCRIPTION
    found = [walk for walk in _walks(subject) if walk.way in ways]
    if not (seen := diagnosis.faults(found)):
        return ok("; ".join({walk.way: walk.words for walk in found}.values()))
    if diagnosis.failed(found):
        return problem("; ".join(seen.values()), "the network itself", "export it again")
    return problem("; ".join(seen.values()), diagnosis.cause(_loaded(subject), subject.name), f"correct that {CORRECT}")


@lru_cache(maxsize=1)
def _loaded(subject: Subject) -> Foreign:
    """The policy. Raises PolicyError."""
    assert subject.policy is not None
    reference = subject.policy.removeprefix(policies.SAFE)
    return Foreign(reference, robot=subject.robot, control_period=CONTROL_PERIOD, trust=subject.trust)


@lru_cache(maxsize=1)
def _walks(subject: Subject) -> list[Walk]:
    return diagnosis.tried(_loaded(subject), subject.name)
