"""Checks of `python -m quad_env doctor` that need policies: does the robot follow commands, does a policy work."""

from dataclasses import dataclass

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
from quad_env.doctor.check import Finding, ok, problem
from quad_env.doctor.subject import Subject
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


@dataclass(frozen=True)
class Walk:
    """Result of a command."""

    way: str
    command: NDArray[np.float64]
    """Forward and lateral m/s, yaw rate rad/s, (3,)."""
    velocity: NDArray[np.float64]
    """The same, mean after it has settled."""
    tolerance: NDArray[np.float64]
    """Largest allowed difference of the two, (3,)."""
    fell: str
    """Reason, or nothing."""

    @property
    def good(self) -> bool:
        """Whether it followed the command."""
        return not self.fell and bool((np.abs(self.velocity - self.command) <= self.tolerance).all())

    @property
    def words(self) -> str:
        """`forward 0.49 of 0.50 m/s`, and the axis that is off if it is another one."""
        if self.fell:
            return f"commanded {self.way} it falls ({self.fell})"
        errors = np.abs(self.velocity - self.command) / self.tolerance
        axis, worst = int(np.abs(self.command).argmax()), int(errors.argmax())
        text = f"{self.way} {_rounded(self.velocity[axis])} of {self.command[axis]:.2f} {UNITS[axis]}"
        if self.good or worst == axis:
            return text
        return f"{text}, with {_rounded(self.velocity[worst])} {UNITS[worst]} {AXES[worst]}"


def walks(subject: Subject) -> Finding:
    """Whether the robot walks with a policy that works on others."""
    robot = subject.robot
    found = walk(policies.make(WALKER, robot=robot), subject)
    if all(each.good for each in found):
        return ok(f"{WALKER}: {'; '.join(each.words for each in found)}")
    bad = "; ".join(each.words for each in found if not each.good)
    return problem(
        f"{WALKER} {bad}",
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
    found = walk(chosen, subject)
    failure = getattr(chosen, "failure", None)
    if failure is not None and (failures := [each for each in failure if each]):
        return _failing(f"{subject.policy} fails: {failures[0]}")
    if all(each.good for each in found):
        return ok(f"{subject.policy}: {'; '.join(each.words for each in found)}")
    bad = "; ".join(each.words for each in found if not each.good)
    cause = "it was trained for something else, or reads observations or gives targets in another order"
    remedy = "compare its joints' order and signs with python -m quad_env info, or train it longer: docs/training.md"
    return problem(f"{subject.policy}: {bad}", cause, remedy)


def walk(policy: Policy, subject: Subject) -> list[Walk]:
    """A walk for each of COMMANDS."""
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
    fell = [FALL_REASONS[code].replace("_", " ") if code else "" for code in fall]
    each = zip(COMMANDS, commands, np.mean(velocities, axis=0), tolerances, fell, strict=True)
    return [Walk(*values) for values in each]


def _scale(robot: Robot) -> NDArray[np.float64]:
    """Speeds of this robot that correspond to 1 m/s and 1 rad/s of SimpleQuad, (3,)."""
    return np.array([ratio(robot, unit) for unit in UNITS])


def _rounded(value: float) -> str:
    return f"{round(float(value), 2) + 0.0:.2f}"  # no −0


def _failing(seen: str) -> Finding:
    return problem(seen, "the policy's own code, or its input and output", f"correct it there: {SHAPE}")
