"""A height scan of the ground about the robot: as a value in physical units, and those of n robots."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, cast

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array, EnvIndices, ScalarOrBatch
from quad_env.config import Bounds, NonNegative, Positive
from quad_env.physics.state import QuadState, to_heading
from quad_env.robots.robot import Robot
from quad_env.scenarios.disturbances import Delay
from quad_env.scenarios.episode import EpisodeSample
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import Terrain
from quad_env.sensing.channel import Channel, Clock, Noise
from quad_env.sensing.suite import Sampled
from quad_env.task.observations import ObservationTable, ObservationTerm, observation_table

UNSEEN = -2.0
"""Least that a point reads, m: its ground is so deep, or not known yet."""
Count = Annotated[int, Bounds("at least 0", 0)]
MOST_POINTS = 10_000
"""Of a scan."""
_SCALE = 2.5
"""A trunk 0.4 m above the ground makes it -1."""


@dataclass(frozen=True)
class HeightScan(Sampled):
    """Ground heights on a grid about the trunk's centre, in the heading frame: x ahead, y to the left, both level.

    A value is the height of the ground there minus that of the trunk's centre, m, about −0.36 under a robot that
    stands; clipped to ±2 m. Nothing hides behind a step, and the robot's own legs are not seen. A sample that is seen
    late is of the place, heading and height of the trunk when it was taken. A scenario's observation latency and noise
    come on top.
    """

    delay: Delay = 0.0
    """s from a sample to when it is seen, at the first control step that is not earlier"""
    ahead: Count = 8
    """Points ahead of the trunk's centre"""
    behind: Count = 8
    """Points behind it"""
    aside: Count = 5
    """Points to each side of it"""
    spacing: Positive = 0.1
    """m between two points. The grid of the defaults is that of legged_gym's `measured_points_x` and `_y`"""
    noise: NonNegative = 0.0
    """m, standard deviation of the white noise on each point of each sample"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if math.prod(self._grid) > MOST_POINTS:
            raise ValueError(f"a height scan has at most {MOST_POINTS} points, got {self._grid}")

    @property
    def _grid(self) -> tuple[int, int]:
        return self.behind + self.ahead + 1, 2 * self.aside + 1

    @property
    def grid(self) -> Array:
        """Every point of the grid: x and y, heading frame, (rows, columns, 2), m; rows from the hindmost, in each from
        the right to the left."""
        x = self.spacing * np.arange(-self.behind, self.ahead + 1)
        y = self.spacing * np.arange(-self.aside, self.aside + 1)
        return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)

    @property
    def points(self) -> Array:
        """x and y of the points in the order of the term's entries, heading frame, (p, 2), m."""
        return self.grid.reshape(-1, 2)

    @property
    def term(self) -> ObservationTerm:
        """Its term of the observation."""
        unit = "m, ground minus trunk's centre"
        return ObservationTerm("height_scan", math.prod(self._grid), unit, -UNSEEN, _SCALE)


@cache
def table_with(robot: Robot, scan: HeightScan | None, user_terms: tuple[ObservationTerm, ...] = ()) -> ObservationTable:
    """Return the observation table of a robot.

    Args:
        robot: The robot.
        scan: Its height scan, the next term; None for none.
        user_terms: Terms of a user, the last.

    Returns:
        The table, the same object for the same arguments.
    """
    return observation_table(robot, *(() if scan is None else (scan.term,)), *user_terms)


class Scanner:
    """Noise, rate and delay of n robots' height scans; `latency` and `noise` come on top, s and m. One that is `lost`
    shows unseen ground at every point."""

    def __init__(
        self,
        scan: HeightScan,
        terrain: Terrain,
        num_envs: int,
        control_rate: float,
        latency: float,
        noise: float,
        lost: bool = False,
    ) -> None:
        self._terrain, self._points, self._lost = terrain, scan.points, lost
        width, deviation = len(self._points), float(np.hypot(scan.noise, noise))
        self._channel = Channel(num_envs, width, scan.rate, scan.delay + latency, control_rate)
        self._noise = Noise(num_envs, np.full(width, deviation, np.float32)) if deviation else None

    def reset(self, rows: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Start these episodes of those robots."""
        if self._noise is not None:
            for row, episode in zip(rows, episodes, strict=True):
                self._noise.reset(row, episode.streams.scan_noise)

    def scan(self, state: QuadState[ScalarOrBatch], clock: Clock, rows: EnvIndices) -> NDArray[np.float32]:
        """What those robots, (k,), whose `state` and `clock` these are, are shown now, (k, p)."""
        if self._lost:
            return np.full((len(rows), len(self._points)), UNSEEN, np.float32)
        due = np.flatnonzero(clock % self._channel.period == 0)
        if len(due):
            self._channel.record(self._sampled(state, clock[due], rows[due], due), clock[due], rows[due])
        return self._channel.value(clock, rows).astype(np.float32)

    def _sampled(self, state: QuadState[ScalarOrBatch], clock: Clock, rows: EnvIndices, which: EnvIndices) -> Array:
        """Fresh samples of some of the robots, whose rows of the state are `which`, (k, p)."""
        cos, minus_sin = to_heading(state.rotation, cast("Any", (1.0, 0.0)))
        x, y, z, cos, sin = (np.reshape(each, (-1, 1))[which] for each in (*state.position, cos, -minus_sin))
        ahead, left = self._points.T
        values: Array = self._terrain.height(x + (cos * ahead - sin * left), y + (sin * ahead + cos * left)) - z
        if self._noise is not None:
            values += self._noise.at(clock // self._channel.period, rows)
        return np.clip(values, UNSEEN, -UNSEEN, out=values)


def scanner_of(scan: HeightScan | None, scenario: Scenario, num_envs: int, control_rate: float) -> Scanner | None:
    """The scanner of n robots in that scenario; None without a scan, ValueError for what is none."""
    if scan is None:
        return None
    if not isinstance(scan, HeightScan):
        raise ValueError(f"height_scan is a quad_env.HeightScan or None, got {scan!r}; write quad_env.HeightScan(…)")
    late = 0 if scenario.latency is None else round(scenario.latency.observation * control_rate)
    noise = 0.0 if scenario.noise is None else scenario.noise.height_scan
    return Scanner(scan, scenario.terrain, num_envs, control_rate, late / control_rate, noise, scenario.scan_lost)
