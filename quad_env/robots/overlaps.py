"""Detection of a robot's collision shapes that overlap in the home pose, such as a rotor inside the trunk.

Models that were made for simulators without self-collision often have overlapping shapes. Two overlapping bodies would
push each other apart against the servos. The simulated scene therefore excludes collisions between these two bodies. An
overlap of a foot geom with another body does not lead to this exclusion.
"""

import copy
from typing import Any, NamedTuple

from quad_env.robots.shapes import Floats
from quad_env.robots.structure import RobotStructure


class Overlap(NamedTuple):
    """Two bodies of a robot with shapes that overlap in the home pose; made by `find_overlaps`."""

    bodies: tuple[int, int]
    """Ids of the two overlapping bodies in the compiled model, in ascending order."""
    geoms: tuple[int, int]
    """Ids of the two geoms, one of each body, that penetrate each other deepest, in the compiled model."""
    depth: float
    """Penetration depth of the two geoms in `geoms`, m; all other geoms of the two bodies penetrate less."""


def find_overlaps(mujoco: Any, model: Any, structure: RobotStructure, home_pose: Floats) -> list[Overlap]:
    """Find the pairs of bodies of the robot that collide with each other in the home pose.

    Args:
        mujoco: The package `mujoco`.
        model: Compiled `mujoco.MjModel` of the user's file.
        structure: Trunk, legs and colliding geoms of `model`.
        home_pose: Joint angles of the home pose, zero with the legs straight down, (12,), rad.

    Returns:
        One overlap per pair of bodies, in the order of the body ids. Pairs that touch only with a foot are left out.
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
    """Return a line for the user with the names of the overlapping bodies and the penetration depths.

    Args:
        model: Compiled `mujoco.MjModel` of the user's file, with the names of the bodies.
        overlaps: At least one overlap.

    Returns:
        The line.
    """
    pairs = [
        f"{_name(model, overlap.bodies[0])} and {_name(model, overlap.bodies[1])} by {1e3 * overlap.depth:.1f} mm"
        for overlap in overlaps
    ]
    return f"shapes overlap in the home pose, and do not collide with each other here: {', '.join(pairs)}"


def _name(model: Any, body: int) -> str:
    return str(model.body(body).name) or f"body number {body}"
