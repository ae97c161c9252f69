"""Diagnosis of a robot that does not stand in simulation: finds the likely cause and a remedy.

The remedy of each suspected cause is tested in simulation. The function `diagnose` proposes the first remedy with which
the robot stands. The tested causes are servo gains, implausible inertias, joint springs, and contacts between the
robot's own bodies. Servo gains that the robot already has are never proposed.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from quad_env.doctor.check import DoctorSubject
from quad_env.doctor.stance import LIMITS, Stance, make_standing_env, measure_stance
from quad_env.robots.model_remarks import body_names
from quad_env.robots.part_names import ATTACH_PREFIX, RENAMED_PREFIX
from quad_env.robots.plausibility import MAX_LEG_LENGTH
from quad_env.robots.robot import Robot
from quad_env.robots.shapes import GROUND_BIT
from quad_env.robots.similarity import scaled_servo_gains
from quad_env.robots.unlikely_inertias import find_unlikely_inertias

GAIN_TOLERANCE = 0.1
"""Largest relative difference at which two servo gains are considered equal, dimensionless."""
_SHOWN = 3
"""Largest number of names that a message lists; further names are only counted."""

ModelChange = Callable[[Any], None]
"""Type of a function that takes a simulation of one robot and changes the simulated model in place."""


@dataclass(frozen=True)
class Suspect:
    """Suspected cause of a robot that fails to stand, with a remedy that can be tested; made by `_suspects`."""

    cause: str
    """Text for the user about the reason for which the robot may fail to stand."""
    remedy: str
    """Text about the proposed change of the model or of a parameter, for the user."""
    apply_remedy: ModelChange | None = None
    """Function that changes the model of a simulation as the remedy proposes.

    The field is None if the remedy changes parameters of the robot instead of the model.
    """
    robot: Robot | None = None
    """Robot with the parameters that the remedy proposes; None if the remedy changes only the model."""

    def helps(self, robot: Robot) -> bool:
        """Return True if `robot` stands in simulation after the remedy has been applied to it.

        The robot stands if it exceeds no limit of the stance test, see `measure_stance`.
        """
        env = make_standing_env(self.robot or robot)
        if self.apply_remedy is not None:
            self.apply_remedy(env.simulation)
            env.simulation.batch.set_const(np.array([0]))
        return measure_stance(env).fault is None


def diagnose(subject: DoctorSubject, stance: Stance) -> tuple[str, str]:
    """Find the likely cause why a robot does not stand in simulation, and a remedy.

    Args:
        subject: The examined robot, with its name as the user has given it.
        stance: Result of the robot's stance test, which has failed.

    Returns:
        cause: Text about the likely cause.
        remedy: Text about the proposed change of the model or of a parameter.
    """
    robot = stance.robot
    suspects = list(_suspects(subject, stance))
    for suspect in suspects:
        if suspect.helps(robot):
            return suspect.cause, suspect.remedy
    if stance.is_overloaded and robot.leg_length > MAX_LEG_LENGTH:
        cause = f"its legs are {robot.leg_length:.3g} m long, as of a model in millimetres"
        return cause, f"lengths in metres in {robot.mjcf}, such as scale of the meshes and pos of the bodies"
    if stance.is_overloaded:
        cause = "masses are too large (grams for kilograms?), or the largest torque is too small"
        return cause, f"mass of the bodies in {robot.mjcf}, or rated_torque in {subject.parameter_source}"
    if not stance.diverged and _holds_targets(stance):
        cause = "in the home pose the feet are not below the centre of mass, or a mass is not where it should be"
        return cause, f"home_pose in {subject.parameter_source}, or masses in {robot.mjcf}; describe --picture shows it"
    also = "".join(f"; {suspect.cause}" for suspect in suspects)
    cause = f"none of servo gains, springs, self-contacts and inertias alone explains it{also}"
    return cause, f"masses, inertias, joints and home_pose in {robot.mjcf}; describe --picture shows it"


def _holds_targets(stance: Stance) -> bool:
    """Return True if the joints hold their targets in the stance test, but the trunk is tilted or too low.

    In this case, the servo gains are good, and the home pose or the masses are wrong.
    """
    return stance.fault is not None and stance.fault.startswith("it does not stand")


def _suspects(subject: DoctorSubject, stance: Stance) -> Iterator[Suspect]:
    """Yield the suspected causes of a failed stance test, the most likely cause first.

    Args:
        subject: The examined robot, with its name as the user has given it.
        stance: Result of the robot's stance test.

    Yields:
        A suspected cause with its remedy.
    """
    robot = stance.robot
    yield from _gain_suspects(subject, stance)
    yield from _inertia_suspects(robot)
    yield from _joint_suspects(robot)
    yield from _contact_suspects(robot, stance)


def _inertia_suspects(robot: Robot) -> Iterator[Suspect]:
    """Yield the suspected cause "implausible inertias" if links have them; the remedy is to reduce these inertias."""
    inertias = find_unlikely_inertias(robot)
    if inertias:
        names = _shorten_names([each.name for each in inertias])
        first = inertias[0]
        cause = (
            f"{names} has a moment of inertia of {first.moment:.3g} kg·m², and {first.mass:.3g} kg within "
            f"{first.reach:.2f} m have at most {first.max_moment:.1g}: a placeholder"
        )
        remedy = f"correct the inertia of {names} in {robot.mjcf}"

        def reduce_inertias(simulation: Any) -> None:
            for each in inertias:
                _expand_field(simulation, "body_inertia")[:, each.body] = 0.2 * each.max_moment

        yield Suspect(cause, remedy, reduce_inertias)


def _gain_suspects(subject: DoctorSubject, stance: Stance) -> Iterator[Suspect]:
    """Yield the suspected cause "unsuitable servo gains", unless the robot already has the proposed gains.

    The remedy is to use SimpleQuad's servo gains, scaled by leg length and mass. Nothing is yielded if a joint needs
    almost its rated torque to stand, because other gains do not reduce this torque.

    Args:
        subject: The examined robot, with its name as the user has given it.
        stance: Result of the robot's stance test.

    Yields:
        The suspected cause with its remedy.
    """
    robot = stance.robot
    if stance.is_overloaded:
        return
    stiffness, damping = (_rounded(gain) for gain in scaled_servo_gains(robot))
    proposed = np.array(((float(stiffness),), (float(damping),)))
    if (np.abs(robot.gains / proposed - 1.0) < GAIN_TOLERANCE).all():
        return
    other = robot.with_servo(float(stiffness), float(damping))
    is_soft = not stance.diverged and stance.tracking_error > LIMITS.tracking_error
    if is_soft:
        cause = f"a stiffness of {robot.servo_stiffness.min():g} N·m/rad is too little for {robot.mass:.3g} kg"
    else:
        stiffest = f"a stiffness of {robot.servo_stiffness.max():g} N·m/rad"
        cause = f"a damping of {robot.servo_damping.min():g} N·m·s/rad is too little for {stiffest}"
    remedy = f"servo_stiffness = {stiffness} and servo_damping = {damping} or so in {subject.parameter_source}"
    yield Suspect(cause, remedy, robot=other)


def _joint_suspects(robot: Robot) -> Iterator[Suspect]:
    """Yield the suspected cause "joint springs" if joints have springs; the remedy is to remove them."""
    model = robot.model
    springs = np.column_stack((model.jnt_stiffness, model.jnt_stiffnesspoly))
    joints = [int(joint) for joint in np.flatnonzero(springs.any(axis=1))]
    if joints:
        names = _shorten_names([_joint_name(model, joint) for joint in joints])
        largest = float(np.abs(springs).sum(axis=1).max())
        cause = f"springs in the joints of the model pull against the servos: {names}, up to {largest:.3g} N·m at 1 rad"

        def remove_springs(simulation: Any) -> None:
            for field in ("jnt_stiffness", "jnt_stiffnesspoly"):
                _expand_field(simulation, field)[:] = 0.0

        yield Suspect(cause, f"stiffness = 0 of these joints in {robot.mjcf}", remove_springs)


def self_contacts(subject: DoctorSubject) -> list[str]:
    """Return one line about the robot's bodies that touch each other at the end of a simulated squat.

    The list is empty if the bodies of the robot do not touch each other.
    """
    pairs = _self_contact_pairs(subject.env)
    return [f"bodies of the robot press against each other: {_in_words(pairs)}"] if pairs else []


def _self_contact_pairs(env: Any) -> list[tuple[str, str]]:
    """Run the stance test in `env`, and return the pairs of bodies that touch each other at its end.

    `env` is an environment of one robot. Each pair contains the names of the two bodies in the robot's file.
    """
    measure_stance(env)
    model = env.model
    bodies = model.geom_bodyid[env.data.contact.geom]
    self_contacts = bodies[(bodies > 0).all(axis=1)]
    pairs = sorted({(int(min(pair)), int(max(pair))) for pair in self_contacts})
    file_names = body_names(env.robot) if pairs else {}
    return [(_name(model, one, file_names), _name(model, other, file_names)) for one, other in pairs]


def _in_words(pairs: list[tuple[str, str]]) -> str:
    return _shorten_names([" and ".join(pair) for pair in pairs])


def _contact_suspects(robot: Robot, stance: Stance) -> Iterator[Suspect]:
    """Yield the suspected cause "self-contact" if bodies of the robot touch each other after the stance test.

    The remedy is to disable the collisions between the robot's bodies.

    Args:
        robot: The robot.
        stance: Result of the robot's stance test.

    Yields:
        The suspected cause with its remedy.
    """
    pairs = [] if stance.diverged else _self_contact_pairs(make_standing_env(robot))
    if not pairs:
        return

    def remove_self_contacts(simulation: Any) -> None:
        is_robot_geom = simulation.model.geom_bodyid > 0
        for field in ("geom_contype", "geom_conaffinity"):
            _expand_field(simulation, field)[:, is_robot_geom] &= GROUND_BIT

    cause = f"bodies of the robot press against each other: {_in_words(pairs)}"
    rules = "".join(f'<exclude body1="{one}" body2="{other}"/>' for one, other in pairs)
    yield Suspect(cause, f"<contact>{rules}</contact> in {robot.mjcf}, or other shapes", remove_self_contacts)


def _rounded(gain: float) -> str:
    """Format a servo gain as a short, rounded text; `diagnose` tests and proposes the rounded gain."""
    if gain < 1.0:
        return f"{gain:.3g}"
    return f"{gain:.1f}" if gain < 100.0 else f"{gain:.0f}"


def _expand_field(simulation: Any, field: str) -> Any:
    """Return a field of the simulated model as a writable array with one row per robot.

    Args:
        simulation: Simulation of one robot.
        field: Name of a field of `mujoco.MjModel`, such as `body_inertia`.

    Returns:
        The array; writing to it changes the simulated model.
    """
    return simulation.batch.expand(field)


def _shorten_names(names: list[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more


def _joint_name(model: Any, joint: int) -> str:
    """Return the name of the joint with the id `joint` in the compiled `model`.

    The result is "the free joint" for the trunk's free joint, which has the first six degrees of freedom of the model.
    """
    return str(model.joint(joint).name) if model.jnt_dofadr[joint] >= 6 else "the free joint"


def _name(model: Any, body: int, file_names: dict[str, str]) -> str:
    """Return the name of a body in the user's file, or in the scene if it has no name in the file.

    Args:
        model: Compiled `mujoco.MjModel` of the scene.
        body: Id of the body.
        file_names: Name of a body in the scene -> its name in the user's file.

    Returns:
        The name, without the prefixes of imported parts.
    """
    name = str(model.body(body).name)
    return file_names.get(name, name.removeprefix(ATTACH_PREFIX).removeprefix(RENAMED_PREFIX))
