"""Computes the coordinate frames of the robot's links, and defines the columns of a recording.

As in a URDF, the origin of a link's frame is at the joint that moves the link. A recording has a row of numbers for
each control step.
"""

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
    """Coordinate frame of a link, relative to the frame of its parent link.

    For a link that a joint moves, the orientation depends on the joint angle, see `rotations`.
    """

    name: str
    parent: str
    """Name of the parent link, relative to which the frame is defined."""
    translation: Floats
    """Origin of the link's frame, in the frame of the parent link, (3,), m."""
    rotation: Floats
    """Orientation of the link at the joint angle `reference`, in the frame of the parent link.

    The orientation is a quaternion w x y z, (4,). If the link is fixed to its parent, the orientation is constant.
    """
    joint: int | None = None
    """Index, 0 to 11, of the joint that moves the link; None for a link that is fixed to its parent."""
    axis: Floats | None = None
    """Unit vector of the joint axis, link frame, (3,); None for a link that is fixed to its parent."""
    reference: float = 0.0
    """Joint angle in the initial pose of the MuJoCo model (`qpos0`), at which `rotation` holds, rad."""


def link_frames(model: Any, data: Any, robot: Robot) -> tuple[LinkFrame, ...]:
    """Compute the frames of all links that joints move, and of the feet and the IMU.

    Args:
        model: Compiled `mujoco.MjModel` of the robot.
        data: `mujoco.MjData` of the model in any state; the result does not depend on the state.
        robot: Robot that the model describes.

    Returns:
        Frames of the moving links, followed by the frames of the feet and of the IMU.
    """
    return (*_moving_frames(model, data), *_fixed_frames(model, data, robot))


def _moving_frames(model: Any, data: Any) -> list[LinkFrame]:
    """Return the frames of the links that hinge joints move, in the joint order of the MuJoCo model."""
    frames = []
    for hinge in range(1, model.njnt):  # Joint 0 is the free joint of the trunk.
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
    """Return the frames of the feet and of the IMU, which do not move relative to their parent links."""
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
    """Return the frame of a body, with the origin at the body's joint.

    Args:
        model: Compiled `mujoco.MjModel` of the robot.
        data: `mujoco.MjData` of the model.
        body: Index of the body.

    Returns:
        origin: Position of the joint, world frame, (3,), m.
        orientation: Rotation from the body frame to the world frame.
    """
    return data.xanchor[model.body_jntadr[body]], Rotation.from_matrix(data.xmat[body].reshape(3, 3))


def _relative_frame(
    model: Any, data: Any, body: int, origin: Floats, orientation: Rotation
) -> tuple[Floats, Floats, str]:
    """Express a frame that is attached to a body relative to the frame of the body's link.

    Args:
        model: Compiled `mujoco.MjModel` of the robot.
        data: `mujoco.MjData` of the model.
        body: Index of the body to which the frame is attached.
        origin: Origin of the frame, world frame, (3,), m.
        orientation: Rotation from the frame to the world frame.

    Returns:
        translation: Origin of the frame, link frame, (3,), m.
        rotation: Orientation of the frame, link frame, quaternion w x y z, (4,).
        parent: Name of the link. Bodies that are welded together are one link.
    """
    parent = model.body_weldid[body]
    parent_origin, parent_orientation = _body_frame(model, data, parent)
    parent_from_world = parent_orientation.inv()
    rotation = (parent_from_world * orientation).as_quat(scalar_first=True)
    return parent_from_world.apply(origin - parent_origin), rotation, model.body(parent).name


def rotations(links: Sequence[LinkFrame], angles: Floats) -> Floats:
    """Compute the orientations of moving links relative to their parent links, at given joint angles.

    Args:
        links: Frames of m links that joints move.
        angles: Angles of all joints, (12,), rad.

    Returns:
        Orientation of each link in the frame of its parent link, quaternions w x y z, (m, 4).
    """
    joint_rotations = [(angles[link.joint] - link.reference) * np.array(link.axis) for link in links]
    fixed = Rotation.from_quat([link.rotation for link in links], scalar_first=True)
    return np.asarray((fixed * Rotation.from_rotvec(joint_rotations)).as_quat(scalar_first=True))


@dataclass(frozen=True)
class RecordingSchema:
    """Schema of the rows of a recording, which the simulation sends to the writer process.

    A row is an array of numbers about one control step, or about the start of an episode.
    """

    widths: dict[str, int]
    """Name of a reading -> number of columns of the reading in a row.

    The dictionary has the order of the columns. Besides readings of the environment there are `reward`, `correction`
    and `start`. `correction` is the correction of a residual policy, and NaN for other policies. `start` is 1 in the
    first row of an episode or of the recording.
    """
    joints: tuple[str, ...]
    """Names of the joints, in the order of the joint readings."""
    legs: tuple[str, ...]
    """Names of the legs, in the order of the foot readings."""
    links: tuple[LinkFrame, ...]
    """Coordinate frames of the robot's links, from `link_frames`."""
    description: str
    """Text of the robot's URDF file; empty if the robot has no URDF file."""
    dt: float
    """Time between two rows of an episode (control period), s."""

    @property
    def slices(self) -> dict[str, slice]:
        """Name of a reading -> slice of its columns in a row."""
        ends = np.cumsum(list(self.widths.values())).tolist()
        return {name: slice(end - width, end) for end, (name, width) in zip(ends, self.widths.items(), strict=True)}
