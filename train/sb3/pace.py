"""How fast a run is, and how long it will take: rollouts and validations."""

import contextlib
import math
import time
from collections.abc import Callable, Iterator

from evaluate.rollouts.rollout import STEPS
from train.config import TrainConfig
from train.training_robots import robots_per_scenario


class Pace:
    """Speed of one session of a run, from its start after `done` steps, the last validation after `validated`.

    Until the first validation has been measured, a control step on one of its scenarios is taken to last as long as one
    on a scenario of the training.
    """

    def __init__(
        self, config: TrainConfig, done: int = 0, validated: int = 0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._config, self._done, self._validated = config, done, validated
        self._clock, self._began = clock, clock()
        self._durations: list[float] = []

    def restart(self) -> None:
        """Count from now on: what came before was no training."""
        self._began = self._clock()

    @contextlib.contextmanager
    def validation(self, steps: int) -> Iterator[None]:
        """Context of a validation after so many steps."""
        began = self._clock()
        yield
        self._durations.append(self._clock() - began)
        self._validated = steps

    def rate(self, steps: int) -> float:
        """Steps a second of this session without its validations, at least 1e-9."""
        seconds = self._clock() - self._began - sum(self._durations)
        return max((steps - self._done) / max(seconds, 1e-9), 1e-9)

    def left(self, steps: int) -> float:
        """Time from now to the end of the run, after its last validation, s."""
        ppo, interval = self._config.ppo, self._config.validation.interval
        rollout, rate = ppo.envs * ppo.rollout_steps, self.rate(steps)
        rest = rollout * math.ceil(max(self._config.steps - steps, 0) / rollout)
        apart = rollout * math.ceil(interval / rollout) or steps + rest
        validations = math.ceil((steps + rest - self._validated) / apart)
        return rest / rate + validations * self._seconds(rate)

    def _seconds(self, rate: float) -> float:
        """Duration of a validation: the mean of those measured, or the guess, s."""
        if self._durations:
            return sum(self._durations) / len(self._durations)
        ppo, scenarios = self._config.ppo, len(self._config.complete_validation.scenarios)
        control_steps = rate * ppo.hold / ppo.envs * len(robots_per_scenario(self._config))
        return scenarios * STEPS / control_steps
