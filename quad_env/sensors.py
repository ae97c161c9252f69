"""What n robots' observations show of their readings: with noise, late."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quad_env.conditions import Scenario
from quad_env.disturbances import SensorNoise
from quad_env.episode import Episode
from quad_env.observations import BOUND, OBSERVATION

SENSED = slice(0, OBSERVATION["previous_action"].start)
"""The terms that sensors measure; what was asked for and the command are known without."""
BLOCK = 50
"""Control steps for which a robot's noise is drawn at once."""
_BOUND = BOUND[SENSED]
_WIDTH = len(_BOUND)

Rows = NDArray[np.intp]


class Sensors:
    """Noise and delay of n robots' sensors; `clock` is each robot's control steps since its start.

    Each robot's noise comes from a stream of its own, a block of steps at a time: that of a step depends on the robot's
    episode and the step alone.
    """

    def __init__(self, scenario: Scenario, num_envs: int, dt: float) -> None:
        late = 0 if scenario.latency is None else round(scenario.latency.observation / dt)
        self._shown = np.zeros((late + 1, num_envs, _WIDTH), np.float32)
        """Readings of the last steps: that of clock c is at c modulo its length."""
        self._deviation = None if scenario.noise is None else _deviations(scenario.noise)
        self._noise = np.zeros((num_envs if scenario.noise else 0, BLOCK, _WIDTH), np.float32)
        self._block = np.full(num_envs, -1)
        """Which block of steps each robot's noise is of."""
        self._streams: list[np.random.Generator | None] = [None] * num_envs

    def begin(self, rows: Rows, episodes: Sequence[Episode]) -> None:
        """Those robots start these episodes."""
        self._block[rows] = -1
        for row, episode in zip(rows, episodes, strict=True):
            self._streams[row] = episode.streams.noise

    def sense(self, observation: NDArray[np.float32], clock: NDArray[np.int64], rows: Rows) -> None:
        """Turn true observations, (k, …), into what the sensors of those robots show; `clock` is theirs, (k,)."""
        sensed = observation[:, SENSED]
        if self._deviation is not None:
            self._draw(clock, rows)
            sensed += self._noise[rows, clock % BLOCK]
            np.clip(sensed, -_BOUND, _BOUND, out=sensed)
        slots = len(self._shown)
        if slots == 1:
            return
        if (first := clock == 0).any():
            self._shown[:, rows[first]] = sensed[first]
        self._shown[clock % slots, rows] = sensed
        sensed[:] = self._shown[(clock + 1) % slots, rows]

    def _draw(self, clock: NDArray[np.int64], rows: Rows) -> None:
        """Noise of the block that each clock is in, where it is not there yet."""
        block = clock // BLOCK
        for row in rows[self._block[rows] != block]:
            noise, stream = self._noise[row], self._streams[row]
            assert stream is not None
            stream.standard_normal(out=noise, dtype=np.float32)
            noise *= self._deviation
        self._block[rows] = block


def sensors_of(scenario: Scenario, num_envs: int, dt: float) -> Sensors | None:
    """The robots' sensors, or None where they show every reading as it is."""
    late = scenario.latency is not None and round(scenario.latency.observation / dt) > 0
    return Sensors(scenario, num_envs, dt) if late or scenario.noise is not None else None


def _deviations(noise: SensorNoise) -> NDArray[np.float32]:
    """Standard deviation of each sensed entry, (33,)."""
    out = np.zeros(_WIDTH, np.float32)
    for term, deviation in noise.deviations.items():
        out[OBSERVATION[term]] = deviation
    return out
