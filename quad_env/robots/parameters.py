"""What is known of a robot with four legs of three joints each, as numbers: lengths, home pose, servos, names.

Frames: base frame x forward, y left, z up, origin at the trunk's centre. Joint angles are zero with the legs hanging
straight down; hips turn about +x (abduction), thighs and calves about +y. Lengths in m, angles in rad, masses in kg.
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
"""m. Largest height difference of the feet in the home pose that counts as a manufacturing tolerance."""


@dataclass(frozen=True, eq=False)
class RobotParameters:
    """Figures of a robot; legs are in the order of `leg_names`, joints in that of `joint_names`, three a leg."""

    name: str
    mjcf: Path
    urdf: Path | None
    leg_names: tuple[str, ...]
    """In the order of the model; SimpleQuad's has front before hind, left before right."""
    joint_names: tuple[str, ...]
    """Hip, thigh and calf of each leg, as in the MJCF."""
    home_pose: Floats
    """Standing pose, shape (12,), rad."""
    hip_positions: Floats
    """Hip joints in the base frame, shape (4, 3), m."""
    hip_offset: float
    """From the hip joint outboard to the thigh joint, m."""
    thigh_length: float
    """From the thigh joint to the calf joint, m."""
    calf_length: float
    """From the calf joint to the centre of the foot, m."""
    foot_radius: float
    """Radius of the ball that is the foot, or stands for one of another shape, see `feet`, m."""
    thigh_radius: float
    """From an end of a thigh to the farthest point of its shape there, rounded up, m."""
    trunk_size: Floats
    """Full lengths of the trunk's box along x, y, z, shape (3,), m."""
    servo_stiffness: Floats
    """Gain of the joint servos on the angle, shape (12,), N·m/rad; given as one number where all are alike."""
    servo_damping: Floats
    """Gain of the joint servos on the speed, shape (12,), N·m·s/rad; given as one number where all are alike."""
    rated_torque: float
    """Largest joint torque, N·m."""
    rated_speed: float
    """Rated joint speed, rad/s; reported, not enforced, with the ideal actuator."""
    knee_direction: Floats = field(default_factory=lambda: np.array(-1.0))
    """Sign of each calf's angle when the knee is bent, shape (4,); given as one number where all bend alike."""
    trunk_centre: Floats = field(default_factory=lambda: np.zeros(3))
    """Centre of the trunk's box in the base frame, shape (3,), m."""
    foot_points: Floats = field(default_factory=lambda: np.zeros((4, 0, 3)))
    """Points from the centre of each foot, base frame with the legs straight down, (4, k, 3), m; empty if all feet are
    balls. The foot is their hull, each grown by its radius.
    """
    foot_radii: Floats = field(default_factory=lambda: np.zeros((4, 0)))
    """Radii about the points, (4, k), m."""
    stiff_servo: Floats = field(default_factory=lambda: np.array((300.0, 10.0)))
    """Stiffness and damping, shape (2, 12), N·m/rad and N·m·s/rad, for controllers that need stiff servos: SimpleQuad's
    scaled by mass and leg length, or those of a user's TOML; given as two numbers where all joints are alike."""
    servo_fixed: bool = False
    """Whether every controller has to use `servo_stiffness` and `servo_damping`, see `Robot.with_servo`."""
    locked_joints: tuple[str, ...] = ()
    """Joints of the model that belong to no leg and are held at their reference, see `locked_joints`."""
    imported: bool = False
    """Whether the MJCF is a user's, to be put on our ground (`quad_env.robots.scene`)."""
    source: Path | None = None
    """File of a user's that it was read from, its MJCF, URDF or a TOML; None of a robot that has a name here."""

    @property
    def keeps_contact(self) -> bool:
        """Return whether geoms keep the model's contact parameters: true for named robots with published results."""
        return self.imported and self.source is None

    @property
    def held(self) -> tuple[str, ...]:
        """Deprecated name of `locked_joints`."""
        return self.locked_joints

    def __post_init__(self) -> None:
        for name in ("home_pose", "hip_positions", "trunk_size", "trunk_centre", "foot_points", "foot_radii"):
            object.__setattr__(self, name, read_only_array(getattr(self, name)))
        spread = {"knee_direction": len(self.leg_names)}
        spread |= dict.fromkeys(("servo_stiffness", "servo_damping"), len(self.joint_names))
        for name, count in spread.items():
            object.__setattr__(self, name, read_only_array(np.broadcast_to(getattr(self, name), count)))
        stiff = np.reshape(self.stiff_servo, (2, -1))
        object.__setattr__(self, "stiff_servo", read_only_array(np.broadcast_to(stiff, (2, len(self.joint_names)))))

    @property
    def by_name(self) -> dict[str, Any]:
        """The figures by the names of the fields."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @cached_property
    def user_model(self) -> UserModel:
        """The model of an imported robot, as it was read for these parameters. Raises ModelError."""
        return read(self.mjcf)

    def replace(self, **changes: Any) -> Self:
        """Return a copy with other values of the fields named in `changes`; it keeps the user's model as read."""
        copy = dataclasses.replace(self, **changes)
        if "user_model" in vars(self):
            vars(copy)["user_model"] = self.user_model
        return copy

    @property
    def num_joints(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def servo(self) -> str:
        """Gains of the servos, as text."""
        stiffness, damping = (
            " to ".join(f"{gain:.3g}" for gain in sorted({float(gains.min()), float(gains.max())}))
            for gains in (self.servo_stiffness, self.servo_damping)
        )
        return f"{stiffness} N·m/rad and {damping} N·m·s/rad"

    @cached_property
    def side(self) -> Floats:
        """+1 for left legs, -1 for right legs, shape (4,)."""
        return read_only_array(np.sign(self.hip_positions[:, 1]))

    def in_leg_order(self, corners: Sequence[T]) -> tuple[T, ...]:
        """Values of the front left, front right, hind left and hind right leg, in the order of the legs."""
        before, left = (np.sign(self.hip_positions[:, axis]) for axis in (0, 1))
        return tuple(corners[2 * int(b < 0) + int(side < 0)] for b, side in zip(before, left, strict=True))

    @property
    def leg_length(self) -> float:
        """From the thigh joint to the centre of the foot with the knee straight, m."""
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
        """Height of the base frame's origin above flat ground in the level home pose, lowest foot in contact, m."""
        parts = self.hip_heights, self._foot_depths, self.hip_positions[:, 2], self.leg_heights
        if max(np.ptp(part) for part in parts) < LEVEL_TOLERANCE:
            return self.home_hip_height + self.foot_depth - self.hip_rise
        return float(self.leg_heights.max())

    @property
    def leg_heights(self) -> Floats:
        """Height of the level base frame's origin above the underside of each foot in the home pose, (4,), m."""
        return self.hip_heights + self._foot_depths - self.hip_positions[:, 2]

    @cached_property
    def hip_rise(self) -> float:
        """Hip joints above the origin of the base frame, mean over the legs, m."""
        return float(self.hip_positions[:, 2].mean())

    @cached_property
    def foot_depth(self) -> float:
        """Lowest point of a foot below its centre in the home pose, m: its radius where it is a ball."""
        return float(self._foot_depths.max())

    @cached_property
    def _foot_depths(self) -> Floats:
        """Depth of the lowest point of each foot below its centre in the home pose, (4,), m."""
        if not self.foot_points.size:
            return np.full(len(self.leg_names), self.foot_radius)
        up = np.array((0.0, 0.0, 1.0))
        return depths_below_centre(self.foot_points, self.foot_radii, self.home_pose.reshape(-1, 3), up)


def read_only_array(values: ArrayLike) -> Floats:
    """A copy of the values that cannot be written to."""
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
"""SimpleQuad's figures, those of its compiled model; other robots get from its proportions what their models lack."""
REFERENCE_MASS = 14.2
"""kg"""
