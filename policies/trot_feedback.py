"""A diagonal trot that feels: footholds by velocity error, legs by attitude and height, the plan by the ground's slope.

The feet are planned in the level frame (see `policies.level_frame`). A standing foot passes under the trunk at the
velocity wanted there; a swinging one goes to a foothold that moves with the velocity error until it lands.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies import ground_plane
from policies.base import CONTROL_PERIOD, Actions, GaitedPolicy, to_actions
from policies.feedback_parameters import FeedbackParameters, searched_parameters
from policies.foot_path import lift, load
from policies.footholds import Planar, captured, passing, raibert, swung, within_reach
from policies.gait import TROT_OFFSETS, TURN, Floats, Gait, LegCycle
from policies.ground_plane import Plane
from policies.kinematics import foot_positions, leg_angles
from policies.level_frame import LevelFrame, Vector, level_frame
from policies.trot import held_up
from quad_env import OBSERVATION
from quad_env.robot import HIP_POSITIONS, HOME_POSE, NUM_JOINTS, SIDE

LARGEST_CORRECTION = 0.5
"""Of the gait's velocity by the integral of its error, m/s and rad/s."""
SMALL_ERROR = 0.6
"""Velocity error, m/s, and yaw-rate error, rad/s, beyond which the integral waits: that is a push, not a bias."""
BRACE_TIME = 0.03
"""From the trot to all feet down, s."""
STEEP_RANGE = 0.1
"""Slope from the beginning of bracing to all feet down."""
BRACE_RANGE = 0.4
"""Velocity error from the beginning of bracing to all feet down, m/s."""
LARGEST_LEAD = 0.1
"""Shift of the feet in bracing, m."""
LARGEST_TILT_ERROR = 0.5
"""Tilt that the legs answer to, rad."""
SETTLED = 0.2
"""Share of its stance after which a foot is taken to stand."""
EVEN = 0.015
"""Unevenness, m, that a trot on a plane feels too."""
LARGEST_ROUGHNESS = 0.15
"""m"""
ROUGHNESS_MEMORY = 2.0
"""Time constant with which rough ground is forgotten, s."""


class Senses(NamedTuple):
    """What the observation says; arrays (n, 1), of legs (n, 4)."""

    frame: LevelFrame
    velocity: Vector
    """Of the trunk's centre, level frame, m/s."""
    yaw_rate: Floats
    """About the vertical, rad/s."""
    roll_rate: Floats
    pitch_rate: Floats
    feet: Vector
    """From the trunk's centre, level frame, m."""


def sense(observation: Floats) -> Senses:
    """Senses of observations (n, k)."""
    frame = level_frame(observation[:, OBSERVATION["projected_gravity"]])
    velocity, turn = (_columns(observation[:, OBSERVATION[name]]) for name in ("linear_velocity", "angular_velocity"))
    joints = observation[:, OBSERVATION["joint_position"]] + HOME_POSE
    x, y, z = np.moveaxis(foot_positions(joints.reshape(-1, 4, 3)) + HIP_POSITIONS, -1, 0)
    return Senses(
        frame=frame,
        velocity=frame.to_level(velocity),
        yaw_rate=frame.up_x * turn[0] + frame.up_y * turn[1] + frame.up_z * turn[2],
        roll_rate=turn[0],
        pitch_rate=turn[1],
        feet=frame.to_level((x, y, z)),
    )


def _columns(rows: Floats) -> Vector:
    return rows[:, 0:1], rows[:, 1:2], rows[:, 2:3]


def _length(vector: Vector) -> Floats:
    """Of the horizontal part, (n, 1)."""
    x, y, _ = vector
    length: Floats = np.sqrt(x * x + y * y)
    return length


class TrotFeedback(GaitedPolicy):
    """Command-following trot with feedback; steps in place at zero command."""

    name = "trot_feedback"

    def __init__(self, parameters: FeedbackParameters | None = None) -> None:
        self.parameters = p = parameters if parameters is not None else searched_parameters()
        self.frequency = p.frequency
        self._gait = Gait(TROT_OFFSETS, p.duty)
        self._neutral = (HIP_POSITIONS[:, 0] + p.stance_shift, SIDE * (p.stance_width / 2.0))
        self._wide = (np.sign(HIP_POSITIONS[:, 0]) * (p.brace_length / 2.0), SIDE * (p.brace_width / 2.0))
        super().__init__()

    def _allocate(self, num_envs: int) -> None:
        super()._allocate(num_envs)
        legs = np.zeros((num_envs, 4))
        one = np.zeros((num_envs, 1))
        feet = (legs + self._neutral[0], legs + self._neutral[1])
        self._state: dict[str, Floats] = {
            "wanted": np.zeros((num_envs, 3)),
            "correction": np.zeros((num_envs, 3)),
            "velocity": np.zeros((num_envs, 2)),
            "slope": np.zeros((num_envs, 2)),
            "roughness": one,
            "brace": one,
            "swinging": legs,
            "foot_x": feet[0],
            "foot_y": feet[1],
            "start_x": feet[0],
            "start_y": feet[1],
            "print_x": feet[0],
            "print_y": feet[1],
            "print_z": legs - self.parameters.body_height,
            "lift": legs,
            "speed_x": legs,
            "speed_y": legs,
        }
        self._fresh = {name: value[:1].copy() for name, value in self._state.items()}

    def _restart(self, mask: NDArray[np.bool_]) -> None:
        super()._restart(mask)
        self._state = {name: np.where(mask[:, None], self._fresh[name], value) for name, value in self._state.items()}

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        p = self.parameters
        rows = observation.astype(np.float64)
        senses = sense(rows)
        command = rows[:, OBSERVATION["command"]]
        wanted = self._follow(command)
        error_x, error_y = senses.velocity[0] - wanted[:, 0:1], senses.velocity[1] - wanted[:, 1:2]
        error_yaw = senses.yaw_rate - wanted[:, 2:3]
        error = np.sqrt(error_x * error_x + error_y * error_y)
        brace = self._brace(senses.velocity, wanted)
        self._pace(error, brace)
        cycle = self._gait.legs(self._phase)
        plane = self._feel(senses, cycle, brace)
        gait = self._asked(wanted, error_x, error_y, error_yaw)
        self._step(senses, cycle, gait, (error_x, error_y, error_yaw), brace)
        feet = self._planted(senses, cycle, (error_x, error_y, error_yaw), brace, plane)
        joints = self._blended(self._joints(feet, cycle, brace), p.blend_time)
        return to_actions(joints)

    def _follow(self, command: Floats) -> Floats:
        """The velocity wanted now, (n, 3): the command, on rough ground less of it, approached within the limits."""
        p, state = self.parameters, self._state
        goal = command * (1.0 - state["brace"])
        rough, steep = p.caution * state["roughness"], p.slope_caution * self._steepness()
        goal = goal / (1.0 + rough * rough + steep * steep)
        reach = CONTROL_PERIOD * np.array([p.linear_acceleration, p.linear_acceleration, p.yaw_acceleration])
        state["wanted"] = state["wanted"] + np.clip(goal - state["wanted"], -reach, reach)
        return state["wanted"]

    def _brace(self, velocity: Vector, wanted: Floats) -> Floats:
        """How far all feet are down to slide to rest, 0 … 1; quickly on and slowly off, (n, 1)."""
        p, state = self.parameters, self._state
        due = np.clip((_length(velocity) - _length(_columns(wanted)) - p.brace_error) / BRACE_RANGE, 0.0, 1.0)
        due = np.maximum(due, np.clip((self._steepness() - p.slope_brace) / STEEP_RANGE, 0.0, 1.0))
        change = np.clip(due - state["brace"], -CONTROL_PERIOD / p.brace_release, CONTROL_PERIOD / BRACE_TIME)
        state["brace"] = state["brace"] + change
        return state["brace"]

    def _steepness(self) -> Floats:
        """Slope of the ground, m/m, (n, 1)."""
        slope = self._state["slope"]
        steepness: Floats = np.sqrt(slope[:, 0:1] * slope[:, 0:1] + slope[:, 1:2] * slope[:, 1:2])
        return steepness

    def _pace(self, error: Floats, brace: Floats) -> None:
        """Move the clock on: faster while a push is being caught, not at all while the feet are down."""
        p = self.parameters
        hurry = 1.0 + p.hurry * np.clip(error - p.capture_threshold, 0.0, 1.0)
        pace = (p.frequency * hurry * (1.0 - brace))[:, 0]
        self._phase = (self._phase + TURN * CONTROL_PERIOD * pace) % TURN
        self._ticks = self._ticks + 1.0

    def _feel(self, senses: Senses, cycle: LegCycle, brace: Floats) -> Plane:
        """The ground plane, its slope smoothed; keeps the footprints and the roughness up to date."""
        p, state = self.parameters, self._state
        prints = ground_plane.carried(
            (state["print_x"], state["print_y"], state["print_z"]), senses.velocity, senses.yaw_rate, CONTROL_PERIOD
        )
        first = self._ticks[:, None] == 1.0
        standing = (~cycle.swing & (cycle.progress > SETTLED)) | (brace > 0.5) | first
        prints = ground_plane.renewed(prints, senses.feet, standing)
        state["print_x"], state["print_y"], state["print_z"] = prints
        height, forward, lateral = ground_plane.fitted(prints)
        share = CONTROL_PERIOD / (CONTROL_PERIOD + p.plane_filter)
        slope = np.concatenate((forward, lateral), axis=-1)
        offset = slope - state["slope"]
        state["slope"] = state["slope"] + share * offset
        residual = ground_plane.above((height, forward, lateral), prints)
        uneven = np.sqrt(0.25 * ground_plane.total(residual * residual))
        uneven = uneven + 0.25 * np.sqrt(offset[:, 0:1] * offset[:, 0:1] + offset[:, 1:2] * offset[:, 1:2])
        rise = np.clip(uneven - EVEN, 0.0, LARGEST_ROUGHNESS) - state["roughness"]
        state["roughness"] = state["roughness"] + np.where(rise > 0.0, share, CONTROL_PERIOD / ROUGHNESS_MEMORY) * rise
        return height, state["slope"][:, 0:1], state["slope"][:, 1:2]

    def _asked(self, wanted: Floats, error_x: Floats, error_y: Floats, error_yaw: Floats) -> Vector:
        """Velocity of the gait: feedforward of the wanted one and the integral of the small errors."""
        p, state = self.parameters, self._state
        error = np.concatenate((error_x, error_y, error_yaw), axis=-1)
        small = (np.abs(error) < SMALL_ERROR).all(axis=-1, keepdims=True)
        gain = CONTROL_PERIOD * np.array([p.integral_gain, p.integral_gain, p.yaw_integral_gain])
        correction = state["correction"] - np.where(small, gain * error, 0.0)
        state["correction"] = np.clip(correction, -LARGEST_CORRECTION, LARGEST_CORRECTION)
        asked = np.array([p.forward_gain, p.lateral_gain, p.yaw_gain]) * wanted + state["correction"]
        forward, lateral, yaw_rate = _columns(asked)
        return forward + p.forward_bias, lateral, yaw_rate

    def _step(self, senses: Senses, cycle: LegCycle, gait: Vector, errors: Vector, brace: Floats) -> None:
        """Move the planned feet: the standing ones with the ground, the swinging ones towards their footholds."""
        p, state = self.parameters, self._state
        x, y = state["foot_x"], state["foot_y"]
        lifted = cycle.swing & (state["swinging"] == 0.0)
        state["swinging"] = cycle.swing.astype(np.float64)
        start_x = np.where(lifted, x, state["start_x"])
        start_y = np.where(lifted, y, state["start_y"])
        state["start_x"], state["start_y"] = start_x, start_y

        share = CONTROL_PERIOD / (CONTROL_PERIOD + p.velocity_filter)
        slow = state["velocity"]
        slow = slow + share * (np.concatenate(errors[:2], axis=-1) - slow)
        state["velocity"] = slow
        neutral = self._under_hips(senses.frame, self._neutral)
        neutral = (
            neutral[0] + p.slope_shift * state["slope"][:, 0:1],
            neutral[1] + p.slope_shift * state["slope"][:, 1:2],
        )
        stance_time = p.neutral_share * p.duty / p.frequency
        ahead = raibert(
            neutral,
            gait,
            stance_time,
            (slow[:, 0:1], slow[:, 1:2], errors[2]),
            (p.raibert_gain, p.raibert_lateral, p.yaw_step),
        )
        more = captured((slow[:, 0:1], slow[:, 1:2]), p.capture_threshold, p.capture_gain)
        foothold = within_reach(ahead[0] + more[0], ahead[1] + more[1], neutral)

        drift_x, drift_y = passing(x, y, gait)
        given = p.stance_yield
        moved_x = x + CONTROL_PERIOD * (drift_x - given * errors[0])
        moved_y = y + CONTROL_PERIOD * (drift_y - given * errors[1])
        standing_x, standing_y = within_reach(moved_x, moved_y, neutral)
        swing_time = (1.0 - p.duty) / p.frequency
        swing_x = swung(start_x, foothold[0], drift_x * swing_time, cycle.progress)
        swing_y = swung(start_y, foothold[1], drift_y * swing_time, cycle.progress)
        wide_x, wide_y = self._under_hips(senses.frame, self._wide)
        wide_x = (
            wide_x
            + p.slope_shift * state["slope"][:, 0:1]
            + np.clip(p.brace_lead * errors[0], -LARGEST_LEAD, LARGEST_LEAD)
        )
        wide_y = (
            wide_y
            + p.slope_shift * state["slope"][:, 1:2]
            + np.clip(p.brace_lead * errors[1], -LARGEST_LEAD, LARGEST_LEAD)
        )
        x = np.where(cycle.swing, swing_x, standing_x)
        y = np.where(cycle.swing, swing_y, standing_y)
        x = x + brace * (wide_x - x)
        y = y + brace * (wide_y - y)
        state["speed_x"] = (x - state["foot_x"]) / CONTROL_PERIOD
        state["speed_y"] = (y - state["foot_y"]) / CONTROL_PERIOD
        state["foot_x"], state["foot_y"] = x, y

    def _under_hips(self, frame: LevelFrame, places: Planar) -> Planar:
        """Points of the trunk's plane in the level frame, (n, 4) each: legs hang along gravity from there."""
        x, y, _ = frame.to_level((places[0], places[1], np.zeros(4)))
        return x, y

    def _planted(self, senses: Senses, cycle: LegCycle, errors: Vector, brace: Floats, plane: Plane) -> Vector:
        """Feet in the base frame, m: the plan, and what the standing legs do about errors."""
        p, state = self.parameters, self._state
        x, y = state["foot_x"], state["foot_y"]
        slope_x, slope_y = plane[1], plane[2]
        weight = np.maximum(load(cycle), brace)
        roughness = state["roughness"]
        tall = p.body_height + p.rough_height * roughness + p.slope_height * self._steepness()
        tall = tall + brace * (p.brace_height - tall)
        missing = tall + plane[0]
        answer = p.height_gain * missing - p.height_damping * senses.velocity[2]
        uneven = ground_plane.above(plane, (state["print_x"], state["print_y"], state["print_z"]))
        z = slope_x * x + slope_y * y - tall
        z = z + weight * (p.conform * uneven - answer)
        lifted = (p.step_height + p.rough_step * roughness) * lift(cycle) * (1.0 - brace)
        lead = p.servo_lead / CONTROL_PERIOD
        z = z + lifted + lead * (lifted - state["lift"])
        state["lift"] = lifted
        x = x + p.servo_lead * state["speed_x"]
        y = y + p.servo_lead * state["speed_y"]
        # Standing feet are pushed along with the error, so that the trunk is pushed against it.
        push_x = p.stance_push * errors[0] - p.yaw_push * errors[2] * y
        push_y = p.stance_push * errors[1] + p.yaw_push * errors[2] * x
        still = weight * (1.0 - brace)
        x, y, z = senses.frame.to_body((x + still * push_x, y + still * push_y, z))
        # To turn the trunk by (roll, pitch) its feet are to turn by the opposite.
        roll = p.slope_share * np.arctan(slope_y) - senses.frame.roll
        pitch = -p.slope_share * np.arctan(slope_x) - senses.frame.pitch
        limit = LARGEST_TILT_ERROR
        gain = weight * (p.tilt_gain + brace * (p.brace_tilt_gain - p.tilt_gain))
        damping = weight * (p.tilt_damping + brace * (p.brace_tilt_damping - p.tilt_damping))
        roll = gain * np.clip(roll, -limit, limit) - damping * senses.roll_rate
        pitch = gain * np.clip(pitch, -limit, limit) - damping * senses.pitch_rate
        return x - pitch * z, y + roll * z, z - roll * y + pitch * x

    def _joints(self, feet: Vector, cycle: LegCycle, brace: Floats) -> Floats:
        """Joint targets (n, 12), rad, of feet in the base frame."""
        x, y, z = feet
        x, y = x - HIP_POSITIONS[:, 0], y - HIP_POSITIONS[:, 1]
        hip, thigh, calf = leg_angles(x, y, np.minimum(z, -0.08))
        force = np.maximum(load(cycle), 0.5 * brace) * self.parameters.stance_load
        return np.stack(held_up(hip, thigh, calf, x, y, force), axis=-1).reshape(-1, NUM_JOINTS)
