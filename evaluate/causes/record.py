"""One failed episode as the rules of causes see it: its signals up to its end, and what follows from them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from evaluate.causes.thresholds import THRESHOLDS, at
from evaluate.measures.averages import Bools, Floats, planar
from evaluate.measures.episodes import Episodes
from quad_env.columns import of_robots
from quad_env.config import GRAVITY
from quad_env.physics.state import rotation_matrix
from quad_env.robots.kinematics import knees_in_world
from quad_env.robots.similarity import ratio
from quad_env.scenarios.episode import Episode
from quad_env.scenarios.scenario import Scenario

SHANK = np.array([0.25, 0.5, 0.75, 1.0])
"""Places on a shank that are looked at, from the knee, 0, to the foot, 1."""


@dataclass(frozen=True)
class Record:
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

    def of(self, name: str) -> Floats:
        """That signal, (end, …)."""
        return np.asarray(getattr(self.episodes, name)[: self.end, self.number], np.float64)

    def its(self, name: str) -> float:
        """A threshold for its robot."""
        unit = THRESHOLDS[name].unit
        return at(name) * (ratio(self.episodes.robot, unit) if unit in ("m", "s", "m/s") else 1.0)

    def steps(self, name: str) -> int:
        """Control steps of a threshold in s."""
        return max(1, round(self.its(name) / self.episodes.dt))

    @cached_property
    def drawn(self) -> Episode:
        """What the episode drew from its seed."""
        seed = int(self.episodes.seeds[self.number])
        return Episode(self.episodes.robot, self.scenario, seed, 0, self.episodes.dt)

    @cached_property
    def rotation(self) -> Floats:
        """From the base frame to the world frame, (end, 3, 3)."""
        return np.moveaxis(np.array(rotation_matrix(of_robots(self.of("quaternion")))), -1, 0)

    def in_world(self, heading: Floats) -> Floats:
        """Vectors of the heading frame, (end, 2 or 3), in the world's, (end, 2)."""
        nose = self.rotation[:, :2, 0] / np.maximum(planar(self.rotation[:, :, 0]), 1e-6)[:, None]
        ahead, left = heading[:, :1], heading[:, 1:2]
        return ahead * nose + left * np.stack((-nose[:, 1], nose[:, 0]), axis=-1)

    @cached_property
    def time_constant(self) -> float:
        """Of falling over from a stand, √(height / g), s."""
        return float(np.sqrt(self.episodes.robot.home_height / GRAVITY))

    @cached_property
    def capture(self) -> Floats:
        """Capture point as seen from the middle of the feet, world frame, (end, 2), m (Pratt et al. 2006)."""
        point = self.of("position")[:, :2] + self.in_world(self.of("heading_velocity")) * self.time_constant
        return point - self.of("foot_position")[:, :, :2].mean(axis=1)

    @cached_property
    def shank(self) -> tuple[Floats, Floats]:
        """Points of the shanks, the last that of the foot, and their velocities over the step before, world frame,
        (end, 4, 4, 3) each, m and m/s."""
        where = self.of("position"), self.rotation, self.of("joint_position")
        knee, foot = knees_in_world(self.episodes.robot, *where)[:, :, None], self.of("foot_position")[:, :, None]
        points = knee + SHANK[:, None] * (foot - knee)
        return points, np.diff(points, axis=0, prepend=points[:1]) / self.episodes.dt

    def ground(self, points: Floats) -> Floats:
        """Height of the ground below points, (…, 2 or 3), m."""
        return np.asarray(self.scenario.terrain.height(points[..., 0], points[..., 1]), np.float64)

    @cached_property
    def usual(self) -> slice:
        """Steps of its ordinary gait; empty where it failed early."""
        start = self.steps("start")
        return slice(start, max(start, self.end - self.steps("before the fall")))

    @cached_property
    def onset(self) -> int:
        """First step after the last moment at which tilt, height and capture point were as in its ordinary gait."""
        away = planar(self.capture) - planar(self.of("command")) * self.time_constant
        low = -self.of("height") / self.episodes.robot.home_height
        unusual = self._above(self.of("tilt"), self.its("tilt")) | self._above(away, self.its("capture"))
        unusual |= self._above(low, -self.its("height"))
        return int(np.flatnonzero(np.append(True, ~unusual)).max())

    def _above(self, signal: Floats, least: float) -> Bools:
        """Where a signal is above that and above what it nearly always is in its ordinary gait."""
        usual, known = signal[self.usual], self.steps("stride")
        most = np.quantile(usual, at("usual share")) if len(usual) > known else least
        return np.asarray(signal > max(least, most + at("usual margin") * abs(most)))

    @cached_property
    def window(self) -> slice:
        """Steps in which the cause is looked for: about the onset, or of an upright failure all after the first second."""
        if not self.fell:
            return slice(self.episodes.settling, self.end)
        end = min(self.end, self.onset + self.steps("look on"))
        return slice(max(0, min(self.onset, end - 1) - self.steps("look back")), end)

    def late(self, seconds: float) -> int:
        """Whole control steps of a delay."""
        return round(seconds / self.episodes.dt)
