"""Checks of `python -m quad_env doctor` that need policies: does the robot follow commands, does a policy work."""

import numpy as np
from numpy.typing import NDArray

import policies
from evaluate.measures.outcomes import RULES, SUCCESS_RULE
from evaluate.rollouts.hardware import Hardware
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out
from policies import PolicyError
from policies.base import CONTROL_PERIOD, Policy
from quad_env.config import FALL_REASONS
from quad_env.doctor.check import Finding, Subject, ok, problem
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import ratio

WALKER = "trot_feedback"
"""It walks on every robot that has a name here, without a search."""
COMMANDS = {"forward": (0.5, 0.0, 0.0), "to the left": (0.0, 0.4, 0.0), "turning left": (0.0, 0.0, 0.8)}
"""Of SimpleQuad: m/s and rad/s; scaled to the size of other robots."""
UNITS, AXES = ("m/s", "m/s", "rad/s"), ("forward", "to the left", "of yaw rate")
SECONDS, SETTLING = 4.0, 2.0
"""Duration of a walk, and of its part that does not count."""
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
        chosen = policies.resolve(subject.policy, robot=subject.robot, control_period=CONTROL_PERIOD)
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
    robot = subject.robot
    commands, fall = _scale(robot) * np.array(list(COMMANDS.values())), np.zeros(len(COMMANDS), int)
    velocities: list[NDArray[np.float64]] = []

    def observe(step: Step) -> None:
        fall[:] = np.where(fall > 0, fall, step.infos["fall"])
        if step.number * step.env.dt > SETTLING:
            velocities.append(step.infos["heading_velocity"])

    roll_out(
        policy,
        "flat",
        np.arange(len(commands)),
        observe,
        steps=round(SECONDS / CONTROL_PERIOD),
        command=commands,
        terminate_on_fall=False,
        hardware=Hardware(robot=subject.name),
    )
    planar = np.linalg.norm(commands[:, :2], axis=1, keepdims=True)
    rule = RULES[SUCCESS_RULE]
    tolerances = rule.linear * _scale(robot) + rule.share * np.hstack((planar, planar, np.abs(commands[:, 2:])))
    means = np.mean(velocities, axis=0)
    errors = np.abs(means - commands) / tolerances
    good, bad = [], []
    for way, command, mean, error, code in zip(COMMANDS, commands, means, errors, fall, strict=True):
        axis, worst = int(np.abs(command).argmax()), int(error.argmax())
        words = f"{way} {_rounded(mean[axis])} of {command[axis]:.2f} {UNITS[axis]}"
        if code:
            bad.append(f"commanded {way} it falls ({FALL_REASONS[code].replace('_', ' ')})")
        elif error[worst] <= 1.0:
            good.append(words)
        elif worst == axis:
            bad.append(words)
        else:
            bad.append(f"{words}, with {_rounded(mean[worst])} {UNITS[worst]} {AXES[worst]}")
    return good, bad


def _scale(robot: Robot) -> NDArray[np.float64]:
    """Speeds of this robot that correspond to 1 m/s and 1 rad/s of SimpleQuad, (3,)."""
    return np.array([ratio(robot, unit) for unit in UNITS])


def _rounded(value: float) -> str:
    return f"{round(float(value), 2) + 0.0:.2f}"  # no −0


def _failing(seen: str) -> Finding:
    return problem(seen, "the policy's own code, or its input and output", f"correct it there: {SHAPE}")
