"""Getting up from any pose: a sequence of key poses, chosen by which way gravity points.

Lying, the robot gathers its legs and waits so until it lies on its back, since a kick from the side seldom succeeds; if
it comes to rest on its side it rocks: it gathers the legs as if the other side were the lower. From its back it rolls
over the lower side by swinging all legs at once, and lands on bent legs. Upright it tucks them under its hips and
stands up. Whenever it is lost on the way it begins again, after a kick that failed over the other side.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats, Mask
from policies.behaviour.motion import Motion, interpolate_toward
from policies.behaviour.transitions import POSE_TOLERANCE
from policies.memory import per_robot
from quad_env import OBSERVATION
from quad_env.robots.robot import Robot


class Phase(IntEnum):
    """Where a robot is in getting up."""

    SETTLE = 0
    """Joints damped."""
    GATHER = 1
    ROCK = 2
    """Still gathered, neither on its back nor upright, or after a kick that failed."""
    KICK = 3
    LAND = 4
    TUCK = 5
    STAND = 6


Legs = tuple[float, float, float, float, float, float]
"""Hip (positive outward), thigh and calf of a front leg, then of a hind leg, rad."""


@dataclass(frozen=True)
class RecoveryParameters:
    """The outcome of a search; a leg is lower if it is on the side that gravity pulls to."""

    gather_lower: Legs = (-0.4307, -0.9243, -1.5535, -0.161, -1.3987, -0.0802)
    gather_upper: Legs = (-0.1346, -1.0368, -1.4206, 0.18, -0.6586, -2.0105)
    kick_lower: Legs = (-0.4899, 0.9008, -1.7529, 0.4338, 0.2844, -1.7472)
    kick_upper: Legs = (-0.4789, 1.0582, -0.883, -0.3417, 1.0035, -2.3897)
    land: Legs = (0.3966, 0.728, -1.6909, 0.4828, 1.075, -1.9985)
    tuck: Legs = (0.3108, 1.2458, -2.3518, 0.3277, 1.3659, -2.3119)
    gather_blend: float = 0.204
    """Blend from the pose before, s; the other blends too."""
    land_blend: float = 0.1454
    tuck_blend: float = 0.3537
    stand_blend: float = 0.3717
    gather_time: float = 0.3422
    """In the phase, s; the other times too."""
    kick_time: float = 0.75
    """Longest time in the phase, s."""
    land_time: float = 0.2227
    tuck_time: float = 0.4128
    righted: float = 0.4178
    """Cosine of the tilt at which a kick has succeeded."""
    lost: float = 0.2974
    """Cosine of the tilt at which landing, tucking or standing has failed."""
    caught: float = 7.0765
    """Turning speed below which a kicked robot is ready to land, rad/s."""
    kick_minimum: float = 0.0507
    """s of kicking before it may have succeeded."""
    upright: float = 0.5215
    """Cosine of the tilt up to which no kick is needed."""


SETTLE_TIME, SETTLE_MINIMUM = 0.1, 0.05
"""Longest and shortest wait for a fallen robot to lie still, s."""
SETTLED_TURNING = 2.5
"""Turning speed below which it lies still, rad/s."""
ROCK_BLEND, ROCK_TIME = 0.05, 0.3
"""s"""
FLAT = -0.95
"""Cosine of the tilt beyond which it lies on its back."""
KICK_BLEND = 0.01
"""A kick is as fast as the servos are, s."""
STRANDED_AFTER, STRANDED_TURNING = 0.4, 0.5
"""A kicked robot that turns no faster than that, rad/s, after that time, s, has not got over."""
STAND_TIME = 0.75
"""A robot that leans after that time begins again, one whose legs are not in the home pose tucks them again, s."""
LEVEL = 0.9
"""Cosine of the tilt up to which it does not lean."""


class Recovery(Motion):
    """Getting up from any pose."""

    phase: NDArray[np.int64] = per_robot(0)
    """`Phase` of each robot, (n,)."""
    _left_lower: NDArray[np.int64] = per_robot(0)
    """Whether its left side is the lower one."""

    def __init__(self, robot: Robot, control_period: float) -> None:
        super().__init__(robot, control_period)
        self._p = p = RecoveryParameters()
        self._poses = key_poses(robot, p)
        self._blends = np.array(
            [0.0, p.gather_blend, ROCK_BLEND, KICK_BLEND, p.land_blend, p.tuck_blend, p.stand_blend]
        )
        self._times = np.array(
            [SETTLE_TIME, p.gather_time, ROCK_TIME, p.kick_time, p.land_time, p.tuck_time, STAND_TIME]
        )

    def start(self, mask: Mask, joints: Floats) -> None:
        """Begin with those robots' joints."""
        super().start(mask, joints)
        self.phase[mask] = Phase.SETTLE

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Targets of those robots."""
        self._ticks[rows] += 1
        before = self.phase[rows]
        phase = self._next(rows, observation)
        self._ticks[rows] = np.where(phase != before, 0, self._ticks[rows])
        self.phase[rows] = phase
        elapsed = self._ticks[rows] * self._period
        goal = self._poses[phase, self._left_lower[rows]]
        target = interpolate_toward(self._target[rows], goal, elapsed, self._blends[phase], self._period)
        target = np.where((phase == Phase.SETTLE)[:, None], joints, target)
        self._target[rows] = target
        return target

    def _next(self, rows: NDArray[np.intp], observation: Floats) -> NDArray[np.int64]:
        """Phase of each of those robots from now on, (k,)."""
        p, phase, time = self._p, self.phase[rows], self._ticks[rows] * self._period
        gravity = observation[:, OBSERVATION["projected_gravity"]]
        up = -gravity[:, 2]
        turning = np.abs(observation[:, OBSERVATION["angular_velocity"]]).max(axis=1)
        over = time >= self._times[phase]
        settled = (phase == Phase.SETTLE) & (over | ((turning < SETTLED_TURNING) & (time >= SETTLE_MINIMUM)))
        gathered, rocked = over & (phase == Phase.GATHER), over & (phase == Phase.ROCK)
        kicked = (phase == Phase.KICK) & (time > p.kick_minimum)
        righted = kicked & (up > p.righted) & (turning < p.caught)
        stranded = kicked & ~righted & (over | ((turning < STRANDED_TURNING) & (time > STRANDED_AFTER)))
        misplaced = np.abs(observation[:, OBSERVATION["joint_position"]]).max(axis=1) > POSE_TOLERANCE
        stood = over & (phase == Phase.STAND)
        lost = ((phase >= Phase.LAND) & (up < p.lost)) | (stood & (up < LEVEL))
        flat, upright = up < FLAT, (settled | gathered | rocked) & (up > p.upright)
        following = phase.copy()
        following[stranded | gathered] = Phase.ROCK
        following[gathered & flat] = Phase.KICK
        following[righted] = Phase.LAND
        following[over & (phase == Phase.TUCK)] = Phase.STAND
        following[settled | rocked | lost] = Phase.GATHER
        following[upright | (~lost & ((stood & misplaced) | (over & (phase == Phase.LAND))))] = Phase.TUCK
        mirrored = (rocked & flat) | (gathered & (following == Phase.ROCK) & (turning < STRANDED_TURNING))
        anew, side = (following == Phase.GATHER) & (phase != Phase.GATHER), self._left_lower[rows]
        self._left_lower[rows] = np.where(mirrored, 1 - side, np.where(anew, gravity[:, 1] >= 0.0, side))
        return following


def key_poses(robot: Robot, p: RecoveryParameters) -> Floats:
    """Joint angles of each phase, SETTLE's meaningless, with the right and the left side lower, (7, 2, 12), rad."""
    home = tuple(robot.home_pose.reshape(-1, 2, 3)[:, 0].ravel())  # of a front and of a hind leg
    lower = (home, p.gather_lower, p.gather_lower, p.kick_lower, p.land, p.tuck, home)
    upper = (home, p.gather_upper, p.gather_upper, p.kick_upper, p.land, p.tuck, home)
    by_height = np.array([upper, lower]).reshape(2, len(Phase), 2, 3)  # upper or lower, phase, front or hind, joint
    poses = np.empty((len(Phase), 2, len(robot.leg_names), 3))
    for left_lower in (0, 1):
        for leg, side in enumerate(robot.side):
            lower_leg = left_lower if side > 0 else 1 - left_lower
            poses[:, left_lower, leg] = by_height[lower_leg, :, leg // 2] * (side, 1.0, 1.0)
    return np.clip(poses.reshape(len(Phase), 2, -1), robot.joint_lower, robot.joint_upper)
