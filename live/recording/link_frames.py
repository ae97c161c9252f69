"""What the rows of a recording are of, and the frames of the robot's links, each in that of its parent, as a URDF has
them: at the joint that moves the link.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from quad_env.robots.robot import Robot

Floats = NDArray[np.float64]
TRUNK, IMU_LINK = "base_link", "imu_link"


@dataclass(frozen=True)
class LinkFrame:
    """A frame below the trunk's."""

    name: str
    parent: str
    translation: Floats
    """In the parent's frame, m, (3,)."""
    rotation: Floats
    """Against the parent's frame where the joint is at its reference, w x y z, (4,)."""
    joint: int | None = None
    """Which of the robot's joints moves it; None of one that is fixed."""
    axis: Floats | None = None
    """Of the joint, in the link's frame; a unit vector, (3,)."""
    reference: float = 0.0
    """Angle of the joint where the model draws it at rest, rad."""


def link_frames(model: Any, data: Any, robot: Robot) -> tuple[LinkFrame, ...]:
    """Every link that a joint moves, the feet and the IMU, of the robot's compiled model in any state, which does not
    matter."""

    def frame(body: int) -> tuple[Floats, Rotation]:
        return data.xanchor[model.body_jntadr[body]], Rotation.from_matrix(data.xmat[body].reshape(3, 3))

    def link(name: str, body: int, place: Floats, link_orientation: Rotation, **joint: Any) -> LinkFrame:
        """One that is fixed to the body, or jointed to it; place and rotation in the world."""
        parent = model.body_weldid[body]
        origin, orientation = frame(parent)
        back = orientation.inv()
        rotation = (back * link_orientation).as_quat(scalar_first=True)
        return LinkFrame(name, model.body(parent).name, back.apply(place - origin), rotation, **joint)

    links = []
    for hinge in range(1, model.njnt):  # the first is that of the trunk
        body, address = model.jnt_bodyid[hinge], model.jnt_qposadr[hinge]
        axis, reference = model.jnt_axis[hinge].copy(), float(model.qpos0[address])
        place, turned = frame(body)
        rest = turned * Rotation.from_rotvec((reference - data.qpos[address]) * axis)
        moved = {"joint": int(address - 7), "axis": axis, "reference": reference}
        links.append(link(model.body(body).name, model.body_parentid[body], place, rest, **moved))
    sites = {f"{leg}_foot": f"{leg}_foot_link" for leg in robot.leg_names} | {"imu": IMU_LINK}
    for site, name in sites.items():
        number = model.site(site).id
        turned = Rotation.from_matrix(data.site_xmat[number].reshape(3, 3))
        links.append(link(name, model.site_bodyid[number], data.site_xpos[number], turned))
    return tuple(links)


def rotations(links: Sequence[LinkFrame], angles: Floats) -> Floats:
    """Orientation of each moving link in its parent's frame, w x y z, (links, 4); angles of the joints, rad, (12,)."""
    turns = [(angles[link.joint] - link.reference) * np.array(link.axis) for link in links]
    fixed = Rotation.from_quat([link.rotation for link in links], scalar_first=True)
    return np.asarray((fixed * Rotation.from_rotvec(turns)).as_quat(scalar_first=True))


@dataclass(frozen=True)
class RecordingSchema:
    """What the rows are of, a row a control step or start of an episode."""

    widths: dict[str, int]
    """Columns of each reading, in the order of a row; also `reward`, `correction`, NaN of a policy that has none, and
    `start`, 1 where an episode or the recording begins."""
    joints: tuple[str, ...]
    legs: tuple[str, ...]
    links: tuple[LinkFrame, ...]
    description: str
    """URDF of the robot; empty where there is none."""
    dt: float
    """Control period, s."""

    @property
    def slices(self) -> dict[str, slice]:
        """Reading -> its columns."""
        ends = np.cumsum(list(self.widths.values())).tolist()
        return {name: slice(end - width, end) for end, (name, width) in zip(ends, self.widths.items(), strict=True)}
