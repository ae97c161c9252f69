"""Collisions of a user's robot in the scene: with the ground, by a bit of its own, and with itself, as in its model."""

from collections.abc import Iterator, Sequence
from typing import Any

from quad_env.robots.attached_model import AttachedModel
from quad_env.robots.overlaps import Overlap
from quad_env.robots.shapes import GROUND_BIT, geom_ids, welded_bodies
from quad_env.robots.structure import LINKS

RULES = {"excludes": ("body", "bodyname1", "bodyname2"), "pairs": ("geom", "geomname1", "geomname2")}
"""Kinds of rules, of parts that may not and that may collide -> kind of the parts, and the fields with their names."""

Rule = tuple[Any, str, Any]
"""Rule of a specification, its field, and the element that this field names."""


def collect_rules(attached: AttachedModel, overlaps: Sequence[Overlap]) -> list[Rule]:
    """Return the collision rules of the robot in the scene; the other rules are deleted from its specification.

    Args:
        attached: The model; its elements still have their ids.
        overlaps: Pairs of bodies that overlap in the home pose and must not collide.

    Returns:
        The collision rules of the robot in the scene; the other rules are deleted from its specification.
    """
    return [*_keep_robot_rules(attached, overlaps), *_add_exclusions(attached, overlaps)]


def _keep_robot_rules(attached: AttachedModel, overlaps: Sequence[Overlap]) -> list[Rule]:
    """Return the user's rules between parts of the robot, and delete all others.

    Rules with parts of the user's scene are deleted, since the ground is ours. So are pairs of geoms of overlapping
    bodies.
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
    """Write the final names of the elements into their rules; called once all elements are named."""
    for rule, field, element in rules:
        setattr(rule, field, element.name)


def contact_parts(attached: AttachedModel) -> Iterator[tuple[str, list[Any]]]:
    """Yield the name of each part with measured ground contact, and its bodies or geoms."""
    structure = attached.structure
    trunk = [] if structure.trunk_collides(attached.model) else [attached.elements.bodies[structure.trunk]]
    yield "trunk", [*trunk, *_colliding_parts(attached, structure.trunk, ())]
    for leg in structure.legs:
        yield f"{leg.name}_foot", [attached.elements.geoms[geom] for geom in leg.foot.geoms]
        for joint, link in zip(leg.joints[1:], LINKS[1:], strict=True):
            body = int(attached.model.jnt_bodyid[joint])
            yield f"{leg.name}_{link}", _colliding_parts(attached, body, leg.foot.geoms)


def _colliding_parts(attached: AttachedModel, body: int, foot: Sequence[int]) -> list[Any]:
    """Return a body and those welded to it that collide with the ground; a body with foot geoms gives its other geoms.

    Args:
        attached: The model.
        body: Id of the body.
        foot: Ids of the foot's geoms, which have a sensor of their own.

    Returns:
        A body and those welded to it that collide with the ground; a body with foot geoms gives its other geoms.
    """
    parts: list[Any] = []
    for each in welded_bodies(attached.model, body):
        geoms = geom_ids(attached.model, [each], attached.structure.collides_with_ground)
        others = [attached.elements.geoms[geom] for geom in geoms if geom not in foot]
        parts += [attached.elements.bodies[each]] if others and len(others) == len(geoms) else others
    return parts


def set_ground_bits(attached: AttachedModel) -> None:
    """Give the ground's bit to the geoms that collide with the ground, and take it from all others."""
    for geom, collides in enumerate(attached.structure.collides_with_ground):
        element = attached.elements.geoms[geom]
        element.contype &= ~GROUND_BIT
        element.conaffinity &= ~GROUND_BIT
        element.contype |= GROUND_BIT * int(collides)
