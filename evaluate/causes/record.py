"""One failed episode as the rules of causes see it: its signals up to its end, and what follows from them."""

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
"""Value, unit and reason of every threshold of the rules, by name."""
SHANK_SAMPLES = np.array([0.25, 0.5, 0.75, 1.0])
"""Places on a shank that are looked at, from the knee, 0, to the foot, 1."""


@dataclass(frozen=True)
class EpisodeSignals:
    """Episode `number` of `episodes`; arrays have a row a control step, up to the fall or the time limit."""

    episodes: Episodes
    scenario: Scenario
    number: int

    @cached_property
    def end(self) -> int:
        """Control step of the fall, none of whose signals means anything; the time limit without one."""
        return int(self.episodes.fall_step[self.number])

    @property
    def fell(self) -> bool:
        """Whether it ended by a fall or a divergence."""
        return self.end < self.episodes.steps

    def of(self, signal: str) -> Floats:
        """That signal of `Episodes`, (end, …)."""
        return np.asarray(getattr(self.episodes, signal)[: self.end, self.number], np.float64)

    def threshold(self, threshold: str) -> float:
        """A threshold for its robot: lengths, times and speeds are SimpleQuad's, and go with the length of the legs."""
        value, unit, _ = THRESHOLDS[threshold]
        return value * (scale_factor(self.episodes.robot, unit) if unit in ("m", "s", "m/s") else 1.0)

    def steps(self, threshold: str) -> int:
        """Control steps of a threshold in s."""
        return max(1, round(self.threshold(threshold) / self.episodes.dt))

    @cached_property
    def sampled(self) -> EpisodeSample:
        """What the episode drew from its seed."""
        seed = int(self.episodes.seeds[self.number])
        return EpisodeSample(self.episodes.robot, self.scenario, seed, 0, self.episodes.dt)

    @cached_property
    def rotation(self) -> Floats:
        """From the base frame to the world frame, (end, 3, 3)."""
        return np.moveaxis(np.array(rotation_matrix(to_components(self.of("quaternion")))), -1, 0)

    @cached_property
    def velocity(self) -> Floats:
        """Of the trunk, world frame, (end, 2), m/s."""
        yaw = np.arctan2(self.rotation[:, 1, 0], self.rotation[:, 0, 0])
        from_heading = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return np.asarray(np.einsum("ijt,tj->ti", from_heading, self.of("heading_velocity")[:, :2]))

    @cached_property
    def time_constant(self) -> float:
        """Of falling over from a stand, √(height / g), s."""
        return float(np.sqrt(self.episodes.robot.home_height / GRAVITY))

    @cached_property
    def capture_point_offset(self) -> Floats:
        """Capture point from the middle of the feet, world frame, (end, 2), m (Pratt et al. 2006)."""
        feet = self.of("foot_position")[:, :, :2].mean(axis=1)
        return np.asarray(self.of("position")[:, :2] + self.velocity * self.time_constant - feet)

    @cached_property
    def shank(self) -> tuple[Floats, Floats]:
        """Points of the shanks, the last that of the foot, and their velocities over the step before, world frame,
        (end, 4, 4, 3) each, m and m/s."""
        to_knees = replace(self.episodes.robot, calf_length=0.0)
        knee = feet_in_world(to_knees, self.of("position"), self.rotation, self.of("joint_position"))[:, :, None]
        points = knee + SHANK_SAMPLES[:, None] * (self.of("foot_position")[:, :, None] - knee)
        return points, np.diff(points, axis=0, prepend=points[:1]) / self.episodes.dt

    def ground(self, points: Floats) -> Floats:
        """Height of the ground below points, (…, 2 or 3), m."""
        return np.asarray(self.scenario.terrain.height(points[..., 0], points[..., 1]), np.float64)

    @cached_property
    def onset(self) -> int:
        """First step after the last moment at which tilt, height and capture point were as in its ordinary gait."""
        away = planar(self.capture_point_offset) - planar(self.of("command")) * self.time_constant
        low = -self.of("height") / self.episodes.robot.home_height
        unusual = self._exceeds_usual(self.of("tilt"), self.threshold("tilt")) | self._exceeds_usual(
            away, self.threshold("capture")
        )
        return int(
            np.flatnonzero(np.append(True, ~(unusual | self._exceeds_usual(low, -self.threshold("height"))))).max()
        )

    def _exceeds_usual(self, signal: Floats, least: float) -> Bools:
        """Where a signal is above that and above what it nearly always is in the ordinary gait, where that is known."""
        usual = signal[self.steps("start") : max(0, self.end - self.steps("before the fall"))]
        if len(usual) > self.steps("stride"):
            most = np.quantile(usual, self.threshold("usual share"))
            highest = least + self.threshold("usual at most") * abs(least)
            least = min(max(least, float(most + self.threshold("usual margin") * abs(most))), highest)
        return np.asarray(signal > least)

    @cached_property
    def window(self) -> slice:
        """Steps in which the cause is looked for: about the onset, or after the first second of an upright failure."""
        if not self.fell:
            return slice(self.episodes.settling, self.end)
        end = min(self.end, self.onset + self.steps("look on"))
        return slice(max(0, min(self.onset, end - 1) - self.steps("look back")), end)
