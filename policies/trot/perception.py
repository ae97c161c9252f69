"""What a walking robot learns of its ground, from its feet, and of its motors, from how its joints follow."""

import numpy as np
from numpy.typing import NDArray

from policies.gait_cycle import Floats
from policies.legs.ground_plane import above, carried, fitted
from policies.legs.level_frame import Senses, length
from policies.memory import Memory, per_robot, taken_in
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


class GroundSense(Memory):
    """Footprints and what they say; all in the level frame, robots (n,), legs (4, n)."""

    height: Floats = per_robot(0.0)
    """Height of the ground below the trunk's centre, relative to it, m: negative; (n,)."""
    slope: Floats = per_robot(np.zeros(2), axis=1)
    """Rise per metre forward and to the left, smoothed, (2, n)."""
    roughness: Floats = per_robot(0.0)
    """How far footprints lie off a steady plane, m; soon learnt, slowly forgotten; (n,)."""
    worst_roughness: Floats = per_robot(0.0)
    """The largest roughness met, more slowly forgotten, m, (n,)."""
    _prints: Floats = per_robot(np.zeros((3, 4)), axis=2)
    _unknown: NDArray[np.bool_] = per_robot(True)

    def __init__(self, robot: Robot, control_period: float, plane_filter: float) -> None:
        self._period = control_period
        self._share = taken_in(control_period, plane_filter)
        self._half_base = float(robot.hip_positions[:, 0].max())  # turns slope into height under a foot

    def update(self, senses: Senses, standing: NDArray[np.bool_], undisturbed: NDArray[np.bool_]) -> None:
        """One control period later, with the standing legs, (4, n), on the ground; at first all are.

        The unevenness under a disturbed robot, (n,), is its own tumbling. The slope that a robot finds at
        its start is no change of slope.
        """
        share, period = self._share, self._period
        former_prints = carried(self._prints, senses.velocity, senses.yaw_rate, period)
        self._prints = prints = np.where(standing | self._unknown, np.stack(senses.feet), former_prints)
        plane = fitted(prints)
        self.height, slope = plane[0], np.stack(plane[1:])
        former = np.where(self._unknown, slope, self.slope)
        self._unknown = np.zeros_like(self._unknown)
        change = slope - former
        self.slope = former + share * change
        residual = above(plane, prints)
        uneven = np.sqrt(0.25 * total(residual * residual)) + self._half_base * length(*change)
        rise = np.clip(uneven - EVEN, 0.0, LARGEST_ROUGHNESS) - self.roughness
        self.roughness = self.roughness + np.where(rise > 0.0, share * undisturbed, period / ROUGHNESS_MEMORY) * rise
        self.worst_roughness = np.maximum((1.0 - period / WORST_MEMORY) * self.worst_roughness, self.roughness)

    @property
    def steepness(self) -> Floats:
        """Size of the slope, (n,)."""
        return length(*self.slope)

    @property
    def unevenness(self) -> Floats:
        """Height of each footprint above the plane with the smoothed slope, m, (4, n)."""
        forward, lateral = self.slope
        return above((self.height, forward, lateral), self._prints)


class Following(Memory):
    """The joints' movement per that of their targets, robots (n,), over the last strides."""

    _movements: Floats = per_robot(lambda following: following._first, axis=1)
    """Of the targets and of the joints, (2, n)."""
    _places: Floats = per_robot(lambda following: np.zeros((2, following._count)), axis=2)
    """Of the targets and of the joints, (2, joints, n)."""

    def __init__(self, joints: int, control_period: float) -> None:
        self._share, self._count = taken_in(control_period, MEMORY_TIME), joints
        self._first = np.full(2, AT_FIRST * control_period * joints)

    def read(self, joints: Floats, walking: Floats) -> None:
        """The joints' places, (joints, n), rad, one control period after `command`; the robot's share of walking
        weighs them, `walking`, 0 … 1, (n,)."""
        self._move(1, joints, walking)

    def command(self, targets: Floats, walking: Floats) -> None:
        """The new targets, (joints, n), rad, from the pose that all joints start in, as their places are."""
        self._move(0, targets, walking)

    @property
    def ratio(self) -> Floats:
        """Movement made per movement commanded, (n,): 1 where all joints follow their targets, 0 where none moves."""
        ratio: Floats = self._movements[1] / np.maximum(self._movements[0], 1e-9)
        return ratio

    def _move(self, which: int, now: Floats, walking: Floats) -> None:
        moved = total(np.abs(now - self._places[which]))  # NumPy's sum has another order for one robot
        self._movements[which] += self._share * walking * (moved - self._movements[which])
        self._places[which] = now
