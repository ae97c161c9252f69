"""Class with the parameters of a quadruped with three joints per leg, and the parameters of SimpleQuad.

The base frame has x forward, y left, z up, and the origin of the trunk's body (SimpleQuad: the trunk's centre). Joint
angles are zero with the legs straight down; hips turn about +x (abduction), thighs and calves about +y. Lengths are in
m, angles in rad, masses in kg.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from quad_env.robots.feet import depths_below_centre
from quad_env.robots.model_file import UserModel, read
from quad_env.robots.shapes import Floats as Floats

T = TypeVar("T")
LEVEL_TOLERANCE = 2e-4
"""Largest height difference between the feet in the home pose at which the feet count as level, m."""


@dataclass(frozen=True, eq=False)
class RobotParameters:
    """Parameters of a robot, such as names, lengths and servo gains; made by `load_parameters`.

    Arrays with one row per leg are in the order of `leg_names`. Arrays with one number per joint are in the order of
    `joint_names`, three joints per leg.
    """

    name: str
    """Name of the robot in `quad_env.ROBOTS` and in reports."""
    mjcf: Path
    """Path of the robot's model file, an MJCF; the file of a user's model can also be a URDF."""
    urdf: Path | None
    """Path of SimpleQuad's URDF; None for other robots."""
    leg_names: tuple[str, ...]
    """Names of the legs (f: front, h: hind, l: left, r: right), in the order of the model.

    SimpleQuad's order is fl, fr, hl, hr.
    """
    joint_names: tuple[str, ...]
    """Names of the hip, thigh and calf joints as in the model file, in the order of `leg_names`."""
    home_pose: Floats
    """Joint angles of the standing pose, zero with the legs straight down, (12,), rad."""
    hip_positions: Floats
    """Positions of the hip joints, base frame, (4, 3), m."""
    hip_offset: float
    """Lateral distance from the hip joint to the plane in which the leg bends, positive outward, m."""
    thigh_length: float
    """Distance from the thigh joint to the calf joint, m."""
    calf_length: float
    """Distance from the calf joint to the centre of the foot, m."""
    foot_radius: float
    """Radius of the ball that models each foot in the kinematics, m; `foot_points` describes the exact shape."""
    thigh_radius: float
    """Radius of the thigh about the line from the thigh joint to the calf joint, m.

    The radius is the distance from this line to the farthest point of the thigh's colliding shape, rounded up.
    """
    trunk_size: Floats
    """Full lengths of the trunk's bounding box along x, y and z, base frame, (3,), m."""
    servo_stiffness: Floats
    """Gain of the joint servos on the angle error, N·m/rad; stored as (12,).

    The constructor also accepts one number for all joints.
    """
    servo_damping: Floats
    """Gain of the joint servos on the joint speed, N·m·s/rad; stored as (12,).

    The constructor also accepts one number for all joints.
    """
    rated_torque: float
    """Largest torque of every joint, N·m; the servos limit their torques to ± this value."""
    rated_speed: float
    """Rated speed of every joint, rad/s. Reports contain this number; the ideal actuator does not enforce it."""
    knee_direction: Floats = field(default_factory=lambda: np.array(-1.0))
    """Sign of each calf's angle when the knee is bent: -1 for backward, 1 for forward; stored as (4,).

    The constructor also accepts one number for all legs.
    """
    trunk_centre: Floats = field(default_factory=lambda: np.zeros(3))
    """Centre of the trunk's bounding box, base frame, (3,), m."""
    foot_points: Floats = field(default_factory=lambda: np.zeros((4, 0, 3)))
    """Points that describe the shape of each foot, relative to its centre, (4, k, 3), m.

    The points are in the base frame with the legs straight down. k is the number of points per foot. The foot is the
    convex hull of balls about these points, with the radii in `foot_radii`. k is 0 if each foot is one ball.
    """
    foot_radii: Floats = field(default_factory=lambda: np.zeros((4, 0)))
    """Radius of the ball about each of the k points per foot in `foot_points`, (4, k), m."""
    stiff_servo: Floats = field(default_factory=lambda: np.array((300.0, 10.0)))
    """Servo gains for controllers that need stiff servos: N·m/rad and N·m·s/rad; stored as (2, 12).

    The first row is the stiffness, the second row the damping. The gains are SimpleQuad's, scaled by mass and leg
    length, or the gains in the user's TOML. The constructor also accepts two numbers for all joints.
    """
    servo_fixed: bool = False
    """True if every controller has to use `servo_stiffness` and `servo_damping`, see `Robot.with_servo`.

    Otherwise a controller that needs stiff servos gets the gains `stiff_servo`.
    """
    locked_joints: tuple[str, ...] = ()
    """Names of the model's joints that belong to no leg, such as joints of an arm; they cannot move."""
    imported: bool = False
    """True if the robot is not SimpleQuad, so that its model has to be attached to SimpleQuad's scene."""
    source: Path | None = None
    """User's MJCF, URDF or TOML file from which the robot was read; None for a robot of the registry."""

    @property
    def keeps_contact(self) -> bool:
        """True if the robot's geoms keep the contact parameters of its model, False if they get SimpleQuad's.

        The imported robots in `quad_env.ROBOTS` keep the parameters, because results with these robots have been
        published.
        """
        return self.imported and self.source is None

    @property
    def held(self) -> tuple[str, ...]:
        """Deprecated name of `locked_joints`."""
        return self.locked_joints

    def __post_init__(self) -> None:
        for name in ("home_pose", "hip_positions", "trunk_size", "trunk_centre", "foot_points", "foot_radii"):
            object.__setattr__(self, name, read_only_array(getattr(self, name)))
        counts = {"knee_direction": len(self.leg_names)}
        counts |= dict.fromkeys(("servo_stiffness", "servo_damping"), len(self.joint_names))
        for name, count in counts.items():
            object.__setattr__(self, name, read_only_array(np.broadcast_to(getattr(self, name), count)))
        stiff = np.reshape(self.stiff_servo, (2, -1))
        object.__setattr__(self, "stiff_servo", read_only_array(np.broadcast_to(stiff, (2, len(self.joint_names)))))

    @property
    def by_name(self) -> dict[str, Any]:
        """Dictionary: name of a field of `RobotParameters` -> the field's value."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @cached_property
    def user_model(self) -> UserModel:
        """Compiled model of an imported robot, from which these parameters were inferred.

        The file is read again if the model is not in memory; an invalid file then raises ModelError.
        """
        return read(self.mjcf)

    def replace(self, **changes: Any) -> Self:
        """Return a copy of the parameters in which the fields named in `changes` have the given values.

        The file of the user's model is not read again.
        """
        copy = dataclasses.replace(self, **changes)
        if "user_model" in vars(self):
            vars(copy)["user_model"] = self.user_model
        return copy

    @property
    def num_joints(self) -> int:
        """Number of joints of all four legs, 12."""
        return len(self.joint_names)

    @property
    def servo(self) -> str:
        """Text with the servo gains and their units, such as `25 N·m/rad and 0.5 N·m·s/rad`."""
        return f"{format_range(self.servo_stiffness)} N·m/rad and {format_range(self.servo_damping)} N·m·s/rad"

    @cached_property
    def side(self) -> Floats:
        """Side of each leg, which is the sign of its y coordinate: +1 for left legs, -1 for right legs, (4,)."""
        return read_only_array(np.sign(self.hip_positions[:, 1]))

    def in_leg_order(self, corners: Sequence[T]) -> tuple[T, ...]:
        """Sort four values, one for each corner of the trunk, into the order of the robot's legs.

        Args:
            corners: Values for the front left, front right, hind left and hind right leg, in this order.

        Returns:
            The same values in the order of `leg_names`.
        """
        ahead, left = np.sign(self.hip_positions[:, :2]).T
        return tuple(corners[2 * int(x < 0) + int(y < 0)] for x, y in zip(ahead, left, strict=True))

    @property
    def leg_length(self) -> float:
        """Length of a leg: distance from the thigh joint to the centre of the foot with the knee straight, m."""
        return self.thigh_length + self.calf_length

    @cached_property
    def home_hip_height(self) -> float:
        """Height of the hip joints above the centres of the feet in the home pose, mean over the legs, m."""
        heights = self.hip_heights
        return float(heights[0] if np.ptp(heights) < LEVEL_TOLERANCE else heights.mean())

    @cached_property
    def hip_heights(self) -> Floats:
        """Height of each hip joint above the centre of its foot in the home pose, (4,), m."""
        hip, thigh, calf = self.home_pose.reshape(-1, 3).T
        bent = self.thigh_length * np.cos(thigh) + self.calf_length * np.cos(thigh + calf)
        heights: Floats = np.cos(hip) * bent - np.sin(hip) * self.side * self.hip_offset
        return heights

    @cached_property
    def home_height(self) -> float:
        """Height of the base frame's origin above flat ground when the robot stands in the home pose, m.

        The trunk is level.
        """
        parts = (self.hip_heights, self._foot_depths, self.hip_positions[:, 2], self.leg_heights)
        if max(np.ptp(part) for part in parts) < LEVEL_TOLERANCE:
            return self.home_hip_height + self.foot_depth - self.hip_rise
        return float(self.leg_heights.max())

    @property
    def leg_heights(self) -> Floats:
        """Height of the base frame's origin above each foot's sole in the home pose with a level trunk, (4,), m."""
        return self.hip_heights + self._foot_depths - self.hip_positions[:, 2]

    @cached_property
    def hip_rise(self) -> float:
        """Height of the hip joints above the base frame's origin with a level trunk, mean over the legs, m."""
        return float(self.hip_positions[:, 2].mean())

    @cached_property
    def foot_depth(self) -> float:
        """Largest depth of a foot's lowest point below its centre in the home pose, m.

        This is the foot radius if all feet are balls.
        """
        return float(self._foot_depths.max())

    @cached_property
    def _foot_depths(self) -> Floats:
        """Depth of the lowest point of each foot below the foot's centre in the home pose, (4,), m."""
        if not self.foot_points.size:
            return np.full(len(self.leg_names), self.foot_radius)
        up = np.array((0.0, 0.0, 1.0))
        return depths_below_centre(self.foot_points, self.foot_radii, self.home_pose.reshape(-1, 3), up)


def format_range(values: Floats) -> str:
    """Format the smallest and the largest of some numbers as `25 to 40`, or as `25` if they are equal."""
    return " to ".join(f"{value:.3g}" for value in sorted({float(values.min()), float(values.max())}))


def read_only_array(values: ArrayLike) -> Floats:
    """Return a copy of `values` as an array of floats that cannot be written to."""
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


_MJCF = Path(__file__).parent / "simple_quad" / "simple_quad.xml"
_LEGS = ("fl", "fr", "hl", "hr")
SIMPLE_QUAD_PARAMETERS = RobotParameters(
    name="simple_quad",
    mjcf=_MJCF,
    urdf=_MJCF.with_suffix(".urdf"),
    leg_names=_LEGS,
    joint_names=tuple(f"{leg}_{link}_joint" for leg in _LEGS for link in ("hip", "thigh", "calf")),
    home_pose=np.tile((0.0, 0.5, -1.0), 4),
    hip_positions=np.array(((0.25, 0.15, 0.0), (0.25, -0.15, 0.0), (-0.25, 0.15, 0.0), (-0.25, -0.15, 0.0))),
    hip_offset=0.1,
    thigh_length=0.3,
    calf_length=0.3,
    foot_radius=0.02,
    thigh_radius=0.03,
    trunk_size=np.array((0.6, 0.3, 0.1)),
    servo_stiffness=np.array(300.0),
    servo_damping=np.array(10.0),
    rated_torque=100.0,
    rated_speed=10.0,
)
"""Parameters of SimpleQuad, equal to the values in its model file.

If the model of an imported robot does not define servo gains, rated speed or home pose, these are scaled from
SimpleQuad's values.
"""
REFERENCE_MASS = 14.2
"""Mass of SimpleQuad, kg. The servo gains of another robot are scaled by the ratio of its mass to this mass."""
