"""What a walking robot learns of its ground, from its feet, and of its motors, from how its joints follow."""

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.legs.ground_plane import above, carried, fitted, renewed
from policies.legs.level_frame import Senses, Vector, length
from policies.legs.memory import Memory, taken_in
from quad_env.columns import total
from quad_env.robots.robot import Robot

EVEN = 0.02
"""Unevenness, m, that a trot on a plane shows too."""
LARGEST_ROUGHNESS = 0.15
"""m"""
ROUGHNESS_MEMORY = 2.0
"""Time constant with which rough ground is forgotten, s."""
WORST_MEMORY = 20.0
"""Time constant with which the roughest ground is forgotten, s."""
MEMORY_TIME = 0.3
"""Time constant of both movements, s: about two strides."""
AT_FIRST = 10.0
"""Speed of each joint at the start, both commanded and made, rad/s: nothing is known yet."""


class GroundSense:
    """Footprints and what they say; all in the level frame, robots (n,), legs (4, n)."""

    def __init__(self, robot: Robot, control_period: float, plane_filter: float) -> None:
        self._period = control_period
        self._share = taken_in(control_period, plane_filter)
        self._half_base = float(robot.hip_positions[:, 0].max())  # turns slope into height under a foot
        robots = dict.fromkeys(("known", "height", "forward", "lateral", "roughness", "worst"), 0.0)
        self.memory = Memory(**robots, x=np.zeros(4), y=np.zeros(4), z=np.zeros(4))

    def update(self, senses: Senses, standing: NDArray[np.bool_], undisturbed: NDArray[np.bool_]) -> None:
        """One control period later, with the standing legs, (4, n), on the ground; at first all are.

        The unevenness under a disturbed robot, (n,), is its own tumbling. The slope that a robot finds at
        its start is no change of slope.
        """
        memory, share = self.memory, self._share
        prints = carried(self._prints, senses.velocity, senses.yaw_rate, self._period)
        unknown = memory["known"] == 0.0
        prints = renewed(prints, senses.feet, standing | unknown)
        memory["known"] = np.ones_like(memory["known"])
        memory["x"], memory["y"], memory["z"] = prints
        plane = fitted(prints)
        memory["height"], forward, lateral = plane
        former_forward = np.where(unknown, forward, memory["forward"])
        former_lateral = np.where(unknown, lateral, memory["lateral"])
        change_forward, change_lateral = forward - former_forward, lateral - former_lateral
        memory["forward"] = former_forward + share * change_forward
        memory["lateral"] = former_lateral + share * change_lateral
        residual = above(plane, prints)
        uneven = np.sqrt(0.25 * total(residual * residual)) + self._half_base * length(change_forward, change_lateral)
        rise = np.clip(uneven - EVEN, 0.0, LARGEST_ROUGHNESS) - memory["roughness"]
        memory["roughness"] = (
            memory["roughness"] + np.where(rise > 0.0, share * undisturbed, self._period / ROUGHNESS_MEMORY) * rise
        )
        memory["worst"] = np.maximum((1.0 - self._period / WORST_MEMORY) * memory["worst"], memory["roughness"])

    @property
    def height(self) -> Floats:
        """Height of the ground below the trunk's centre, relative to it, m: negative; (n,)."""
        return self.memory["height"]

    @property
    def slope(self) -> tuple[Floats, Floats]:
        """Rise per metre forward and to the left, smoothed, (n,) each."""
        return self.memory["forward"], self.memory["lateral"]

    @property
    def steepness(self) -> Floats:
        """Size of the slope, (n,)."""
        return length(*self.slope)

    @property
    def roughness(self) -> Floats:
        """How far footprints lie off a steady plane, m; soon learnt, slowly forgotten; (n,)."""
        return self.memory["roughness"]

    @property
    def worst_roughness(self) -> Floats:
        """The largest roughness met, more slowly forgotten, m, (n,)."""
        return self.memory["worst"]

    @property
    def unevenness(self) -> Floats:
        """Height of each footprint above the plane with the smoothed slope, m, (4, n)."""
        return above((self.height, *self.slope), self._prints)

    @property
    def _prints(self) -> Vector:
        return self.memory["x"], self.memory["y"], self.memory["z"]


class Following:
    """The joints' movement per that of their targets, robots (n,), over the last strides."""

    def __init__(self, joints: int, control_period: float) -> None:
        self._share = taken_in(control_period, MEMORY_TIME)
        first = AT_FIRST * control_period * joints
        # The names of the movements are part of the digest by which results know the policy.
        self.memory = Memory(told=first, made=first, targets=np.zeros(joints), joints=np.zeros(joints))

    def read(self, joints: Floats, walking: Floats) -> None:
        """The joints' places, (joints, n), rad, one control period after `command`; the robot's share of walking
        weighs them, `walking`, 0 … 1, (n,)."""
        self._move("made", "joints", joints, walking)

    def command(self, targets: Floats, walking: Floats) -> None:
        """The new targets, (joints, n), rad, from the pose that all joints start in, as their places are."""
        self._move("told", "targets", targets, walking)

    @property
    def ratio(self) -> Floats:
        """Movement made per movement commanded, (n,): 1 where all joints follow their targets, 0 where none moves."""
        return self.memory["made"] / np.maximum(self.memory["told"], 1e-9)

    def _move(self, movement: str, places: str, now: Floats, walking: Floats) -> None:
        memory = self.memory
        moved = total(np.abs(now - memory[places]))  # NumPy's sum has another order for one robot
        memory[movement] = memory[movement] + self._share * walking * (moved - memory[movement])
        memory[places] = now
