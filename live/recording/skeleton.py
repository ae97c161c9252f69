"""Frames of a robot's links, each in that of its parent, as a URDF has them: at the joint that moves the link."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.physics.rotations import product
from quad_env.physics.state import rotation_matrix
from quad_env.robots.robot import Robot

Floats = NDArray[np.float64]
Rotation = tuple[float, float, float, float]
"""w x y z"""
Place = tuple[str, Floats, Rotation]
"""Link, and what is fixed to it: where, m, and turned how, in the link's frame."""
TRUNK = "base_link"


@dataclass(frozen=True)
class Link:
    """A frame below the trunk's."""

    name: str
    parent: str
    translation: Floats
    """In the parent's frame, m, (3,)."""
    rotation: Rotation
    """Against the parent's frame where the joint is at its reference, w x y z."""
    joint: int | None = None
    """Which of the robot's joints moves it; None of one that is fixed."""
    axis: tuple[float, ...] = ()
    """Of the joint, in the link's frame; a unit vector."""
    reference: float = 0.0
    """Angle of the joint where the model draws it at rest, rad."""


def links_of(model: Any, robot: Robot) -> tuple[Link, ...]:
    """Every link that a joint moves, the feet and the IMU, of the robot's compiled model."""
    sites = {f"{leg}_foot": f"{leg}_foot_link" for leg in robot.leg_names} | {"imu": "imu_link"}
    return (*_moving(model), *_fixed(model, sites))


def rotations(links: Sequence[Link], angles: Floats) -> Floats:
    """Orientation of each moving link in its parent's frame, w x y z, (n, links, 4); angles of the joints (n, 12)."""
    turned = []
    for link in links:
        half = 0.5 * (angles[:, link.joint] - link.reference)
        about = np.column_stack((np.cos(half), np.sin(half)[:, None] * link.axis))
        turned.append(product(link.rotation, about))
    return np.stack(turned, axis=1)


def _moving(model: Any) -> Iterator[Link]:
    for body in range(model.nbody):
        hinge = model.body_jntadr[body]
        if hinge < 0 or model.body(body).name == TRUNK:
            continue
        at, turned = model.body_pos[body], model.body_quat[body]
        parent, place, rotation = _place(model, model.body_parentid[body], _moved(at, turned, model.jnt_pos[hinge]))
        address = model.jnt_qposadr[hinge]
        axis = tuple(model.jnt_axis[hinge].tolist())
        rest, reference = _turned(rotation, turned), float(model.qpos0[address])
        yield Link(model.body(body).name, parent, place, rest, int(address - 7), axis, reference)


def _fixed(model: Any, sites: dict[str, str]) -> Iterator[Link]:
    for site, name in sites.items():
        number = model.site(site).id
        parent, place, turned = _place(model, model.site_bodyid[number], model.site_pos[number])
        yield Link(name, parent, place, _turned(turned, model.site_quat[number]))


def _place(model: Any, body: int, at: Floats) -> Place:
    """The link that carries that body, and a point of the body, and the body's turn, in the link's frame."""
    turned: Rotation = (1.0, 0.0, 0.0, 0.0)
    while (hinge := model.body_jntadr[body]) < 0:
        at, turned = _moved(model.body_pos[body], model.body_quat[body], at), _turned(model.body_quat[body], turned)
        body = model.body_parentid[body]
    name = model.body(body).name
    return name, at if name == TRUNK else at - model.jnt_pos[hinge], turned


def _moved(at: Floats, turned: Rotation, point: Floats) -> Floats:
    """A point of a frame that is there and turned so."""
    return np.asarray(at + np.array(rotation_matrix(turned)) @ point)


def _turned(first: Rotation, then: Rotation) -> Rotation:
    """The rotation `then`, turned by `first`."""
    w, x, y, z = product(first, np.array([then]))[0].tolist()
    return w, x, y, z
