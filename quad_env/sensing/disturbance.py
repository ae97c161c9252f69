"""What n robots' observations show of their readings: with noise, late."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Rows
from quad_env.robots.robot import Robot
from quad_env.scenarios.disturbances import SensorNoise
from quad_env.scenarios.episode import Episode
from quad_env.scenarios.scenario import Scenario
from quad_env.sensing.noise import Noise
from quad_env.task.observations import ObservationTable, observation_table


class Sensors:
    """Noise and delay of n robots' sensors; `clock` is each robot's control steps since its start."""

    def __init__(self, robot: Robot, scenario: Scenario, num_envs: int, dt: float) -> None:
        table = observation_table(robot)
        self._sensed, self._bound = table.sensed, table.bound[table.sensed]
        late = 0 if scenario.latency is None else round(scenario.latency.observation / dt)
        self._shown = np.zeros((late + 1, num_envs, len(self._bound)), np.float32)
        """Readings of the last steps: that of clock c is at c modulo its length."""
        self._noise = None if scenario.noise is None else Noise(num_envs, _deviations(scenario.noise, table))

    def begin(self, rows: Rows, episodes: Sequence[Episode]) -> None:
        """Start these episodes of those robots."""
        if self._noise is not None:
            for row, episode in zip(rows, episodes, strict=True):
                self._noise.begin(row, episode.streams.noise)

    def sense(self, observation: NDArray[np.float32], clock: NDArray[np.int64], rows: Rows) -> None:
        """Turn true observations, (k, …), into what the sensors of those robots show; `clock` is theirs, (k,)."""
        sensed = observation[:, self._sensed]
        if self._noise is not None:
            sensed += self._noise.at(clock, rows)
            np.clip(sensed, -self._bound, self._bound, out=sensed)
        slots = len(self._shown)
        if slots == 1:
            return
        if (first := clock == 0).any():
            self._shown[:, rows[first]] = sensed[first]
        self._shown[clock % slots, rows] = sensed
        sensed[:] = self._shown[(clock + 1) % slots, rows]


def _deviations(noise: SensorNoise, table: ObservationTable) -> NDArray[np.float32]:
    """Standard deviation of each sensed entry, (33,)."""
    out = np.zeros(table.sensed.stop, np.float32)
    for term, deviation in noise.deviations.items():
        out[table.slices[term]] = deviation
    return out
