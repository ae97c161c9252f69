"""Texts about a user's model that the commands `describe` and `doctor` print.

The texts describe the feet, the parts that the imported robot does not have, overlapping bodies, and the names of
bodies.
"""

from collections.abc import Iterator

from quad_env.robots.model_file import UserModel
from quad_env.robots.omissions import CONTACT
from quad_env.robots.overlaps import find_overlaps, format_overlaps
from quad_env.robots.parameters import RobotParameters
from quad_env.robots.part_names import ATTACH_PREFIX
from quad_env.robots.structure import LINKS


def describe_extras(robot: RobotParameters) -> Iterator[tuple[str, str]]:
    """Yield the lines of the command `describe` about an imported robot's feet, trunk and omitted parts.

    Each line is a pair of heading and text, such as `feet` and the names of the foot geoms.
    """
    import mujoco

    model = robot.user_model.model
    structure = robot.user_model.structure
    feet = [geom for leg in structure.legs for geom in leg.foot.geoms]
    names = [model.geom(geom).name or model.body(model.geom_bodyid[geom]).name for geom in feet]
    kinds = {mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower() for geom in feet}
    yield "feet", f"{', '.join(names)} ({', '.join(sorted(kinds))})"
    if not structure.trunk_collides(model):
        yield "trunk", "does not collide in the model: the box around what is shown of it does here"
    yield from omission_lines(robot.user_model, robot.keeps_contact)


def omission_lines(user_model: UserModel, keeps_contact: bool = False) -> Iterator[tuple[str, str]]:
    """Yield the report lines about parts of a user's model that the imported robot lacks.

    Args:
        user_model: The user's model.
        keeps_contact: True if the robot keeps the contact parameters of its model, so that the line about replaced
            contact parameters is left out; see `RobotParameters.keeps_contact`.

    Yields:
        Heading and text of a line.
    """
    for heading, text in user_model.structure.omission_lines:
        if not (keeps_contact and heading == CONTACT):
            yield heading, text


def overlap_remark(robot: RobotParameters) -> str | None:
    """Return a line about the bodies of a robot that overlap in the home pose.

    None is returned if no bodies overlap, or if the robot is not imported.
    """
    import mujoco

    if not robot.imported:
        return None
    model = robot.user_model.model
    overlaps = find_overlaps(mujoco, model, robot.user_model.structure, robot.home_pose)
    return format_overlaps(model, overlaps) if overlaps else None


def body_names(robot: RobotParameters) -> dict[str, str]:
    """Return the dictionary: name of a body in the simulated scene -> name of this body in the user's file.

    Messages use the dictionary to name bodies as the user does, because an import renames the bodies. Bodies without a
    name in the file are left out. The dictionary is empty for a robot that is not imported.
    """
    if not robot.imported:
        return {}
    model = robot.user_model.model
    structure = robot.user_model.structure
    names = {ATTACH_PREFIX + name: name for body in structure.bodies if (name := str(model.body(body).name))}
    if root := str(model.body(structure.root).name):
        names["base_link"] = root
    for leg in structure.legs:
        for joint, link in zip(leg.joints, LINKS, strict=True):
            if name := str(model.body(int(model.jnt_bodyid[joint])).name):
                names[f"{leg.name}_{link}_link"] = name
    return names
