"""Where the feet of a robot under model-predictive control go; level frame, arrays (n, 4, …)."""

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from policies.gait_cycle import Floats, smoothstep
from policies.legs.foot_path import cubic_swing
from policies.legs.ground_plane import advect_footprints, fit_plane, height_above_plane, plane_height
from policies.memory import PerRobotState, lowpass_gain, per_robot
from policies.mpc.motion import MotionState
from policies.mpc.parameters import ModelParameters
from quad_env.columns import Mask, ordered_sum
from quad_env.config import GRAVITY
from quad_env.robots.robot import Robot

MAX_FOOTHOLD_OFFSET = 0.35
"""Farthest that a foothold is off its neutral point, m."""
LARGEST_SHIFT = 0.2
"""Farthest that a lasting force shifts the feet, m."""
HIP_ANGLE = 0.42
"""Largest angle of a hip at a foothold, rad: short of its limit."""
MAX_SLOPE = 0.6
"""Largest slope that is believed, m/m."""
ROUGHNESS_TIME = 1.0
"""Time constant with which the roughness of the ground is taken in, s."""
CROUCH = 0.05
"""How much lower than planned a trunk may be when a foot lands, m."""

_PHASE_STEP = 1e-3
"""Progress of a swing over which its speed is taken."""
_ROTATE_90 = np.array([-1.0, 1.0])
"""(y, x) times this is (x, y) turned by a quarter."""

Terrain = Callable[[Floats, Floats, Floats], Floats]
"""What feet swing over: height, m, that a swing starts its lift from, by x, y and the swing's progress, (n, 4) each."""


class TerrainPlane(NamedTuple):
    """The ground under n robots: height under the trunk's centre relative to it, and rise per metre; (n,)."""

    height: Floats
    forward: Floats
    lateral: Floats

    def at(self, x: Floats, y: Floats) -> Floats:
        """Height there, m, (n, 4)."""
        return plane_height((self.height[:, None], self.forward[:, None], self.lateral[:, None]), x, y)


class TerrainEstimator(PerRobotState):
    """Where the feet of n robots stood last, and the ground that this shows.

    Args:
        slope_time: time constant with which the slope is taken in, s.
        period: of control, s.
    """

    slope: Floats = per_robot(np.zeros(2), axis=1)
    """Rise per metre forward and to the left, (2, n)."""
    roughness: Floats = per_robot(0.0)
    """Largest distance of a footprint from the plane through them, smoothed, (n,), m."""
    footprints: Floats = per_robot(np.zeros((3, 4)), axis=2)
    """Of the footprints now, level frame, (3, 4, n), m."""

    def __init__(self, slope_time: float, period: float) -> None:
        self._share, self._period = lowpass_gain(period, slope_time), period
        super().__init__()

    def ground(self, state: MotionState, landed: Mask) -> TerrainPlane:
        """The plane of the slope that the footprints have shown for a while, at the footprints' mean height.

        `landed`: feet that show the ground now, (n, 4).
        """
        former = advect_footprints(self.footprints, state.velocity.T, state.angular_velocity[:, 2], self._period)
        self.footprints = footprints = np.where(landed.T, state.bodies.feet.T, former)
        _, *slope = plane = fit_plane(footprints)
        apart = np.abs(height_above_plane(plane, footprints)).max(axis=0)
        self.roughness += lowpass_gain(self._period, ROUGHNESS_TIME) * (apart - self.roughness)
        turned = self._period * state.angular_velocity[:, 2] * np.array((self.slope[1], -self.slope[0]))
        self.slope = self.slope + turned  # with the level frame, which turns with the robot
        self.slope = self.slope + self._share * (np.clip(slope, -MAX_SLOPE, MAX_SLOPE) - self.slope)
        forward, lateral = self.slope
        under_the_trunk = 0.25 * ordered_sum(height_above_plane((np.zeros(len(landed)), forward, lateral), footprints))
        return TerrainPlane(under_the_trunk, forward, lateral)


def ground_velocity(state: MotionState, yaw_rate: Floats) -> Floats:
    """Velocity of the ground under trunks that turn at a yaw rate, (n,), rad/s, at their feet, (n, 4, 2), m/s."""
    return -point_velocity(state, yaw_rate, state.bodies.feet)


def point_velocity(state: MotionState, yaw_rate: Floats, places: Floats) -> Floats:
    """Velocity, (n, 4, 2), m/s, of places, (n, 4, 2 or 3), m, that go with bodies and turn at (n,) rad/s."""
    turned = yaw_rate[:, None, None] * (places[..., 1::-1] * _ROTATE_90)
    velocity: Floats = state.bodies.com_velocity[:, None, :2] + turned
    return velocity


@cache
def nominal_footholds(robot: Robot, p: ModelParameters) -> Floats:
    """Footholds in place relative to the centre of mass, (4, 2), m."""
    before = np.sign(robot.hip_positions[:, 0])
    return np.stack((before * p.length / 2.0 + p.shift, robot.side * p.width / 2.0), axis=-1)


def footholds(
    robot: Robot,
    p: ModelParameters,
    motion: MotionState,
    disturbance_acceleration: Floats,
    stance_time: Floats,
    height: float,
) -> Floats:
    """Footholds, (n, 4, 2), m: under the body halfway through the stance, further out by the velocity error, and to
    where they bear a lasting acceleration `pushed`, (n, 2), m/s².

    `stance_time`: (n,), s; `height` that the trunk is to have above the ground, m.
    """
    velocity, centre, command = motion.bodies.com_velocity, motion.bodies.com_position, motion.command
    shift = (p.lean_gain * height / GRAVITY * disturbance_acceleration).clip(-LARGEST_SHIFT, LARGEST_SHIFT)
    place = nominal_footholds(robot, p) + (centre[:, :2] + shift)[:, None]
    reach = 0.5 * stance_time[:, None, None] * point_velocity(motion, command[:, 2], place)
    reach = reach + p.step_gain * (velocity[:, :2] - command[:, :2])[:, None]
    size = np.hypot(reach[..., 0], reach[..., 1])
    foothold_positions: Floats = (
        place + reach * np.minimum(1.0, MAX_FOOTHOLD_OFFSET / np.maximum(size, 1e-9))[..., None]
    )
    below_hip = robot.hip_positions[:, 1] + robot.side * robot.hip_offset
    wide = (height - CROUCH) * math.tan(HIP_ANGLE)
    foothold_positions[..., 1] = foothold_positions[..., 1].clip(below_hip - wide, below_hip + wide)
    return foothold_positions


def swing_trajectory(
    p: ModelParameters,
    start: Floats,
    foothold_positions: Floats,
    passing: Floats,
    progress: Floats,
    time: Floats,
    period: float,
    ground: Terrain,
) -> tuple[Floats, Floats, Floats]:
    """Place, velocity and acceleration of feet at that progress, (n, 4), of a swing from `start` to `aim`, (n, 4, 2),
    relative to the trunk; (n, 4, 3) each, m, m/s, m/s².

    It leaves and lands with the velocity of the ground, `passing`, (n, 4, 2), m/s, and ends a little below it. `time`:
    of a swing, (n,), s; the acceleration is the mean one over a control period from now on.
    """
    slope = passing * time[:, None, None]
    step = (period / time)[:, None]

    def at(t: Floats) -> Floats:
        place = cubic_swing(start, foothold_positions, slope, t[..., None])
        arc = 4.0 * t * (1.0 - t)
        z = ground(place[..., 0], place[..., 1], t) + p.step_height * arc * arc - p.landing_depth * smoothstep(t)
        return np.concatenate((place, z[..., None]), axis=-1)

    times = [t + apart for apart in (_PHASE_STEP, -_PHASE_STEP) for t in (progress, progress + step)]
    places = at(np.array((progress, *times)))
    state, then = (places[1:3] - places[3:]) / (2.0 * _PHASE_STEP * time[:, None, None])
    return places[0], state, (then - state) / period


def moment_arms(
    feet: Floats,
    foothold_positions: Floats,
    centre: Floats,
    velocity: Floats,
    stands: Mask,
    since: Floats,
    times: Floats,
    z: Floats,
) -> Floats:
    """Feet from the centre of mass over a horizon of N steps, (n, N, 4, 3), m.

    A foot that stands stays where it is while the body goes on at `velocity`, (n, 2); one that lands stays at `aim`.
    `stands`: (n, N, 4); `since`: time since the landing, (n, N, 4), s; `times`: middle of each step, (N,), s; `z`: the
    ground below the centre of mass where the feet stand, m, of a shape that broadcasts to (n, N, 4).
    """
    lasting = np.logical_and.accumulate(stands, axis=1)[..., None]
    away = velocity[:, None, None]
    stood = feet[:, None, :, :2] - away * times[:, None, None]
    landed = foothold_positions[:, None] - away * np.where(stands, since, 0.0)[..., None]
    found = np.empty((*stands.shape, 3))
    found[..., :2], found[..., 2] = np.where(lasting, stood, landed) - centre[:, None, None, :2], z
    return found
