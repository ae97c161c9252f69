"""Collision shapes of a robot that overlap in its home pose: a rotor inside the trunk, or a thigh that enters it.

Two bodies with overlapping shapes push each other apart against every servo. Makers leave these overlaps in models for
simulators without self-collision. On our ground these bodies do not collide with each other; feet are left as they are.
"""

import copy
from typing import Any, NamedTuple

from quad_env.robots.shapes import Floats
from quad_env.robots.structure import RobotStructure


class Overlap(NamedTuple):
    """Two bodies with shapes that overlap in the home pose; made by `find_overlaps`."""

    bodies: tuple[int, int]
    """Ids in the model."""
    geoms: tuple[int, int]
    """Ids of the two shapes with the largest overlap."""
    depth: float
    """Penetration depth of these two, m."""


def find_overlaps(mujoco: Any, model: Any, structure: RobotStructure, home_pose: Floats) -> list[Overlap]:
    """Return the body pairs that overlap in the home pose and collide in the model, in the model's order.

    Args:
        mujoco: The package.
        model: Compiled model, as its file has it.
        structure: Its structure.
        home_pose: Joint angles in the robot's convention, (12,), rad.

    Returns:
        The body pairs that overlap in the home pose and collide in the model, in the model's order.
    """
    model = copy.copy(model)
    model.opt.disableflags = 0
    data = mujoco.MjData(model)
    qpos = model.jnt_qposadr[structure.joints]
    data.qpos[qpos] = model.qpos0[qpos] + structure.signs * (home_pose - structure.joint_offsets)
    mujoco.mj_fwdPosition(model, data)
    feet = {geom for leg in structure.legs for geom in leg.foot.geoms}
    deepest: dict[tuple[int, int], Overlap] = {}
    for contact in data.contact[: data.ncon]:
        geoms = int(contact.geom[0]), int(contact.geom[1])
        bodies = int(model.geom_bodyid[geoms[0]]), int(model.geom_bodyid[geoms[1]])
        if contact.dist >= 0.0 or feet.intersection(geoms) or not structure.is_robot_body[list(bodies)].all():
            continue
        pair = (min(bodies), max(bodies))
        if pair not in deepest or -contact.dist > deepest[pair].depth:
            deepest[pair] = Overlap(pair, geoms, -float(contact.dist))
    return [deepest[pair] for pair in sorted(deepest)]


def format_overlaps(model: Any, overlaps: list[Overlap]) -> str:
    """Return a line with the names of the body pairs in `overlaps`, in the compiled `model`, and their depths."""
    pairs = [
        f"{_name(model, overlap.bodies[0])} and {_name(model, overlap.bodies[1])} by {1e3 * overlap.depth:.1f} mm"
        for overlap in overlaps
    ]
    return f"shapes overlap in the home pose, and do not collide with each other here: {', '.join(pairs)}"


def _name(model: Any, body: int) -> str:
    return str(model.body(body).name) or f"body number {body}"
