"""Selection of the parts of a user's robot that collide with the ground and with each other in simulation.

One bit of `contype`, `GROUND_BIT`, selects the geoms that collide with the ground. Self-collisions are the same as in
the user's model, except that bodies that overlap in the home pose do not collide with each other.
"""

from collections.abc import Iterator, Sequence
from typing import Any

from quad_env.robots.attached_model import AttachedModel
from quad_env.robots.overlaps import Overlap
from quad_env.robots.shapes import GROUND_BIT, geom_ids, welded_bodies
from quad_env.robots.structure import LINKS

RULES = {"excludes": ("body", "bodyname1", "bodyname2"), "pairs": ("geom", "geomname1", "geomname2")}
"""Attribute of `mujoco.MjSpec` with collision rules -> type of a rule's two parts, and its two name fields.

The name fields of a rule contain the names of its two parts. A rule in `excludes` names two bodies that must not
collide. A rule in `pairs` names two geoms that collide.
"""

Rule = tuple[Any, str, Any]
"""Type of a reference from a collision rule to a part: the rule, its name field, and the body or geom.

Each rule has two references, because it names two parts. After all parts have been renamed, `apply_rules` writes the
final name of the body or geom into the name field.
"""


def collect_rules(attached: AttachedModel, overlaps: Sequence[Overlap]) -> list[Rule]:
    """Collect the collision rules between parts of the robot, and delete all other rules from the model.

    Args:
        attached: The user's model; its elements still have the ids of the compiled model.
        overlaps: Pairs of bodies that overlap in the home pose and must not collide.

    Returns:
        Two items for each rule: one for each body or geom that the rule names. The user's rules between parts of the
        robot come first, followed by a new exclusion for each overlap.
    """
    return [*_keep_robot_rules(attached, overlaps), *_add_exclusions(attached, overlaps)]


def _keep_robot_rules(attached: AttachedModel, overlaps: Sequence[Overlap]) -> list[Rule]:
    """Return the user's collision rules between parts of the robot, and delete all other rules from the model.

    Rules with parts of the user's scene are deleted, because SimpleQuad's scene replaces the user's scene. Geom pairs
    of bodies that overlap in the home pose are deleted, because these bodies must not collide.

    Args:
        attached: The user's model; its `spec` is changed.
        overlaps: Pairs of bodies that overlap in the home pose.

    Returns:
        Two items for each kept rule: one for each body or geom that the rule names.
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
    """Add a rule to `attached.spec` for each overlap, so that the two overlapping bodies do not collide.

    The new rules are returned, with two items per rule: one for each of the two bodies.
    """
    _, *fields = RULES["excludes"]
    rules: list[Rule] = []
    for overlap in overlaps:
        rule = attached.spec.add_exclude()
        bodies = [attached.elements.bodies[body] for body in overlap.bodies]
        rules += [(rule, field, body) for field, body in zip(fields, bodies, strict=True)]
    return rules


def apply_rules(rules: Sequence[Rule]) -> None:
    """Write the final name of each body or geom into the collision rule that names it.

    The function must be called after all bodies and geoms have been renamed, because the rules refer to names.
    """
    for rule, field, element in rules:
        setattr(rule, field, element.name)


def contact_parts(attached: AttachedModel) -> Iterator[tuple[str, list[Any]]]:
    """Yield the parts of the robot that get contact sensors: the trunk, and the foot, thigh and calf of each leg.

    Args:
        attached: The user's model with renamed bodies and geoms.

    Yields:
        Name of the part, such as `fl_calf`, and its bodies and geoms in `attached.spec`. Each of these bodies and geoms
        gets one contact sensor.
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
    """Collect the parts of a link that collide with the ground and do not belong to the foot.

    Args:
        attached: The user's model.
        body: Id of a body; the link consists of this body and all bodies that are welded to it.
        foot: Ids of the foot geoms. Foot geoms are left out, because the foot has a separate contact sensor.

    Returns:
        Bodies of the link with geoms that collide with the ground. A body that also has foot geoms is replaced by its
        colliding geoms that are not foot geoms.
    """
    parts: list[Any] = []
    for each in welded_bodies(attached.model, body):
        geoms = geom_ids(attached.model, [each], attached.structure.collides_with_ground)
        others = [attached.elements.geoms[geom] for geom in geoms if geom not in foot]
        parts += [attached.elements.bodies[each]] if others and len(others) == len(geoms) else others
    return parts


def set_ground_bits(attached: AttachedModel) -> None:
    """Set the bit `GROUND_BIT` of `contype` in the geoms that collide with the ground, and clear it in all other geoms.

    The bit is also cleared in `conaffinity` of all geoms, so that `GROUND_BIT` does not affect self-collisions.
    """
    for geom, collides in enumerate(attached.structure.collides_with_ground):
        element = attached.elements.geoms[geom]
        element.contype &= ~GROUND_BIT
        element.conaffinity &= ~GROUND_BIT
        element.contype |= GROUND_BIT * int(collides)
