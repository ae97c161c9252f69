"""Recovery of a fallen robot from any pose, by key poses that the direction of gravity selects.

1. A robot on the ground gathers its legs and waits until it lies on its back, because a kick from the side rarely
   succeeds. If the robot comes to rest on its side, it rocks: it gathers the legs as if its upper side were the lower
   side.
2. From its back the robot kicks: it swings all legs at once, rolls over its lower side and lands on bent legs.
3. An upright robot tucks its legs under its hips and stands up.

If one of these steps fails, the robot starts again with step 1. After a failed kick it rolls over the other side.
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
    """Phase of the recovery of a fallen robot."""

    SETTLE = 0
    """The joints are damped until the robot lies still."""
    GATHER = 1
    """The legs move to the gathered pose, the pose before a kick."""
    ROCK = 2
    """The legs stay in the gathered pose, because the robot lies on its side or a kick has failed."""
    KICK = 3
    """All legs swing at once, so that the robot rolls over from its back."""
    LAND = 4
    """The legs move to a bent pose, in which the robot lands on its feet."""
    TUCK = 5
    """The legs move under the hips of the upright robot, with bent knees, before the robot stands up."""
    STAND = 6
    """The legs move to the home pose, which lifts the trunk."""


Legs = tuple[float, float, float, float, float, float]
"""Six joint angles, rad: hip, thigh and calf of a front leg, then hip, thigh and calf of a hind leg.

A positive hip angle moves the leg outward, away from the trunk."""


@dataclass(frozen=True)
class RecoveryParameters:
    """Parameters of the recovery of a fallen robot, found by a search: key poses, durations and limits.

    Fields with `lower` in their names are for the legs on the lower side of the robot, to which gravity points. Fields
    with `upper` are for the legs on the opposite, upper side.
    """

    gather_lower: Legs = (-0.4307, -0.9243, -1.5535, -0.161, -1.3987, -0.0802)
    """Joint angles of the legs on the lower side in the phases GATHER and ROCK, rad."""
    gather_upper: Legs = (-0.1346, -1.0368, -1.4206, 0.18, -0.6586, -2.0105)
    """Joint angles of the legs on the upper side in the phases GATHER and ROCK, rad."""
    kick_lower: Legs = (-0.4899, 0.9008, -1.7529, 0.4338, 0.2844, -1.7472)
    """Joint angles of the legs on the lower side in the phase KICK, rad."""
    kick_upper: Legs = (-0.4789, 1.0582, -0.883, -0.3417, 1.0035, -2.3897)
    """Joint angles of the legs on the upper side in the phase KICK, rad."""
    land: Legs = (0.3966, 0.728, -1.6909, 0.4828, 1.075, -1.9985)
    """Joint angles of the legs on both sides in the phase LAND, rad."""
    tuck: Legs = (0.3108, 1.2458, -2.3518, 0.3277, 1.3659, -2.3119)
    """Joint angles of the legs on both sides in the phase TUCK, rad."""
    gather_blend: float = 0.204
    """Duration of the blend from the last pose to the key pose of the phase GATHER, s."""
    land_blend: float = 0.1454
    """Duration of the blend from the last pose to the key pose of the phase LAND, s."""
    tuck_blend: float = 0.3537
    """Duration of the blend from the last pose to the key pose of the phase TUCK, s."""
    stand_blend: float = 0.3717
    """Duration of the blend from the last pose to the key pose of the phase STAND, s."""
    gather_time: float = 0.3422
    """Duration of the phase GATHER, s."""
    kick_time: float = 0.75
    """Longest duration of the phase KICK, s. After this time a kick counts as failed."""
    land_time: float = 0.2227
    """Duration of the phase LAND, s."""
    tuck_time: float = 0.4128
    """Duration of the phase TUCK, s."""
    righted: float = 0.4178
    """Cosine of the tilt of the trunk (1: upright) above which a kick can count as successful.

    The trunk must also turn more slowly than the limit `caught`."""
    lost: float = 0.2974
    """Cosine of the tilt of the trunk (1: upright) below which a phase LAND, TUCK or STAND has failed."""
    caught: float = 7.0765
    """Angular velocity about each base axis below which a robot changes from the phase KICK to LAND, rad/s."""
    kick_minimum: float = 0.0507
    """Time since the start of the phase KICK before which a kick counts neither as successful nor as failed, s."""
    upright: float = 0.5215
    """Cosine of the tilt of the trunk (1: upright) above which a robot stands up and needs no kick."""


SETTLE_TIME = 0.1
"""Longest duration of the phase SETTLE, in which a fallen robot comes to rest with damped joints, s."""
SETTLE_MINIMUM = 0.05
"""Shortest duration of the phase SETTLE, in which a fallen robot comes to rest with damped joints, s."""
SETTLED_TURNING = 2.5
"""Angular velocity of the trunk about each base axis below which a fallen robot lies still, rad/s."""
ROCK_BLEND = 0.05
"""Duration of the blend from the last pose to the key pose of the phase ROCK, s."""
ROCK_TIME = 0.3
"""Duration of the phase ROCK, in which a robot keeps its legs gathered on its side or after a failed kick, s."""
FLAT = -0.95
"""Cosine of the tilt of the trunk (1: upright, -1: upside down) below which a robot lies on its back."""
KICK_BLEND = 0.01
"""Duration of the blend to the key pose of the phase KICK, s.

The blend is so short that the servos limit the speed of the motion."""
STRANDED_AFTER = 0.4
"""Time in the phase KICK after which a kick has failed if the robot turns more slowly than STRANDED_TURNING, s."""
STRANDED_TURNING = 0.5
"""Angular velocity of the trunk about each base axis below which a robot has stopped rolling, rad/s."""
STAND_TIME = 0.75
"""Time in the phase STAND after which the pose of the robot is checked, s.

A robot that tilts too far starts again with the phase GATHER. A robot with misplaced joints goes back to TUCK."""
LEVEL = 0.9
"""Cosine of the tilt of the trunk (1: upright) below which a robot in the phase STAND tilts too far."""


class Recovery(Motion):
    """Motion of a fallen robot from any pose to its home pose, in the phases of `Phase`.

    Args:
        robot: Robot that moves.
        control_period: Time between two calls of `targets`, s.
    """

    phase: NDArray[np.int64] = per_robot(0)
    """Current `Phase` of the recovery of each robot, as a number, (n,)."""
    _left_lower: NDArray[np.int64] = per_robot(0)
    """1 for robots with the left legs on the lower side, 0 with the right legs on the lower side, (n,).

    The key poses of the recovery depend on the lower side."""

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
        """Start the recovery of k robots.

        Args:
            mask: True for the k robots that start the recovery, (n,) bool.
            joints: Joint angles or last joint targets of these robots, (k, 12), rad.
        """
        super().start(mask, joints)
        self.phase[mask] = Phase.SETTLE

    def targets(self, rows: NDArray[np.intp], observation: Floats, joints: Floats) -> Floats:
        """Compute the joint targets of k robots in the recovery, for one control step.

        Args:
            rows: Indices of the k robots in the batch, (k,).
            observation: Observation of these robots, (k, m), with m numbers per robot.
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
        """Return the next phase of k robots, (k,), and update the lower sides in `_left_lower`.

        `rows` are the indices of the robots in the batch, (k,). `observation` has m numbers for each of these robots,
        (k, m).
        """
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
        """Return the next phase of k robots from their motion and from the time in the current phase.

        Args:
            phase: Current phase, (k,).
            time: Time since the start of the current phase, (k,), s.
            up: Cosine of the tilt of the trunk, 1 if the trunk is upright, (k,).
            turning: Largest absolute angular velocity about a base axis, (k,), rad/s.
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
    """Return the key pose of each phase of the recovery, separately for each lower side of the robot.

    Args:
        robot: Robot with the home pose and the joint limits.
        p: Parameters of the recovery, with the joint angles of the key poses.

    Returns:
        Joint angles within the joint limits, (7, 2, 12), rad. The axes are the phase, the lower side (0: right,
        1: left) and the joint. The angles of the phase SETTLE are not used.
    """
    home = tuple(robot.home_pose.reshape(-1, 2, 3)[:, 0].ravel())  # angles of a front leg, then of a hind leg
    lower = (home, p.gather_lower, p.gather_lower, p.kick_lower, p.land, p.tuck, home)
    upper = (home, p.gather_upper, p.gather_upper, p.kick_upper, p.land, p.tuck, home)
    # The axes of `by_height` are: 0 for the upper and 1 for the lower side, phase, front or hind leg, joint.
    by_height = np.array([upper, lower]).reshape(2, len(Phase), 2, 3)
    poses = np.empty((len(Phase), 2, len(robot.leg_names), 3))
    for left_lower in (0, 1):
        for leg, side in enumerate(robot.side):
            lower_leg = left_lower if side > 0 else 1 - left_lower
            poses[:, left_lower, leg] = by_height[lower_leg, :, leg // 2] * (side, 1.0, 1.0)
    return np.clip(poses.reshape(len(Phase), 2, -1), robot.joint_lower, robot.joint_upper)
