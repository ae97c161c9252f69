"""Signals of one failed episode, and quantities derived from them, as input of the rules for causes."""

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
THRESHOLDS: dict[str, tuple[float, str, str]] = json.loads(_FILE.read_text(encoding="utf-8"))
"""Name of a threshold -> value, unit, and reason for the value, for all rules that determine causes."""
SHANK_SAMPLES = np.array([0.25, 0.5, 0.75, 1.0])
"""Sample points on a shank, as fractions of its length from the knee (0) to the foot (1), (4,)."""


@dataclass(frozen=True)
class EpisodeSignals:
    """Signals of one failed episode, with one row for each control step before the episode's end.

    The episode is selected by its index `number` among the recorded `episodes`.
    """

    episodes: Episodes
    scenario: Scenario
    number: int
    """Index of the failed episode among the recorded `episodes`."""

    @cached_property
    def end(self) -> int:
        """First control step after which the robot had fallen; the number of steps if it did not fall.

        The recorded signals have no meaning from this step on.
        """
        return int(self.episodes.fall_step[self.number])

    @property
    def fell(self) -> bool:
        """True if the robot fell or the simulation diverged before the time limit."""
        return self.end < self.episodes.steps

    def signal(self, name: str) -> Floats:
        """Return the recorded signal `name` of this episode up to its end, (end, …), as float64."""
        return np.asarray(getattr(self.episodes, name)[: self.end, self.number], np.float64)

    def threshold(self, name: str) -> float:
        """Return the threshold `name`; lengths, times and speeds are scaled to the size of the robot's legs."""
        value, unit, _ = THRESHOLDS[name]
        return value * (scale_factor(self.episodes.robot, unit) if unit in ("m", "s", "m/s") else 1.0)

    def steps(self, name: str) -> int:
        """Convert the threshold `name`, a time in s, to a number of control steps, at least 1."""
        return max(1, round(self.threshold(name) / self.episodes.dt))

    @cached_property
    def sampled(self) -> EpisodeSample:
        """Random quantities of the episode (friction, pushes, delays, …), drawn again from the episode's seed."""
        seed = int(self.episodes.seeds[self.number])
        return EpisodeSample(self.episodes.robot, self.scenario, seed, 0, self.episodes.dt)

    @cached_property
    def rotation(self) -> Floats:
        """Rotation matrix of the trunk from the base frame to the world frame, (end, 3, 3)."""
        return np.moveaxis(np.array(rotation_matrix(to_components(self.signal("quaternion")))), -1, 0)

    @cached_property
    def velocity(self) -> Floats:
        """Horizontal velocity of the trunk, world frame, x and y, (end, 2), m/s."""
        yaw = np.arctan2(self.rotation[:, 1, 0], self.rotation[:, 0, 0])
        rotation_world_from_heading = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return np.asarray(np.einsum("ijt,tj->ti", rotation_world_from_heading, self.signal("heading_velocity")[:, :2]))

    @cached_property
    def time_constant(self) -> float:
        """Time constant with which a standing robot topples, √(h / g) with the trunk's standing height h, s."""
        return float(np.sqrt(self.episodes.robot.home_height / GRAVITY))

    @cached_property
    def capture_point_offset(self) -> Floats:
        """Capture point (Pratt et al. 2006) relative to the mean position of the feet.

        It is in the world frame, x and y, (end, 2), m. Its distance from the feet shows how far the robot is off
        balance.
        """
        feet = self.signal("foot_position")[:, :, :2].mean(axis=1)
        return np.asarray(self.signal("position")[:, :2] + self.velocity * self.time_constant - feet)

    @cached_property
    def shank(self) -> tuple[Floats, Floats]:
        """Positions and velocities of the sample points on the four shanks.

        The four points of a shank lie at the fractions SHANK_SAMPLES of its length; the last one is the foot. A
        velocity is the mean over the control step before. Both arrays are in the world frame, (end, 4 legs, 4 points,
        3), m and m/s.
        """
        to_knees = replace(self.episodes.robot, calf_length=0.0)
        knee = feet_in_world(to_knees, self.signal("position"), self.rotation, self.signal("joint_position"))[
            :, :, None
        ]
        points = knee + SHANK_SAMPLES[:, None] * (self.signal("foot_position")[:, :, None] - knee)
        return points, np.diff(points, axis=0, prepend=points[:1]) / self.episodes.dt

    def ground(self, points: Floats) -> Floats:
        """Return the height of the ground at the positions `points`, world frame, (…, 2 or 3), m."""
        return np.asarray(self.scenario.terrain.height(points[..., 0], points[..., 1]), np.float64)

    @cached_property
    def onset(self) -> int:
        """Control step at which the failure begins.

        It is the first step after the last one in which tilt, trunk height and capture point were all within their
        usual ranges.
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
        """Return the mask of the control steps in which a signal is unusually large.

        The signal must exceed `limit` and a range that is usual in this episode. The usual range is computed from the
        steps well before the fall. Only `limit` counts if there are too few of these steps.

        Args:
            signal: Signal of each step, (end,).
            limit: Threshold, in the unit of the signal.

        Returns:
            True for steps with an unusually large signal, (end,).
        """
        usual = signal[self.steps("start") : max(0, self.end - self.steps("before the fall"))]
        if len(usual) > self.steps("stride"):
            quantile = np.quantile(usual, self.threshold("usual share"))
            max_limit = limit + self.threshold("usual at most") * abs(limit)
            limit = min(max(limit, float(quantile + self.threshold("usual margin") * abs(quantile))), max_limit)
        return np.asarray(signal > limit)

    @cached_property
    def window(self) -> slice:
        """Control steps in which the rules search for causes.

        They are the steps around the onset of the failure. If the robot did not fall, they are all steps after the
        first second.
        """
        if not self.fell:
            return slice(self.episodes.settling, self.end)
        end = min(self.end, self.onset + self.steps("look on"))
        return slice(max(0, min(self.onset, end - 1) - self.steps("look back")), end)
