"""Recorder of every batch of robots that a command creates, with the arguments that the batch received."""

import contextlib
import inspect
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.seeding import PURPOSES


@dataclass(frozen=True)
class Batch:
    """A batch of robots with its constructor arguments and the seeds of its first reset."""

    env: SimpleQuadVectorEnv
    threads: int
    seeds: tuple[int, ...]
    sensed: bool
    """True if the step information contains sensor readings."""

    @property
    def purpose(self) -> str:
        """Purpose of the first seed of the batch (training, validation, search, evaluation)."""
        return PURPOSES[self.seeds[0] >> 48]

    @property
    def warms(self) -> bool:
        """True if the batch simulates the temperature of its motors."""
        return self.env.simulation.winding_temperature is not None


@contextlib.contextmanager
def begun() -> Iterator[list[Batch]]:
    """Record every batch that is created and reset with seeds, within the context."""
    found: list[Batch] = []
    true_init, true_reset = SimpleQuadVectorEnv.__init__, SimpleQuadVectorEnv.reset
    threads: dict[int, int] = {}

    def init(self: SimpleQuadVectorEnv, *args: Any, **kwargs: Any) -> None:
        given = inspect.signature(true_init).bind(self, *args, **kwargs)
        given.apply_defaults()
        threads[id(self)] = given.arguments["nthread"]
        true_init(self, *args, **kwargs)

    def reset(self: SimpleQuadVectorEnv, *, seed: Any = None, options: Any = None) -> Any:
        observation, infos = true_reset(self, seed=seed, options=options)
        if seed is not None:
            given = tuple(map(int, np.atleast_1d(seed)))
            found.append(Batch(self, threads[id(self)], given, "sensor_gyro" in infos))
        return observation, infos

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SimpleQuadVectorEnv, "__init__", init)
        patch.setattr(SimpleQuadVectorEnv, "reset", reset)
        yield found
