"""Collisions of a user's robot in the scene.

A bit of `contype` selects the geoms that collide with the ground. Self-collisions are the same as in the user's model,
except between bodies that overlap in the home pose.
"""

from collections.abc import Iterator, Sequence
from typing import Any

from quad_env.robots.attached_model import AttachedModel
from quad_env.robots.overlaps import Overlap
from quad_env.robots.shapes import GROUND_BIT, geom_ids, welded_bodies
from quad_env.robots.structure import LINKS

RULES = {"excludes": ("body", "bodyname1", "bodyname2"), "pairs": ("geom", "geomname1", "geomname2")}
"""Kind of collision rule in a specification -> kind of the two parts, and the two fields with their names.

`excludes` are pairs of bodies that must not collide, `pairs` are pairs of geoms that collide.
"""

Rule = tuple[Any, str, Any]
"""A rule of a specification, the name of one of its fields, and the element that this field names."""


def collect_rules(attached: AttachedModel, overlaps: Sequence[Overlap]) -> list[Rule]:
    """Collect the collision rules between parts of the robot, and delete all other rules.

    Args:
        attached: The model; its elements still have the ids of the compiled model.
        overlaps: Pairs of bodies that overlap in the home pose and must not collide.

    Returns:
        The user's rules that are kept, and a new exclusion for each overlap.
    """
    return [*_keep_robot_rules(attached, overlaps), *_add_exclusions(attached, overlaps)]


def _keep_robot_rules(attached: AttachedModel, overlaps: Sequence[Overlap]) -> list[Rule]:
    """Return the user's rules between parts of the robot, and delete all others.

    Rules with parts of the user's scene are deleted, because the scene is replaced by ours. Geom pairs of overlapping
    bodies are deleted, because these bodies must not collide.
    """
    spec = attached.spec
    kept: list[Rule] = []
    overlapping = [set(overlap.bodies) for overlap in overlaps]
    robot_bodies = set(attached.structure.bodies)
    for kind, (part, *fields) in RULES.items():
        for rule in list(getattr(spec, kind)):
            elements = [getattr(spec, part)(getattr(rule, field)) for field in fields]
            bodies = {each.id if part == "body" else each.parent.id for each in elements}
            if bodies <= robot_bodies and not (kind == "pairs" and bodies in overlapping):
                kept += [(rule, field, element) for field, element in zip(fields, elements, strict=True)]
            else:
                spec.delete(rule)
    return kept


def _add_exclusions(attached: AttachedModel, overlaps: Sequence[Overlap]) -> list[Rule]:
    """Exclude the collision of overlapping bodies and return the new rules."""
    _, *fields = RULES["excludes"]
    rules: list[Rule] = []
    for overlap in overlaps:
        rule = attached.spec.add_exclude()
        bodies = [attached.elements.bodies[body] for body in overlap.bodies]
        rules += [(rule, field, body) for field, body in zip(fields, bodies, strict=True)]
    return rules


def apply_rules(rules: Sequence[Rule]) -> None:
    """Write the final names of the elements into the rules; called after all elements are renamed."""
    for rule, field, element in rules:
        setattr(rule, field, element.name)


def contact_parts(attached: AttachedModel) -> Iterator[tuple[str, list[Any]]]:
    """Yield each part of the robot that gets contact sensors: its name, and its bodies or geoms.

    The parts are the trunk, and foot, thigh and calf of each leg.
    """
    structure = attached.structure
    trunk = [] if structure.trunk_collides(attached.model) else [attached.elements.bodies[structure.trunk]]
    yield "trunk", [*trunk, *_colliding_parts(attached, structure.trunk, ())]
    for leg in structure.legs:
        yield f"{leg.name}_foot", [attached.elements.geoms[geom] for geom in leg.foot.geoms]
        for joint, link in zip(leg.joints[1:], LINKS[1:], strict=True):
            body = int(attached.model.jnt_bodyid[joint])
            yield f"{leg.name}_{link}", _colliding_parts(attached, body, leg.foot.geoms)


def _colliding_parts(attached: AttachedModel, body: int, foot: Sequence[int]) -> list[Any]:
    """Collect the elements of a rigid assembly that collide with the ground, without its foot.

    Args:
        attached: The model.
        body: Id of a body; its assembly is this body and all bodies welded to it.
        foot: Ids of the foot geoms, which have a separate sensor.

    Returns:
        Each body of the assembly that collides. A body with foot geoms is replaced by its other colliding geoms.
    """
    parts: list[Any] = []
    for each in welded_bodies(attached.model, body):
        geoms = geom_ids(attached.model, [each], attached.structure.collides_with_ground)
        others = [attached.elements.geoms[geom] for geom in geoms if geom not in foot]
        parts += [attached.elements.bodies[each]] if others and len(others) == len(geoms) else others
    return parts


def set_ground_bits(attached: AttachedModel) -> None:
    """Set GROUND_BIT in the geoms that collide with the ground, and clear it in all other geoms."""
    for geom, collides in enumerate(attached.structure.collides_with_ground):
        element = attached.elements.geoms[geom]
        element.contype &= ~GROUND_BIT
        element.conaffinity &= ~GROUND_BIT
        element.contype |= GROUND_BIT * int(collides)
