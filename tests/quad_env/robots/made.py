"""Quadrupeds as MJCF text, with parts that tests change."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

HEAD = """<mujoco model="made"><compiler angle="radian" autolimits="true"/>
<default><geom friction="0.9"/></default><worldbody><geom type="plane" size="5 5 1"/>{obstacle}
<body name="torso" pos="0 0 0.5">{free}<inertial pos="0 0 0" mass="{mass}" diaginertia="0.05 0.1 0.1"/>
<geom type="box" size="{trunk}"/>"""
ARM = """<frame pos="0.1 0 0.05" euler="0 0 0.3"><body name="upper_arm" euler="0.2 0 0">
<joint name="shoulder" axis="0 0 1"/><geom type="capsule" fromto="0 0 0 0.1 0 0.05" size="0.03" mass="0.2"/>
<body name="lower_arm" pos="0.1 0 0.05"><joint name="elbow" axis="0 1 0" pos="0.02 0 0"/>
<geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.02" mass="0.1"/><body name="gripper" pos="0.12 0 0">
<joint name="finger" type="slide" axis="1 0 0"/><geom size="0.01" mass="0.05"/></body></body></body></frame>"""
WHEEL = """<body pos="{x} 0 {z}"><joint axis="0 -1 0"/>
<geom type="cylinder" size="0.05 0.015" euler="1.5707963267948966 0 0" mass="0.1"/></body>"""
ANKLE = '<body pos="{x} 0 {z}"><joint axis="0 1 0"/><geom size="0.02" pos="0 0 -0.03"/></body>'
PLACES = {"fl": (1, 1), "fr": (1, -1), "hl": (-1, 1), "hr": (-1, -1), "ml": (0, 1)}


@dataclass
class Made:
    """Quadruped; lengths in m, angles in rad."""

    order: tuple[str, ...] = ("fr", "fl", "hr", "hl")
    names: dict[str, str] = field(default_factory=lambda: dict(zip(PLACES, "ABCDE", strict=True)))
    signs: tuple[int, int, int] = (1, 1, 1)
    zeros: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Joint angles of the robot convention at the zero of the model."""
    knees: tuple[int, int] = (-1, -1)
    """Signs of the knee bends of the front and of the hind legs."""
    mass: float = 6.0
    lengths: tuple[float, float, float] = (0.08, 0.2, 0.22)
    """Lengths of hip offset, thigh and calf."""
    aside: tuple[float, float] = (0.0, 0.0)
    """Forward offset of the thigh joint, and outward offset of the knee; the hip offset is their sum."""
    free: str = "<freejoint/>"
    foot: str = '<geom type="sphere" size="0.025" pos="{x} 0 {z}"/>'
    limits: tuple[tuple[float, float], ...] | None = None
    torque: float | None = 30.0
    extra: str = ""
    obstacle: str = ""
    hinges: int = 3

    def xml(self) -> str:
        """Return the MJCF text."""
        legs = "".join(self._leg(leg) for leg in self.order)
        head = HEAD.format(free=self.free, mass=self.mass, trunk="0.22 0.1 0.05", obstacle=self.obstacle)
        joints = [self._joint(leg, number) for leg in self.order for number in range(self.hinges)]
        limit = "" if self.torque is None else f'ctrlrange="-{self.torque} {self.torque}"'
        motors = "".join(f'<motor joint="{joint}" {limit}/>' for joint in joints)
        return f"{head}{legs}{self.extra}</body></worldbody><actuator>{motors}</actuator></mujoco>"

    def write(self, folder: Path, name: str = "made.xml") -> Path:
        """Write the MJCF file and return its path."""
        path = folder / name
        path.write_text(self.xml(), encoding="utf-8")
        return path

    def _joint(self, leg: str, number: int) -> str:
        return f"{self.names[leg]}{number}"

    def _range(self, leg: str, number: int) -> str:
        """Return the range attribute of a joint in the convention of the model."""
        knee = self.knees[leg[0] == "h"]
        wide = ((-0.8, 0.8), (-1.6, 1.6), (-2.5, -0.3) if knee < 0 else (0.3, 2.5))
        ends = (self.limits or wide)[number]
        low, high = sorted(self.signs[number] * (end - self.zeros[number]) for end in ends)
        return f'range="{low} {high}"' if self.limits != () else ""

    def _leg(self, leg: str) -> str:
        ahead, left = PLACES[leg]
        (offset, thigh, calf), (hip, upper, lower) = self.lengths, self.zeros
        bodies = [
            ("1 0 0", (0.2 * ahead, 0.1 * left, 0.0), (np.cos(hip / 2), np.sin(hip / 2), 0.0, 0.0)),
            ("0 1 0", (self.aside[0], (offset - self.aside[1]) * left, 0.0), (1.0, 0.0, 0.0, 0.0)),
            ("0 1 0", (-thigh * np.sin(upper), self.aside[1] * left, -thigh * np.cos(upper)), (1.0, 0.0, 0.0, 0.0)),
        ]
        text = ""
        for number, (axis, place, quaternion) in enumerate(bodies[: self.hinges]):
            axis = " ".join(str(self.signs[number] * int(part)) for part in axis.split())
            text += (
                f'<body pos="{_text(place)}" quat="{_text(quaternion)}">'
                f'<inertial pos="0 0 0" mass="0.4" diaginertia="0.002 0.002 0.002"/>'
                f'<joint name="{self._joint(leg, number)}" axis="{axis}" armature="0.01" {self._range(leg, number)}/>'
            )
        shin = upper + lower
        foot = self.foot.format(x=-calf * np.sin(shin), z=-calf * np.cos(shin))
        return text + foot + self.hinges * "</body>"


def _text(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(value)) for value in values)
