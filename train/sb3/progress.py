"""Progress of a run and its remaining time: a bar on a terminal, else a line every few seconds."""

import contextlib
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.text import Text

from evaluate.rollouts.rollout import STEPS
from quad_env.cli.format import whole_percent
from train.config import TrainConfig
from train.training_robots import robots_per_scenario


class ProgressEstimator:
    """Estimates speed and remaining time of one session of a run.

    Until the first validation has been measured, a control step of a validation scenario is assumed to take as long as
    one of a training scenario.

    Args:
        config: Settings of the run.
        done: Steps at the start of the session.
        validated: Steps at the last validation.
        clock: Returns the time, s.
    """

    def __init__(
        self, config: TrainConfig, done: int = 0, validated: int = 0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._config = config
        self._done = done
        self._validated = validated
        self._clock = clock
        self._began = clock()
        self._durations: list[float] = []

    def restart(self) -> None:
        """Start the clock again; the time before was no training."""
        self._began = self._clock()

    @contextlib.contextmanager
    def validation(self, steps: int) -> Iterator[None]:
        """Measure a validation at `steps` of the run, in a context."""
        began = self._clock()
        yield
        self._durations.append(self._clock() - began)
        self._validated = steps

    def rate(self, steps: int) -> float:
        """Return the speed of this session at `steps`, without its validations, steps per s, at least 1e-9."""
        seconds = self._clock() - self._began - sum(self._durations)
        return max((steps - self._done) / max(seconds, 1e-9), 1e-9)

    def remaining_time(self, steps: int) -> float:
        """Return the time from `steps` to the end of the run, after its last validation, s."""
        ppo = self._config.ppo
        rate = self.rate(steps)
        rollout = ppo.envs * ppo.rollout_steps
        remaining = rollout * math.ceil(max(self._config.steps - steps, 0) / rollout)
        interval = rollout * math.ceil(self._config.validation.interval / rollout) or steps + remaining
        validations = math.ceil((steps + remaining - self._validated) / interval)
        return remaining / rate + validations * self._validation_time(rate)

    def _validation_time(self, rate: float) -> float:
        """Return the duration of a validation, s: the mean of those measured, or the assumption."""
        if self._durations:
            return sum(self._durations) / len(self._durations)
        ppo = self._config.ppo
        scenario_count = len(self._config.complete_validation.scenarios)
        control_steps_per_second = rate * ppo.hold / ppo.envs * len(robots_per_scenario(self._config))
        return scenario_count * STEPS / control_steps_per_second


LINE_PERIOD = 5.0
"""s. Time between two lines if there is no terminal."""


class RecentIntervals:
    """Share of tracked command intervals over the last rollouts.

    Robots that start together end their intervals together, so a single rollout may have none.

    Args:
        rollouts: Number of rollouts.
    """

    def __init__(self, rollouts: int) -> None:
        self._counts = deque[tuple[float, float]](maxlen=rollouts)

    def update(self, intervals: float, tracked: float) -> float:
        """Add a rollout and return the share over all stored rollouts.

        Args:
            intervals: Number of command intervals that ended.
            tracked: Share of them that was tracked.

        Returns:
            The share, 0 … 1; NaN without an interval.
        """
        self._counts.append((intervals, intervals * tracked if intervals else 0.0))
        ended, tracked_count = map(sum, zip(*self._counts, strict=True))
        return tracked_count / ended if ended else float("nan")


def summary(figures: Mapping[str, float]) -> str:
    """Return the main figures of a rollout, in words.

    Reward and errors are means over all steps of the rollout, which do not depend on how many episodes end in it.

    Args:
        figures: Statistics of `MultiScenarioVectorEnv.pop_statistics`, `recently_tracked` of `RecentIntervals`, and
            `success` of the last validation, if there is one.

    Returns:
        Text, in one line.
    """
    reward = f"reward {figures['reward_rate']:6.2f}/s"
    errors = f"velocity error {figures['velocity_error']:.3f} m/s  yaw-rate error {figures['yaw_rate_error']:.3f} rad/s"
    share = figures["recently_tracked"]
    tracked = "no command interval ended"
    if not math.isnan(share):
        tracked = f"{whole_percent(share)} of command intervals tracked"
    count = int(figures["episodes"])
    ended = f"{round(figures['falls'] * count)} of {count} episodes fell" if count else "no episode ended"
    validated = f"{whole_percent(figures['success'])} succeeded in validation  " if "success" in figures else ""
    return f"{validated}{reward}  {tracked}  {errors}  {ended}"


class ProgressDisplay:
    """Shows the progress of a run on standard output.

    Args:
        total: Steps of the run.
        estimator: Estimates the remaining time.
    """

    def __init__(self, total: int, estimator: ProgressEstimator) -> None:
        self.estimator = estimator
        self._console = Console()
        columns = (BarColumn(bar_width=24), TextColumn("{task.description}", markup=False))
        self._bar = Progress(*columns, console=self._console, disable=not self._console.is_terminal)
        self._task = self._bar.add_task("", total=total)
        self._total = total
        self._printed = float("-inf")
        self._bar.start()

    def update(self, steps: int, figures: Mapping[str, float]) -> None:
        """Show the current `steps` and the latest `figures` by name."""
        minutes, seconds = divmod(round(self.estimator.remaining_time(steps)), 60)
        pace = f"{self.estimator.rate(steps):6,.0f}/s  {minutes:3}:{seconds:02} left"
        line = f"{steps:>10,}/{self._total:,} steps  {pace}  {summary(figures)}"
        self._bar.update(self._task, completed=steps, description=line)
        now = time.monotonic()
        if not self._console.is_terminal and (now - self._printed >= LINE_PERIOD or steps >= self._total):
            self._printed = now
            self.note(line)

    def note(self, text: str) -> None:
        """Print a line."""
        self._console.print(Text(text), soft_wrap=True)

    def close(self) -> None:
        """Remove the bar."""
        self._bar.stop()
