"""Recovery from any pose: a sequence of key poses that depends on the direction of gravity.

1. A robot on the ground gathers its legs and waits until it lies on its back, because a kick from the side rarely
   succeeds. If it comes to rest on its side, it rocks: it gathers the legs as if the other side were the lower one.
2. From its back the robot swings all legs at once, rolls over its lower side and lands on bent legs.
3. An upright robot tucks its legs under its hips and stands up.

A robot that fails on the way starts again. After a failed kick it rolls over the other side.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats, Mask
from policies.behaviour.motion import Floating, Motion, interpolate_toward
from policies.behaviour.transitions import POSE_TOLERANCE
from policies.memory import per_robot
from quad_env import OBSERVATION
from quad_env.robots.robot import Robot


class Phase(IntEnum):
    """Phase of the recovery."""

    SETTLE = 0
    """The joints are damped until the robot lies still."""
    GATHER = 1
    """The legs move to the gathered pose."""
    ROCK = 2
    """The legs stay gathered. The robot lies neither on its back nor upright, or a kick has failed."""
    KICK = 3
    """All legs swing, and the robot rolls over."""
    LAND = 4
    """The legs are bent for the landing."""
    TUCK = 5
    """The legs are tucked under the hips."""
    STAND = 6
    """The legs move to the home pose."""


Legs = tuple[float, float, float, float, float, float]
"""Angles of hip (positive outward), thigh and calf of a front leg, then the same of a hind leg, rad."""


@dataclass(frozen=True)
class RecoveryParameters:
    """Parameters of the recovery, found by a search.

    Fields with `lower` are for the legs on the side to which gravity points, fields with `upper` for the other side.
    """

    gather_lower: Legs = (-0.4307, -0.9243, -1.5535, -0.161, -1.3987, -0.0802)
    gather_upper: Legs = (-0.1346, -1.0368, -1.4206, 0.18, -0.6586, -2.0105)
    kick_lower: Legs = (-0.4899, 0.9008, -1.7529, 0.4338, 0.2844, -1.7472)
    kick_upper: Legs = (-0.4789, 1.0582, -0.883, -0.3417, 1.0035, -2.3897)
    land: Legs = (0.3966, 0.728, -1.6909, 0.4828, 1.075, -1.9985)
    tuck: Legs = (0.3108, 1.2458, -2.3518, 0.3277, 1.3659, -2.3119)
    gather_blend: float = 0.204
    """Duration of the blend from the last pose to the pose of the phase GATHER, s.

    The other fields `..._blend` are the same for their phases."""
    land_blend: float = 0.1454
    tuck_blend: float = 0.3537
    stand_blend: float = 0.3717
    gather_time: float = 0.3422
    """Duration of the phase GATHER, s; the other fields `..._time` are the same for their phases."""
    kick_time: float = 0.75
    """Longest duration of the phase KICK, s."""
    land_time: float = 0.2227
    tuck_time: float = 0.4128
    righted: float = 0.4178
    """Cosine of the tilt above which a kick has succeeded."""
    lost: float = 0.2974
    """Cosine of the tilt below which landing, tucking or standing has failed."""
    caught: float = 7.0765
    """Angular velocity about each axis below which a kicked robot is ready to land, rad/s."""
    kick_minimum: float = 0.0507
    """Shortest time in the phase KICK before a kick may count as successful or failed, s."""
    upright: float = 0.5215
    """Cosine of the tilt above which no kick is needed."""


SETTLE_TIME = 0.1
"""Longest duration of the phase SETTLE, s."""
SETTLE_MINIMUM = 0.05
"""Shortest duration of the phase SETTLE, s."""
SETTLED_TURNING = 2.5
"""Angular velocity about each axis below which a fallen robot lies still, rad/s."""
ROCK_BLEND = 0.05
"""Duration of the blend to the pose of the phase ROCK, s."""
ROCK_TIME = 0.3
"""Duration of the phase ROCK, s."""
FLAT = -0.95
"""Cosine of the tilt below which a robot lies on its back."""
KICK_BLEND = 0.01
"""Duration of the blend to the pose of the phase KICK, s; so short that the servos limit the motion."""
STRANDED_AFTER = 0.4
"""Time in the phase KICK after which a kick has failed if the robot hardly turns, s."""
STRANDED_TURNING = 0.5
"""Angular velocity about each axis below which a robot hardly turns, rad/s."""
STAND_TIME = 0.75
"""Time in the phase STAND after which the result is checked, s.

A robot that leans starts again with GATHER. A robot with misplaced legs goes back to TUCK."""
LEVEL = 0.9
"""Cosine of the tilt below which a robot leans."""


class Recovery(Motion):
    """Recovery from any pose, in the phases of `Phase`.

    Args:
        robot: Robot.
        control_period: Time between two calls of `targets`, s.
    """

    phase: NDArray[np.int64] = per_robot(0)
    """`Phase` of each robot, (n,)."""
    _left_lower: NDArray[np.int64] = per_robot(0)
    """1 if the left side of a robot is the lower side, else 0, (n,)."""

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
        """Start the recovery of the robots in the `mask`, (n,), from their `joints`, (k, 12), rad."""
        super().start(mask, joints)
        self.phase[mask] = Phase.SETTLE

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Compute the joint targets of some robots; see `Motion.targets`.

        Args:
            rows: Indices of the robots, (k,).
            observation: Observation of these robots, (k, m).
            joints: Joint angles of these robots, (k, 12), rad.

        Returns:
            Joint targets, (k, 12), rad.
        """
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
        """Return the next phase of some robots, (k,), and update which side of each robot is lower."""
        phase = self.phase[rows]
        gravity = observation[:, OBSERVATION["projected_gravity"]]
        turning = np.abs(observation[:, OBSERVATION["angular_velocity"]]).max(axis=1)
        misplaced = np.abs(observation[:, OBSERVATION["joint_position"]]).max(axis=1) > POSE_TOLERANCE
        time = self._ticks[rows] * self._period
        over = time >= self._times[phase]
        following = self._next_phase(phase, time, -gravity[:, 2], turning, misplaced)
        rocked_flat = over & (phase == Phase.ROCK) & (-gravity[:, 2] < FLAT)
        rocking_still = over & (phase == Phase.GATHER) & (following == Phase.ROCK) & (turning < STRANDED_TURNING)
        gathering_again = (following == Phase.GATHER) & (phase != Phase.GATHER)
        side = self._left_lower[rows]
        lower_side = np.where(gathering_again, gravity[:, 1] >= 0.0, side)
        self._left_lower[rows] = np.where(rocked_flat | rocking_still, 1 - side, lower_side)
        return following

    def _next_phase(
        self, phase: NDArray[np.int64], time: Floating, up: Floats, turning: Floats, misplaced: Mask
    ) -> NDArray[np.int64]:
        """Return the next phase of some robots, (k,).

        Args:
            phase: Current phase, (k,).
            time: Time in the phase, (k,), s.
            up: Cosine of the tilt, (k,).
            turning: Largest angular velocity about an axis, (k,), rad/s.
            misplaced: True for robots with a joint farther than POSE_TOLERANCE from the home pose, (k,).

        Returns:
            Next phase, (k,).
        """
        p = self._p
        over = time >= self._times[phase]
        settled = (phase == Phase.SETTLE) & (over | ((turning < SETTLED_TURNING) & (time >= SETTLE_MINIMUM)))
        gathered = over & (phase == Phase.GATHER)
        rocked = over & (phase == Phase.ROCK)
        stood = over & (phase == Phase.STAND)
        kicked = (phase == Phase.KICK) & (time > p.kick_minimum)
        righted = kicked & (up > p.righted) & (turning < p.caught)
        stranded = kicked & ~righted & (over | ((turning < STRANDED_TURNING) & (time > STRANDED_AFTER)))
        lost = ((phase >= Phase.LAND) & (up < p.lost)) | (stood & (up < LEVEL))
        upright = (settled | gathered | rocked) & (up > p.upright)
        following = phase.copy()
        following[stranded | gathered] = Phase.ROCK
        following[gathered & (up < FLAT)] = Phase.KICK
        following[righted] = Phase.LAND
        following[over & (phase == Phase.TUCK)] = Phase.STAND
        following[settled | rocked | lost] = Phase.GATHER
        following[upright | (~lost & ((stood & misplaced) | (over & (phase == Phase.LAND))))] = Phase.TUCK
        return following


def key_poses(robot: Robot, p: RecoveryParameters) -> Floats:
    """Return the joint angles of the pose of each phase, for a lower right side and for a lower left side.

    Args:
        robot: Robot.
        p: Parameters of the recovery.

    Returns:
        Joint angles, indexed by phase and by 0 for right or 1 for left, (7, 2, 12), rad. The entry of the phase SETTLE
        is not used.
    """
    home = tuple(robot.home_pose.reshape(-1, 2, 3)[:, 0].ravel())  # angles of a front leg, then of a hind leg
    lower = (home, p.gather_lower, p.gather_lower, p.kick_lower, p.land, p.tuck, home)
    upper = (home, p.gather_upper, p.gather_upper, p.kick_upper, p.land, p.tuck, home)
    by_height = np.array([upper, lower]).reshape(2, len(Phase), 2, 3)  # upper or lower, phase, front or hind, joint
    poses = np.empty((len(Phase), 2, len(robot.leg_names), 3))
    for left_lower in (0, 1):
        for leg, side in enumerate(robot.side):
            lower_leg = left_lower if side > 0 else 1 - left_lower
            poses[:, left_lower, leg] = by_height[lower_leg, :, leg // 2] * (side, 1.0, 1.0)
    return np.clip(poses.reshape(len(Phase), 2, -1), robot.joint_lower, robot.joint_upper)
