"""Footholds, swing trajectories and the terrain plane of the model-based controllers.

All positions are in the level frame (yaw only): origin at the trunk centre, z up, x forward.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from policies.contact.motion_state import MotionState
from policies.gait_cycle import Floats, smoothstep
from policies.legs.foot_path import cubic_swing
from policies.legs.ground_plane import advect_footprints, fit_plane, height_above_plane, plane_height
from policies.memory import PerRobotState, lowpass_gain, per_robot
from policies.mpc.parameters import ModelParameters
from quad_env.columns import Mask, ordered_sum
from quad_env.config import GRAVITY
from quad_env.robots.robot import Robot

MAX_FOOTHOLD_OFFSET = 0.35
"""Largest horizontal offset of a foothold that depends on the velocity and the velocity error of the robot, m.

The offset is measured from the nominal foothold, which is the foothold of a robot at rest."""
MAX_LEAN_SHIFT = 0.2
"""Bound of the forward and of the lateral shift of the footholds that balances a lasting external force, m."""
MAX_HIP_ANGLE = 0.42
"""Largest angle to the side between the vertical and the line from the hip to a foothold, rad.

It bounds the lateral position of the foothold, so that the abduction joint stays within its limit."""
MAX_SLOPE = 0.6
"""Bound of the absolute forward and of the absolute lateral slope of the ground, rise per metre.

The measured slope is clipped to this bound before it enters the low-pass filter of the slope."""
ROUGHNESS_FILTER_TIME = 1.0
"""Time constant of the low-pass filter of the ground roughness, s.

The roughness is the largest vertical distance of a footprint from the plane through the footprints of the four feet. A
footprint is the position of a foot at its last contact with the ground."""
CROUCH_MARGIN = 0.05
"""Assumed largest sag of the trunk below its reference height when a foot lands, m.

The lateral range of the footholds is computed for a trunk that is lower by this distance."""

_PHASE_STEP = 1e-3
"""Step of the swing progress (0 to 1) in the finite differences that give the foot velocity."""
_ROTATE_90 = np.array([-1.0, 1.0])
"""Signs of the components when a vector (x, y) is rotated by 90 degrees: (y, x) times the signs is (-y, x)."""

Terrain = Callable[[Floats, Floats, Floats], Floats]
"""Function (x, y, progress) -> height of the terrain under the swing feet of n robots; each array is (n, 4).

x and y are the foot position and the result is the height, level frame (yaw only), m. The progress is the elapsed
fraction of the swing phase, 0 to 1."""


class TerrainPlane(NamedTuple):
    """Ground planes under n robots, level frame (origin at the trunk centre, z up, x forward)."""

    height: Floats
    """Height of the ground plane at x = y = 0 (under the trunk centre), relative to the trunk centre, (n,), m.

    It is negative if the ground is below the trunk centre."""
    forward: Floats
    """Slope of the ground plane in the forward direction, rise per metre, (n,)."""
    lateral: Floats
    """Slope of the ground plane to the left, rise per metre, (n,)."""

    def at(self, x: Floats, y: Floats) -> Floats:
        """Return the height of the plane, (n, k), m, at the coordinates `x` and `y`, (n, k) or (k,), m."""
        return plane_height((self.height[:, None], self.forward[:, None], self.lateral[:, None]), x, y)


class TerrainEstimator(PerRobotState):
    """Estimates the ground plane under n robots from the last footprint of each foot.

    A footprint is the position of a foot at its last contact with the ground.

    Args:
        slope_time: Time constant of the low-pass filter of the slope, s.
        period: Control period, s.
    """

    slope: Floats = per_robot(np.zeros(2), axis=1)
    """Low-pass filtered slope of the ground forward and to the left, level frame, rise per metre, (2, n).

    The level frame turns only with the yaw of the robot, and its z axis points up.
    """
    roughness: Floats = per_robot(0.0)
    """Low-pass filtered roughness of the ground, (n,), m.

    The roughness is the largest vertical distance of a footprint from the plane through the footprints of the four
    feet. A footprint is the position of a foot at its last contact with the ground."""
    footprints: Floats = per_robot(np.zeros((3, 4)), axis=2)
    """Footprint of each foot (its position at its last contact with the ground), level frame, (3, 4, n), m.

    The level frame turns only with the yaw of the robot, and its z axis points up.
    """

    def __init__(self, slope_time: float, period: float) -> None:
        self._slope_gain = lowpass_gain(period, slope_time)
        self._roughness_gain = lowpass_gain(period, ROUGHNESS_FILTER_TIME)
        self._period = period
        super().__init__()

    def ground(self, state: MotionState, landed: Mask) -> TerrainPlane:
        """Update the footprints and the filtered slope, and return the ground plane under each robot.

        Args:
            state: State of n robots.
            landed: True for feet on the ground, (n, 4). Their positions become the footprints of these feet.

        Returns:
            Ground plane with the filtered slope and the mean height of the four footprints.
        """
        yaw_rate = state.angular_velocity[:, 2]
        carried_along = advect_footprints(self.footprints, state.velocity.T, yaw_rate, self._period)
        self.footprints = np.where(landed.T, state.bodies.feet.T, carried_along)
        plane = fit_plane(self.footprints)
        distance = np.abs(height_above_plane(plane, self.footprints)).max(axis=0)
        self.roughness += self._roughness_gain * (distance - self.roughness)
        # The slope vector is rotated against the yaw rate, because the level frame turns with the robot, whereas the
        # slope keeps its direction in the world.
        forward, lateral = self.slope
        self.slope = self.slope + self._period * yaw_rate * np.array((lateral, -forward))
        measured_slope = np.clip(plane[1:], -MAX_SLOPE, MAX_SLOPE)
        self.slope = self.slope + self._slope_gain * (measured_slope - self.slope)
        forward, lateral = self.slope
        heights = height_above_plane((np.zeros(len(landed)), forward, lateral), self.footprints)
        return TerrainPlane(0.25 * ordered_sum(heights), forward, lateral)


def ground_velocity(state: MotionState, yaw_rate: Floats) -> Floats:
    """Return the horizontal velocity of the ground relative to the trunk, at the position of each foot.

    A stance foot moves with this velocity relative to the trunk.

    Args:
        state: State of n robots.
        yaw_rate: Yaw rate of the trunks, (n,), rad/s.

    Returns:
        Velocity of the ground, level frame (yaw only), (n, 4, 2), m/s.
    """
    return -point_velocity(state, yaw_rate, state.bodies.feet)


def point_velocity(state: MotionState, yaw_rate: Floats, positions: Floats) -> Floats:
    """Return the horizontal velocity v + ω_z × r of points fixed to the trunk.

    Args:
        state: State of n robots; it supplies the velocity v of the centre of mass.
        yaw_rate: Yaw rate ω_z of the trunks, (n,), rad/s.
        positions: Positions r of the points relative to the trunk centre, level frame (yaw only), (n, 4, 2 or 3), m.

    Returns:
        Horizontal velocity of the points, level frame, (n, 4, 2), m/s.
    """
    yaw_velocity = yaw_rate[:, None, None] * (positions[..., 1::-1] * _ROTATE_90)
    velocity: Floats = state.bodies.com_velocity[:, None, :2] + yaw_velocity
    return velocity


@cache
def nominal_footholds(robot: Robot, p: ModelParameters) -> Floats:
    """Return the nominal footholds, the footholds of a robot at rest: a rectangle about the centre of mass.

    `plan_footholds` adds offsets to them that depend on the velocity and on external forces.

    Args:
        robot: Robot model; it supplies the order and the side of the legs.
        p: Parameters with the length, the width and the forward `shift` of the rectangle.

    Returns:
        Footholds (x, y) relative to the centre of mass, level frame (yaw only), (4, 2), m.
    """
    fore_or_hind = np.sign(robot.hip_positions[:, 0])
    return np.stack((fore_or_hind * p.length / 2.0 + p.shift, robot.side * p.width / 2.0), axis=-1)


def plan_footholds(
    robot: Robot,
    p: ModelParameters,
    motion: MotionState,
    disturbance_acceleration: Floats,
    stance_time: Floats,
    height: float,
) -> Floats:
    """Plan the next foothold of each foot (Raibert heuristic).

    Three offsets are added to each nominal foothold. The first is half the distance that the trunk moves in a stance
    phase, so that the foot is at its nominal foothold at mid-stance. The second is `step_gain` times the velocity
    error. The third is a shift in the direction of a lasting external force, so that the feet balance this force.

    Args:
        robot: Robot model; it supplies the hip positions.
        p: Parameters of the nominal footholds, `step_gain` and `lean_gain`.
        motion: State of n robots.
        disturbance_acceleration: Horizontal acceleration that lasting external forces cause, level frame (yaw only),
            (n, 2), m/s².
        stance_time: Duration of a stance phase of each robot, (n,), s.
        height: Reference height of the trunk centre above the ground, m.

    Returns:
        Footholds (x, y), level frame, (n, 4, 2), m. The sum of the first two offsets is at most `MAX_FOOTHOLD_OFFSET`,
        and the lateral positions are within the range of the abduction joints.
    """
    bodies = motion.bodies
    command = motion.command
    lean_shift = (p.lean_gain * height / GRAVITY * disturbance_acceleration).clip(-MAX_LEAN_SHIFT, MAX_LEAN_SHIFT)
    nominal = nominal_footholds(robot, p) + (bodies.com_position[:, :2] + lean_shift)[:, None]
    offset = 0.5 * stance_time[:, None, None] * point_velocity(motion, command[:, 2], nominal)
    offset = offset + p.step_gain * (bodies.com_velocity[:, :2] - command[:, :2])[:, None]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    scale = np.minimum(1.0, MAX_FOOTHOLD_OFFSET / np.maximum(distance, 1e-9))
    positions: Floats = nominal + offset * scale[..., None]
    below_hip = robot.hip_positions[:, 1] + robot.side * robot.hip_offset
    hip_range = (height - CROUCH_MARGIN) * math.tan(MAX_HIP_ANGLE)
    positions[..., 1] = positions[..., 1].clip(below_hip - hip_range, below_hip + hip_range)
    return positions


def swing_trajectory(
    p: ModelParameters,
    start: Floats,
    foothold_positions: Floats,
    ground_velocities: Floats,
    progress: Floats,
    time: Floats,
    period: float,
    terrain: Terrain,
) -> tuple[Floats, Floats, Floats]:
    """Return position, velocity and acceleration of the swing feet on their trajectories, relative to the trunk.

    At lift-off and touch-down, a foot moves with the ground. The trajectory ends `landing_depth` below the ground.

    Args:
        p: Parameters with `step_height` and `landing_depth`.
        start: Foot position (x, y) at lift-off, level frame (yaw only), (n, 4, 2), m.
        foothold_positions: Foot position (x, y) at touch-down, level frame, (n, 4, 2), m.
        ground_velocities: Horizontal velocity of the ground relative to the trunk at each foot, level frame, (n, 4, 2),
            m/s.
        progress: Elapsed fraction of the swing phase of each foot, 0 to 1, (n, 4).
        time: Duration of a swing phase of each robot, (n,), s.
        period: Control period, s.
        terrain: Function that returns the height of the terrain under the swing feet.

    Returns:
        position: Foot positions, level frame, (n, 4, 3), m.
        velocity: Foot velocities relative to the trunk, level frame, (n, 4, 3), m/s.
        acceleration: Foot accelerations relative to the trunk, level frame, (n, 4, 3), m/s². They are means over the
            next control period.
    """
    end_slope = ground_velocities * time[:, None, None]
    progress_step = (period / time)[:, None]

    def position_at(t: Floats) -> Floats:
        horizontal = cubic_swing(start, foothold_positions, end_slope, t[..., None])
        arc = 4.0 * t * (1.0 - t)
        terrain_height = terrain(horizontal[..., 0], horizontal[..., 1], t)
        z = terrain_height + p.step_height * arc * arc - p.landing_depth * smoothstep(t)
        return np.concatenate((horizontal, z[..., None]), axis=-1)

    later = progress + progress_step
    samples = (
        progress,
        progress + _PHASE_STEP,
        later + _PHASE_STEP,
        progress + -_PHASE_STEP,
        later + -_PHASE_STEP,
    )
    positions = position_at(np.array(samples))
    velocity, later_velocity = (positions[1:3] - positions[3:]) / (2.0 * _PHASE_STEP * time[:, None, None])
    return positions[0], velocity, (later_velocity - velocity) / period


def predict_moment_arms(
    feet: Floats,
    foothold_positions: Floats,
    centre: Floats,
    velocity: Floats,
    stance: Mask,
    time_in_stance: Floats,
    times: Floats,
    z: Floats,
) -> Floats:
    """Predict the vectors from the centre of mass to the feet over the N steps of the MPC horizon.

    The prediction assumes that the centre of mass moves at constant velocity. A stance foot stays at its present
    position on the ground, and a swing foot stays at its foothold after it has landed.

    Args:
        feet: Present foot positions, level frame (yaw only), (n, 4, 3), m.
        foothold_positions: Next footholds (x, y), level frame, (n, 4, 2), m.
        centre: Position of the centre of mass, level frame, (n, 3), m.
        velocity: Horizontal velocity of the centre of mass, level frame, (n, 2), m/s.
        stance: True for stance feet in each step of the horizon, (n, N, 4).
        time_in_stance: Time since the touch-down of each stance foot, in each step of the horizon, (n, N, 4), s.
        times: Time from now to the middle of each step of the horizon, (N,), s.
        z: Height of the ground under the feet relative to the centre of mass, broadcasts to (n, N, 4), m.

    Returns:
        Vectors from the centre of mass to the feet in each step of the horizon, level frame, (n, N, 4, 3), m.
    """
    stays_in_stance = np.logical_and.accumulate(stance, axis=1)[..., None]
    velocity_by_step = velocity[:, None, None]
    standing = feet[:, None, :, :2] - velocity_by_step * times[:, None, None]
    landed = foothold_positions[:, None] - velocity_by_step * np.where(stance, time_in_stance, 0.0)[..., None]
    moment_arms = np.empty((*stance.shape, 3))
    moment_arms[..., :2] = np.where(stays_in_stance, standing, landed) - centre[:, None, None, :2]
    moment_arms[..., 2] = z
    return moment_arms
