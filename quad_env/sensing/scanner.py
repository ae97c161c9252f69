"""The height scans of n robots: from the terrain to what is seen of it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array, Column, Rows
from quad_env.physics.state import QuadState, to_heading
from quad_env.scenarios.episode import Episode
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import Terrain
from quad_env.sensing.channel import Channel, Clock
from quad_env.sensing.height_scan import UNSEEN, HeightScan
from quad_env.sensing.noise import Noise


def ground_heights(terrain: Terrain, x: Array, y: Array, z: Array, heading: Array, points: Array) -> Array:
    """Ground below or above points (p, 2), heading frame, minus the height of the trunks' centres, (k, p), m.

    The centres are at `x`, `y` and `z`, world frame, (k,); `heading` holds the cosine and the sine of each robot's,
    (2, k).
    """
    (cos, sin), (ahead, left) = heading[..., None], points.T
    world_x, world_y = x[:, None] + (cos * ahead - sin * left), y[:, None] + (sin * ahead + cos * left)
    return np.asarray(terrain.height(world_x, world_y) - z[:, None])


class Scanner:
    """Noise, drop-outs, rate and delay of n robots' height scans; `latency` and `noise` come on top, s and m."""

    def __init__(
        self, scan: HeightScan, terrain: Terrain, num_envs: int, control_rate: float, latency: float, noise: float
    ) -> None:
        self._terrain, self._points = terrain, scan.points
        width, deviation = len(self._points), float(np.hypot(scan.noise, noise))
        self._channel = Channel(num_envs, width, scan.rate, scan.delay + latency, control_rate)
        self._noise = Noise(num_envs, np.full(width, deviation, np.float32)) if deviation else None
        self._chance = Noise(num_envs, np.ones(width, np.float32)) if scan.dropouts else None
        self._unlikely = _quantile(scan.dropouts)
        """A standard normal number is below it with the chance of a drop-out."""

    def begin(self, rows: Rows, episodes: Sequence[Episode]) -> None:
        """Start these episodes of those robots."""
        for row, episode in zip(rows, episodes, strict=True):
            if self._noise is not None:
                self._noise.begin(row, episode.streams.scan_noise)
            if self._chance is not None:
                self._chance.begin(row, episode.streams.scan_dropouts)

    def scan(self, state: QuadState[Column], clock: Clock, rows: Rows) -> NDArray[np.float32]:
        """What those robots, (k,), whose `state` and `clock` these are, are shown now, (k, p)."""
        due = np.flatnonzero(clock % self._channel.period == 0)
        if len(due):
            self._channel.take(self._sampled(state, clock[due], rows[due], due), clock[due], rows[due])
        return self._channel.value(clock, rows).astype(np.float32)

    def _sampled(self, state: QuadState[Column], clock: Clock, rows: Rows, which: Rows) -> Array:
        """Fresh samples of some of the robots, whose rows of the state are `which`, (k, p)."""
        east: Any = (1.0, 0.0)
        cos, minus_sin = to_heading(state.rotation, east)
        x, y, z, cos, sin = (np.reshape(np.asarray(each), -1)[which] for each in (*state.position, cos, -minus_sin))
        values = ground_heights(self._terrain, x, y, z, np.stack((cos, sin)), self._points)
        number = clock // self._channel.period
        if self._noise is not None:
            values += self._noise.at(number, rows)
        if self._chance is not None:
            values[self._chance.at(number, rows) < self._unlikely] = UNSEEN
        return np.clip(values, UNSEEN, -UNSEEN, out=values)


def _quantile(share: float) -> float:
    from scipy.special import ndtri

    return float(ndtri(share))


def scanner_of(scan: HeightScan | None, scenario: Scenario, num_envs: int, control_rate: float) -> Scanner | None:
    """The scanner of n robots in that scenario; None without a scan, ValueError for what is none."""
    if scan is None:
        return None
    if not isinstance(scan, HeightScan):
        raise ValueError(f"height_scan is a quad_env.HeightScan or None, got {scan!r}; write quad_env.HeightScan(…)")
    late = 0 if scenario.latency is None else round(scenario.latency.observation * control_rate)
    noise = 0.0 if scenario.noise is None else scenario.noise.height_scan
    return Scanner(scan, scenario.terrain, num_envs, control_rate, late / control_rate, noise)
