"""Recorded signals of one failed episode, and derived quantities, for the search for its cause."""

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from evaluate.measures.averages import Bools, Floats, planar
from evaluate.measures.episodes import Episodes
from quad_env.columns import to_components
from quad_env.config import GRAVITY
from quad_env.physics.state import rotation_matrix
from quad_env.robots.kinematics import feet_in_world
from quad_env.robots.similarity import scale_factor
from quad_env.scenarios.episode import EpisodeSample
from quad_env.scenarios.scenario import Scenario

_FILE = Path(__file__).with_name("thresholds.json")
"""File with the thresholds of the rules that determine the cause of a failed episode."""
THRESHOLDS: dict[str, tuple[float, str, str]] = json.loads(_FILE.read_text(encoding="utf-8"))
"""Thresholds of the rules for causes of failure: name -> (value, unit, reason for the value).

The values hold for the robot SimpleQuad. The file thresholds.json contains them.
"""
SHANK_SAMPLES = np.array([0.25, 0.5, 0.75, 1.0])
"""Sample points on a shank, as fractions of its length from the knee (0) to the foot (1), (4,)."""


@dataclass(frozen=True)
class EpisodeSignals:
    """Signals of one failed episode, as input of the rules that determine the cause of the failure.

    Each signal has one row for each control step before the robot's fall, or before the time limit.
    """

    episodes: Episodes
    """Recorded signals of n episodes; this object describes the one with the index `number`."""
    scenario: Scenario
    """Scenario (terrain, disturbances and commands) of the episodes."""
    number: int
    """Index of the failed episode among the recorded `episodes`."""

    @cached_property
    def end(self) -> int:
        """Index of the control step during which the robot fell; the number of steps if it did not fall.

        The recorded signals have no meaning from this step on.
        """
        return int(self.episodes.fall_step[self.number])

    @property
    def fell(self) -> bool:
        """True if the robot fell or the simulation diverged before the time limit."""
        return self.end < self.episodes.steps

    def signal(self, name: str) -> Floats:
        """Return the recorded signal `name` before the fall or the time limit, one row per step, (steps, …).

        The names, for example `tilt`, are fields of `Episodes`. The values are converted to float64.
        """
        return np.asarray(getattr(self.episodes, name)[: self.end, self.number], np.float64)

    def threshold(self, name: str) -> float:
        """Return the threshold `name` of THRESHOLDS, scaled to this robot, in m, s, m/s, rad or without unit.

        Lengths, times and speeds are scaled from the leg length of SimpleQuad to the leg length of this robot.
        """
        value, unit, _ = THRESHOLDS[name]
        return value * (scale_factor(self.episodes.robot, unit) if unit in ("m", "s", "m/s") else 1.0)

    def steps(self, name: str) -> int:
        """Convert the threshold `name` of THRESHOLDS, a time in s, to a number of control steps, at least 1."""
        return max(1, round(self.threshold(name) / self.episodes.dt))

    @cached_property
    def sampled(self) -> EpisodeSample:
        """Random conditions of this episode, for example friction, pushes and delays.

        The conditions are not recorded. They are drawn again from the seed of the episode, with the same result.
        """
        seed = int(self.episodes.seeds[self.number])
        return EpisodeSample(self.episodes.robot, self.scenario, seed, 0, self.episodes.dt)

    @cached_property
    def rotation(self) -> Floats:
        """Rotation matrix from the base frame (fixed to the trunk) to the world frame, (steps, 3, 3).

        It has one row for each control step before the fall or the time limit.
        """
        return np.moveaxis(np.array(rotation_matrix(to_components(self.signal("quaternion")))), -1, 0)

    @cached_property
    def velocity(self) -> Floats:
        """Horizontal velocity of the trunk, world frame, x and y, (steps, 2), m/s.

        It has one row for each control step before the fall or the time limit.
        """
        yaw = np.arctan2(self.rotation[:, 1, 0], self.rotation[:, 0, 0])
        rotation_world_from_heading = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return np.asarray(np.einsum("ijt,tj->ti", rotation_world_from_heading, self.signal("heading_velocity")[:, :2]))

    @cached_property
    def time_constant(self) -> float:
        """Time constant √(h / g) of the linear inverted pendulum, with which a standing robot topples, s.

        h is the height of the trunk in the home pose, m, and g is the gravitational acceleration, m/s².
        """
        return float(np.sqrt(self.episodes.robot.home_height / GRAVITY))

    @cached_property
    def capture_point_offset(self) -> Floats:
        """Capture point minus the mean position of the four feet, world frame, x and y, (steps, 2), m.

        It has one row for each control step before the fall or the time limit. The capture point is the point on the
        ground at which the robot would have to step to come to rest (Pratt et al. 2006). The longer the vector from the
        feet to this point is, the more the robot is off balance.
        """
        feet = self.signal("foot_position")[:, :, :2].mean(axis=1)
        return np.asarray(self.signal("position")[:, :2] + self.velocity * self.time_constant - feet)

    @cached_property
    def shank(self) -> tuple[Floats, Floats]:
        """Pair of arrays: positions, m, and velocities, m/s, of four points on each of the four shanks.

        Both arrays are in the world frame, (steps, 4 legs, 4 points, 3), with one row for each control step before the
        fall or the time limit. The points lie at the fractions SHANK_SAMPLES of the shank's length, from the knee to
        the foot. The last point is the foot. Each velocity is the mean since the previous control step.
        """
        to_knees = replace(self.episodes.robot, calf_length=0.0)
        knee = feet_in_world(to_knees, self.signal("position"), self.rotation, self.signal("joint_position"))[
            :, :, None
        ]
        points = knee + SHANK_SAMPLES[:, None] * (self.signal("foot_position")[:, :, None] - knee)
        return points, np.diff(points, axis=0, prepend=points[:1]) / self.episodes.dt

    def ground(self, points: Floats) -> Floats:
        """Return the height of the ground at the horizontal position of each of the `points`, (…), m.

        Args:
            points: Positions, world frame, m, (…, 2) or (…, 3). Only the coordinates x and y count.

        Returns:
            Height of the ground, (…), m.
        """
        return np.asarray(self.scenario.terrain.height(points[..., 0], points[..., 1]), np.float64)

    @cached_property
    def onset(self) -> int:
        """Index of the control step at which the failure begins.

        From this step until the fall, the tilt, the height of the trunk or the capture point is always outside of its
        usual range. In the step before, all three were within their usual ranges. The capture point is the point on the
        ground at which the robot would have to step to come to rest.
        """
        offset = planar(self.capture_point_offset) - planar(self.signal("command")) * self.time_constant
        depth = -self.signal("height") / self.episodes.robot.home_height
        is_unusual = (
            self._exceeds_usual(self.signal("tilt"), self.threshold("tilt"))
            | self._exceeds_usual(offset, self.threshold("capture"))
            | self._exceeds_usual(depth, -self.threshold("height"))
        )
        return int(np.flatnonzero(np.append(True, ~is_unusual)).max())

    def _exceeds_usual(self, signal: Floats, limit: float) -> Bools:
        """Return the mask of the control steps in which a signal is larger than usual in this episode.

        The largest usual value is computed from a quantile of the signal in the control steps well before the fall. A
        value is unusual if it exceeds both `limit` and this usual value. If there are too few control steps well before
        the fall, every value above `limit` is unusual.

        Args:
            signal: Value of the signal in each control step before the fall or the time limit, (steps,).
            limit: Smallest threshold for an unusual value, in the unit of the signal.

        Returns:
            True for control steps with an unusually large value, (steps,).
        """
        usual = signal[self.steps("start") : max(0, self.end - self.steps("before the fall"))]
        if len(usual) > self.steps("stride"):
            quantile = np.quantile(usual, self.threshold("usual share"))
            max_limit = limit + self.threshold("usual at most") * abs(limit)
            limit = min(max(limit, float(quantile + self.threshold("usual margin") * abs(quantile))), max_limit)
        return np.asarray(signal > limit)

    @cached_property
    def window(self) -> slice:
        """Range of the control steps in which the rules search for the cause of the failure.

        If the robot fell, the range extends from shortly before to shortly after the onset of the failure. If it did
        not fall, the range contains all control steps after the first second of the episode.
        """
        if not self.fell:
            return slice(self.episodes.settling, self.end)
        end = min(self.end, self.onset + self.steps("look on"))
        return slice(max(0, min(self.onset, end - 1) - self.steps("look back")), end)
