"""Whether trained policies are whole, for this robot, and do what they are asked to."""

from pathlib import Path

import policies
from live.doctor.walking import walk
from policies import PolicyError, bundle, shipped
from quad_env.doctor.check import Finding, ok, problem
from quad_env.doctor.subject import Subject
from quad_env.robots.simple_quad import SIMPLE_QUAD

REMEDIES = ("train it anew", "take another", "make one", "name the folder")
"""What a remedy at the end of a PolicyError begins with."""
SHAPE = "one observation (48,) in, twelve targets (12,) out, rad: docs/extending.md"


def models(subject: Subject) -> Finding:
    """Whether what lies in `models/` for the robot can be used: weights' SHA-256, robot, joints, control period."""
    robot, folder = subject.robot, shipped.folder_of(subject.robot)
    found = sorted(file.parent for file in folder.glob(f"*/{bundle.DESCRIPTION}"))
    faults = [fault for each in found if (fault := _fault(each, subject))]
    if robot == SIMPLE_QUAD and not found:
        return problem(f"no trained policy in {folder}", "the clone is not complete", "git checkout -- models")
    if not faults:
        names = ", ".join(each.name for each in found)
        return ok(f"{names}: whole, and for this robot" if names else f"none of {robot.name} in {folder}")
    cause, remedy = _split(faults[0])
    more = f" ({len(faults)} of {len(found)} such)" if len(faults) > 1 else ""
    at_home = folder.is_relative_to(shipped.MODELS)
    return problem(
        f"{cause}{more}",
        "files were changed, or come from elsewhere",
        f"git checkout -- {folder}" if at_home else remedy,
    )


def _fault(folder: Path, subject: Subject) -> str:
    try:
        policies.resolve(folder, robot=subject.robot, control_period=subject.env.dt)
    except PolicyError as error:
        return str(error)
    return ""


def policy(subject: Subject) -> Finding:
    """Whether the policy that is asked about loads, is for this robot and this control period, and goes as asked."""
    assert subject.policy is not None
    robot = subject.robot
    try:
        chosen = policies.resolve(subject.policy, robot=robot, control_period=subject.env.dt)
    except PolicyError as error:
        if policies.is_reference(subject.policy):
            return problem(str(error), "the policy's own code, or what it takes and gives", f"mend it there: {SHAPE}")
        seen, remedy = _split(str(error))
        if " was trained for " in seen:
            cause = "a policy is of one robot and one control period"
            return problem(seen, cause, f"{remedy}, or name its robot with --robot")
        return problem(seen, "it is not the file that was saved, or was made for something else", remedy)
    found = walk(chosen, robot)
    failure = getattr(chosen, "failure", None)
    if failure is not None and (failures := [each for each in failure if each]):
        return problem(f"{subject.policy} fails: {failures[0]}", "the policy's own code", f"mend it there: {SHAPE}")
    if all(each.good for each in found):
        return ok(f"{subject.policy}: {'; '.join(each.words for each in found)}")
    bad = "; ".join(each.words for each in found if not each.good)
    cause = "it was trained for something else, or reads observations or gives targets in another order"
    remedy = "compare its joints' order and signs with python -m quad_env info, or train it longer: docs/training.md"
    return problem(f"{subject.policy}: {bad}", cause, remedy)


def _split(error: str) -> tuple[str, str]:
    """What is wrong, and what to do, of a PolicyError."""
    for mark in ("; ", ": "):
        what, _, remedy = error.rpartition(mark)
        if remedy.startswith(REMEDIES):
            return what, remedy
    return error, "name a policy that there is: python -m quad_env policies"
