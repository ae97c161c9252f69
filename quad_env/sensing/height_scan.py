"""Height scan: settings and simulation of a sensor that measures the ground heights around a robot."""

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
from quad_env.sensing.sensor_models import Channel, Clock, Noise, delay_to_steps
from quad_env.sensing.suite import Sampled
from quad_env.task.observations import ObservationTable, ObservationTerm, observation_table

UNSEEN = -2.0
"""Scan value of a point where the ground is 2 m or more below the trunk's centre, or cannot be seen, m."""
Count = Annotated[int, Bounds("at least 0", 0)]
MAX_POINTS = 10_000
"""Maximum number of grid points of a height scan, which limits the size of the observation."""
_SCALE = 2.5
"""Factor with which learners multiply the scan values, 1/m; a trunk 0.4 m above the ground then gives -1."""


@dataclass(frozen=True)
class HeightScan(Sampled):
    """Settings of the height scan: ground heights on a grid around the trunk's centre, heading frame.

    The grid is level, with the axes x forward and y to the left. Each value is the ground height at a point minus the
    height of the trunk's centre, m. The values are clipped to ±2 m; under a standing robot they are about −0.36 m.
    Nothing occludes the ground, and the scan does not see the robot's own legs. The grid of a delayed sample lies where
    the trunk was when the sample was taken. The scenario's observation latency and noise are added to the delay and
    noise of the scan.
    """

    delay: Delay = 0.0
    """Time from a measurement until it can be read, rounded up to whole control steps, s"""
    ahead: Count = 8
    """Number of grid points in front of the trunk's centre"""
    behind: Count = 8
    """Number of grid points behind the trunk's centre"""
    aside: Count = 5
    """Number of grid points to each side of the trunk's centre"""
    spacing: Positive = 0.1
    """Distance between two grid points, m; the default grid is legged_gym's `measured_points_x` and `_y`"""
    noise: NonNegative = 0.0
    """Standard deviation of the white noise on each point of each sample, m"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if math.prod(self._grid) > MAX_POINTS:
            raise ValueError(f"a height scan has at most {MAX_POINTS} points, got {self._grid}")

    @property
    def _grid(self) -> tuple[int, int]:
        """Number of grid points along x, then along y."""
        return self.behind + self.ahead + 1, 2 * self.aside + 1

    @property
    def grid(self) -> Array:
        """Position x, y of every grid point, heading frame, (rows, columns, 2), m.

        Rows run from the rear to the front, and columns from right to left.
        """
        x = self.spacing * np.arange(-self.behind, self.ahead + 1)
        y = self.spacing * np.arange(-self.aside, self.aside + 1)
        return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)

    @property
    def points(self) -> Array:
        """Position x, y of the p grid points in the order of the observation, heading frame, (p, 2), m."""
        return self.grid.reshape(-1, 2)

    @property
    def term(self) -> ObservationTerm:
        """Description of this scan as a term of the observation: name, width, unit, bound and scale."""
        unit = "m, ground minus trunk's centre"
        return ObservationTerm("height_scan", math.prod(self._grid), unit, -UNSEEN, _SCALE)


@cache
def table_with(robot: Robot, scan: HeightScan | None, user_terms: tuple[ObservationTerm, ...] = ()) -> ObservationTable:
    """Return the table of all observation terms of a robot: built-in terms, height scan and user terms.

    Args:
        robot: The observed robot.
        scan: Height scan, which follows the built-in terms; None if there is no height scan.
        user_terms: Observation terms of a user, which come last.

    Returns:
        The observation table. Equal arguments return the same object.
    """
    return observation_table(robot, *(() if scan is None else (scan.term,)), *user_terms)


class ScanLoss:
    """Loss of the height scan of n robots: whole episodes, or the dropouts of their scenario.

    Args:
        scenario: Scenario, which defines loss and dropouts.
        num_envs: Number of robots.
    """

    def __init__(self, scenario: Scenario, num_envs: int) -> None:
        self.is_permanent = scenario.scan_lost
        """True if the scan shows no ground in all episodes of all robots."""
        self._has_dropouts = scenario.scan_dropouts is not None
        count = 0 if scenario.scan_dropouts is None else scenario.scan_dropouts.count + 1
        self._first_step = np.zeros((num_envs, count), np.int64)
        self._end_step = np.zeros((num_envs, count), np.int64)
        self._side = np.zeros((num_envs, count, 2))

    def reset(self, env_ids: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Store the dropouts of the new `episodes` of k robots with the indices `env_ids`, (k,)."""
        for env_index, episode in zip(env_ids, episodes, strict=True):
            if (plan := episode.scan_dropouts) is not None:
                self._first_step[env_index] = plan.first_step
                self._end_step[env_index] = plan.end_step
                self._side[env_index] = plan.side

    def hide(self, heights: Any, points: Array, clock: Clock, env_ids: EnvIndices) -> None:
        """Set the heights of grid points that the scan of k robots does not show now to `UNSEEN`, in place.

        Args:
            heights: Ground heights at the p points relative to the trunk's centre, (k, p), m.
            points: Positions x, y of the p points, heading frame, (p, 2), m.
            clock: Number of control steps since the start of the episode, for each of the k robots, (k,).
            env_ids: Indices of the k robots, (k,).
        """
        if self.is_permanent:
            heights[:] = UNSEEN
        elif self._has_dropouts:
            now = np.asarray(clock)[:, None]
            is_active = (now >= self._first_step[env_ids]) & (now < self._end_step[env_ids])
            x, y = points.T
            for row, dropout in zip(*np.nonzero(is_active), strict=True):
                side_x, side_y = self._side[env_ids[row], dropout]
                heights[row, side_x * x + side_y * y >= 0.0] = UNSEEN


class Scanner:
    """Simulated height scanner of n robots, with noise, sample rate and delay.

    Args:
        scan: Grid, rate, delay and noise of the scan.
        num_envs: Number of robots.
        control_rate: Control rate, Hz.
        scenario: Scenario, which adds delay and noise, and loses the scan in periods or always.
    """

    def __init__(
        self,
        scan: HeightScan,
        num_envs: int,
        control_rate: float,
        scenario: Scenario,
    ) -> None:
        self.loss = ScanLoss(scenario, num_envs)
        """Periods and points in which the scan reads `UNSEEN`, -2 m."""
        self._scan = scan
        self._control_rate = control_rate
        self._terrain = scenario.terrain
        self._points = scan.points
        width = len(self._points)
        std = self._noise_std(scenario)
        self._channel = Channel(num_envs, width, scan.rate, self._delay(scenario), control_rate)
        self._delay_steps = np.full(num_envs, self._channel.delay_steps)
        """Delay of the scan of each robot, (n,), control steps."""
        has_noise = std > 0 or scenario.noise is not None
        self._noise = Noise(num_envs, np.full(width, std, np.float32)) if has_noise else None

    def _noise_std(self, scenario: Scenario) -> float:
        """Return the standard deviation of the noise of scan and `scenario` together, m."""
        return float(np.hypot(self._scan.noise, 0.0 if scenario.noise is None else scenario.noise.height_scan))

    def _delay(self, scenario: Scenario) -> float:
        """Return the delay of the scan plus the latency of `scenario` in whole control steps, s."""
        latency = scenario.latency
        added_steps = 0 if latency is None else round(latency.observation * self._control_rate)
        return self._scan.delay + added_steps / self._control_rate

    def reset(self, env_ids: EnvIndices, episodes: Sequence[EpisodeSample]) -> None:
        """Restart noise and dropouts of the height scan for k robots that start a new episode.

        Args:
            env_ids: Indices of the k robots, (k,).
            episodes: New episodes of the k robots.
        """
        self.loss.reset(env_ids, episodes)
        for env_index, episode in zip(env_ids, episodes, strict=True):
            self._delay_steps[env_index] = delay_to_steps(self._delay(episode.scenario), self._control_rate)
            if self._noise is not None:
                self._noise.reset(env_index, episode.streams.scan_noise, self._noise_std(episode.scenario))

    def scan(self, state: QuadState[ScalarOrBatch], clock: Clock, env_ids: EnvIndices) -> NDArray[np.float32]:
        """Measure the ground if a sample is due, and return the newest sample that can be read after the delay.

        Args:
            state: Present state of k robots.
            clock: Number of control steps since the start of the episode, for each of the k robots, (k,).
            env_ids: Indices of the k robots, (k,).

        Returns:
            Ground heights at the p grid points relative to the trunk's centre, (k, p), m.
        """
        if self.loss.is_permanent:
            return np.full((len(env_ids), len(self._points)), UNSEEN, np.float32)
        due = np.flatnonzero(clock % self._channel.period == 0)
        if len(due):
            sample = self._sample(state, clock[due], env_ids[due], due)
            self._channel.record(sample, clock[due], env_ids[due])
        heights = self._channel.value(clock, env_ids, self._delay_steps[env_ids]).astype(np.float32)
        self.loss.hide(heights, self._points, clock, env_ids)
        return heights

    def _sample(self, state: QuadState[ScalarOrBatch], clock: Clock, env_ids: EnvIndices, rows: EnvIndices) -> Array:
        """Return the ground heights at p grid points of k robots relative to the trunk's centre, (k, p), m.

        The heights include the noise and are clipped to ±2 m. `env_ids` are the indices of the k robots, and `rows`
        their rows in `state`. `clock` is the number of control steps since the start of each robot's episode, (k,).
        """
        heights = relative_ground_heights(self._points, self._terrain, state, rows)
        if self._noise is not None:
            heights += self._noise.at(clock // self._channel.period, env_ids)
        return np.clip(heights, UNSEEN, -UNSEEN, out=heights)


def relative_ground_heights(
    points: Array, terrain: Terrain, state: QuadState[ScalarOrBatch], rows: EnvIndices | slice = slice(None)
) -> Array:
    """Return the ground heights at points around the trunks, relative to the centres of the trunks.

    Args:
        points: Positions x, y of p points relative to the trunk's centre, heading frame, (p, 2), m.
        terrain: Ground.
        state: States of n robots.
        rows: Indices of the k robots to use, (k,); all n robots by default.

    Returns:
        Heights at the p points of each of the k robots, without noise, delay and clipping, (k, p), m.
    """
    cos, minus_sin = to_heading(state.rotation, cast("Any", (1.0, 0.0)))
    columns = (*state.position, cos, -minus_sin)
    x, y, z, cos, sin = (np.reshape(column, (-1, 1))[rows] for column in columns)
    ahead, left = points.T
    x_world = x + (cos * ahead - sin * left)
    y_world = y + (sin * ahead + cos * left)
    heights: Array = terrain.height(x_world, y_world) - z
    return heights


def make_scanner(scan: HeightScan | None, scenario: Scenario, num_envs: int, control_rate: float) -> Scanner | None:
    """Create the height scanner of n robots.

    Args:
        scan: Settings of the scan; None if the robots have no height scan.
        scenario: Scenario that defines terrain, observation latency, noise, and loss of the scan.
        num_envs: Number of robots.
        control_rate: Control rate, Hz.

    Returns:
        The scanner; None if `scan` is None.

    Raises:
        ValueError: `scan` is neither None nor a `HeightScan`.
    """
    if scan is None:
        return None
    if not isinstance(scan, HeightScan):
        raise ValueError(f"height_scan is a quad_env.HeightScan or None, got {scan!r}; write quad_env.HeightScan(…)")
    return Scanner(scan, num_envs, control_rate, scenario)
