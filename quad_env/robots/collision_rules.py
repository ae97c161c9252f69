"""What a user's robot collides with on our ground: the ground, by a bit of its own, and itself, as in its model."""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from quad_env.robots.overlaps import Overlap
from quad_env.robots.shapes import geom_ids, welded_bodies
from quad_env.robots.structure import LINKS, RobotStructure

GROUND_BIT = 1 << 30
"""Of `contype` of the geoms that meet the ground, and of `conaffinity` of the ground: so that these collide, whatever
bits the model uses by itself, and no two geoms of a robot do that did not before."""
ATTACH_PREFIX, RENAMED_PREFIX = "own/", "@"
"""Before the names of a model's parts on our ground, and before those that get a name from here."""


class SpecElements(NamedTuple):
    """Parts of a specification by the ids that they have in its model; changes to it lose these."""

    bodies: dict[int, Any]
    joints: dict[int, Any]
    geoms: dict[int, Any]


RULES = {"excludes": ("body", "bodyname1", "bodyname2"), "pairs": ("geom", "geomname1", "geomname2")}
"""Which parts may not collide, and which may: kind of the parts, and the fields that name the two."""


Rule = tuple[Any, str, Any]
"""Rule of a specification, its field, and the part that it names."""


def keep_robot_rules(own: Any, found: RobotStructure, overlaps: Sequence[Overlap]) -> list[Rule]:
    """Return the rules of a specification between parts of the robot, and delete the others from it.

    Rules with parts of the scene are deleted, since the ground is ours. So are pairs of geoms of the bodies in
    `overlaps`.

    Args:
        own: Specification of the user's file.
        found: What its model is made of.
        overlaps: Bodies that are not to collide.
    """
    kept: list[Rule] = []
    apart = [set(overlap.bodies) for overlap in overlaps]
    for kind, (part, *names) in RULES.items():
        for rule in list(getattr(own, kind)):
            parts = [getattr(own, part)(getattr(rule, name)) for name in names]
            bodies = {each.id if part == "body" else each.parent.id for each in parts}
            if bodies <= set(found.bodies) and not (kind == "pairs" and bodies in apart):
                kept += [(rule, name, each) for name, each in zip(names, parts, strict=True)]
            else:
                own.delete(rule)
    return kept


def add_exclusions(own: Any, parts: SpecElements, overlaps: Sequence[Overlap]) -> list[Rule]:
    """Exclude bodies with overlapping shapes from collision in a specification and return the new rules.

    Args:
        own: Specification of the user's file, changed.
        parts: Parts of the specification.
        overlaps: Bodies that are not to collide.
    """
    rules: list[Rule] = []
    for overlap in overlaps:
        rule = own.add_exclude()
        bodies = [parts.bodies[body] for body in overlap.bodies]
        rules += [(rule, name, body) for name, body in zip(RULES["excludes"][1:], bodies, strict=True)]
    return rules


def scene_name(name: str) -> str:
    """Name on our ground of a part that has got one from here; the name as it is of any other."""
    return name.removeprefix(ATTACH_PREFIX + RENAMED_PREFIX)


def contact_parts(parts: SpecElements, model: Any, found: RobotStructure) -> Iterator[tuple[str, list[Any]]]:
    """Name of each part that touches the ground -> the bodies, or geoms, whose contacts are its contacts."""
    its_own = [] if found.trunk_collides(model) else [parts.bodies[found.trunk]]
    yield "trunk", [*its_own, *_solid(parts, model, found, found.trunk, ())]
    for leg in found.legs:
        yield f"{leg.name}_foot", [parts.geoms[geom] for geom in leg.foot.geoms]
        for joint, link in zip(leg.joints[1:], LINKS[1:], strict=True):
            yield f"{leg.name}_{link}", _solid(parts, model, found, int(model.jnt_bodyid[joint]), leg.foot.geoms)


def _solid(parts: SpecElements, model: Any, found: RobotStructure, body: int, feet: Sequence[int]) -> list[Any]:
    """The body and those welded to it, as far as they meet the ground; instead of one with a foot its other geoms."""
    solid: list[Any] = []
    for each in welded_bodies(model, body):
        geoms = geom_ids(model, [each], found.collides_with_ground)
        others = [parts.geoms[geom] for geom in geoms if geom not in feet]
        solid += [parts.bodies[each]] if others and len(others) == len(geoms) else others
    return solid


def set_ground_bits(parts: SpecElements, found: RobotStructure) -> None:
    """Give the ground's bit to the geoms that meet it, and to no other."""
    for geom, meets in enumerate(found.collides_with_ground):
        part = parts.geoms[geom]
        part.contype, part.conaffinity = part.contype & ~GROUND_BIT, part.conaffinity & ~GROUND_BIT
        part.contype |= GROUND_BIT * int(meets)


def numbered_name(name: str, number: int) -> str:
    """`name` of the first of several parts, counted from 0, `name_2` of the second, and so on."""
    return name if number == 0 else f"{name}_{number + 1}"


def names_of_part(name: str, names: Iterable[str]) -> list[str]:
    """Those of these names that `numbered` gives to parts of that name."""
    return [each for each in names if re.fullmatch(rf"{re.escape(name)}(_\d+)?", each)]


def foot_geoms(model: Any, leg: str) -> list[int]:
    """Ids of the geoms that are the foot of that leg in a model of `spec_of`."""
    names = [model.geom(number).name for number in range(model.ngeom)]
    return [model.geom(name).id for name in names_of_part(f"{leg}_foot", names)]
