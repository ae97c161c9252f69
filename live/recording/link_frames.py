"""Schema of a recording's rows, and the frames of the robot's links as in a URDF: at the joint that moves the link."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from quad_env.robots.robot import Robot

Floats = NDArray[np.float64]
TRUNK = "base_link"
IMU_LINK = "imu_link"


@dataclass(frozen=True)
class LinkFrame:
    """Frame of a link relative to the frame of its parent link."""

    name: str
    parent: str
    """Name of the parent link."""
    translation: Floats
    """Origin in the parent's frame, (3,), m."""
    rotation: Floats
    """Orientation in the parent's frame with the joint at its reference, quaternion w x y z, (4,)."""
    joint: int | None = None
    """Index of the robot's joint that moves the link; None for a fixed link."""
    axis: Floats | None = None
    """Axis of the joint in the link's frame, unit vector, (3,)."""
    reference: float = 0.0
    """Angle of the joint in the model's initial pose, rad."""


def link_frames(model: Any, data: Any, robot: Robot) -> tuple[LinkFrame, ...]:
    """Return the frame of every link that a joint moves, of the feet and of the IMU.

    Args:
        model: Compiled model of the robot.
        data: Its data in any state; the result does not depend on it.
        robot: The robot.

    Returns:
        The frames, moving links first.
    """
    return (*_moving_frames(model, data), *_fixed_frames(model, data, robot))


def _moving_frames(model: Any, data: Any) -> list[LinkFrame]:
    """Return the frames of the links that hinges move."""
    frames = []
    for hinge in range(1, model.njnt):  # joint 0 is the trunk's free joint
        body = model.jnt_bodyid[hinge]
        address = model.jnt_qposadr[hinge]
        axis = model.jnt_axis[hinge].copy()
        reference = float(model.qpos0[address])
        origin, orientation = _body_frame(model, data, body)
        reference_orientation = orientation * Rotation.from_rotvec((reference - data.qpos[address]) * axis)
        translation, rotation, parent = _relative_frame(
            model, data, model.body_parentid[body], origin, reference_orientation
        )
        frames.append(
            LinkFrame(model.body(body).name, parent, translation, rotation, int(address - 7), axis, reference)
        )
    return frames


def _fixed_frames(model: Any, data: Any, robot: Robot) -> list[LinkFrame]:
    """Return the frames of the feet and of the IMU."""
    link_names = {f"{leg}_foot": f"{leg}_foot_link" for leg in robot.leg_names} | {"imu": IMU_LINK}
    frames = []
    for site, name in link_names.items():
        site_id = model.site(site).id
        orientation = Rotation.from_matrix(data.site_xmat[site_id].reshape(3, 3))
        translation, rotation, parent = _relative_frame(
            model, data, model.site_bodyid[site_id], data.site_xpos[site_id], orientation
        )
        frames.append(LinkFrame(name, parent, translation, rotation))
    return frames


def _body_frame(model: Any, data: Any, body: int) -> tuple[Floats, Rotation]:
    """Return the origin of a body's frame, at its joint, and its orientation, world frame."""
    return data.xanchor[model.body_jntadr[body]], Rotation.from_matrix(data.xmat[body].reshape(3, 3))


def _relative_frame(
    model: Any, data: Any, body: int, origin: Floats, orientation: Rotation
) -> tuple[Floats, Floats, str]:
    """Return translation, quaternion and parent link of a world frame that is attached to a body."""
    parent = model.body_weldid[body]
    parent_origin, parent_orientation = _body_frame(model, data, parent)
    parent_from_world = parent_orientation.inv()
    rotation = (parent_from_world * orientation).as_quat(scalar_first=True)
    return parent_from_world.apply(origin - parent_origin), rotation, model.body(parent).name


def rotations(links: Sequence[LinkFrame], angles: Floats) -> Floats:
    """Compute the orientations of moving links in the frames of their parents.

    Args:
        links: Links that joints move.
        angles: Joint angles, (12,), rad.

    Returns:
        Quaternions w x y z, (links, 4).
    """
    joint_rotations = [(angles[link.joint] - link.reference) * np.array(link.axis) for link in links]
    fixed = Rotation.from_quat([link.rotation for link in links], scalar_first=True)
    return np.asarray((fixed * Rotation.from_rotvec(joint_rotations)).as_quat(scalar_first=True))


@dataclass(frozen=True)
class RecordingSchema:
    """Contents of a recording's rows, one per control step or start of an episode."""

    widths: dict[str, int]
    """Number of columns of each reading, in the order of a row. It includes `reward`, `correction`, NaN for a policy
    without one, and `start`, 1 where an episode or the recording begins."""
    joints: tuple[str, ...]
    """Names of the joints."""
    legs: tuple[str, ...]
    """Names of the legs."""
    links: tuple[LinkFrame, ...]
    """Frames of the links."""
    description: str
    """URDF of the robot; empty without one."""
    dt: float
    """Control period, s."""

    @property
    def slices(self) -> dict[str, slice]:
        """Name of each reading -> its columns."""
        ends = np.cumsum(list(self.widths.values())).tolist()
        return {name: slice(end - width, end) for end, (name, width) in zip(ends, self.widths.items(), strict=True)}
