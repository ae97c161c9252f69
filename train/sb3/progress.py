"""Progress display of a training run: a bar on a terminal, otherwise a line every few seconds."""

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
    """Estimates the speed and the remaining time of a training run in the current process.

    Before the first validation, a control step of a validation scenario is assumed to take as long as a control step of
    a training scenario.

    Args:
        config: Settings of the training run.
        done: Number of learner steps of the run when the process started or resumed it.
        validated: Number of learner steps at the last validation.
        clock: Function without arguments that returns the current time, s.
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
        """Measure the speed from now on, because the time before the call was not spent on training.

        A resumed run calls this method after it has repeated earlier actions.
        """
        self._began = self._clock()

    @contextlib.contextmanager
    def validation(self, steps: int) -> Iterator[None]:
        """Measure the duration of the `with` block, which validates the policy at learner step `steps`."""
        began = self._clock()
        yield
        self._durations.append(self._clock() - began)
        self._validated = steps

    def rate(self, steps: int) -> float:
        """Return the mean training speed of this process until learner step `steps`, learner steps/s, at least 1e-9.

        The time of validations is not included.
        """
        seconds = self._clock() - self._began - sum(self._durations)
        return max((steps - self._done) / max(seconds, 1e-9), 1e-9)

    def remaining_time(self, steps: int) -> float:
        """Return the estimated time from learner step `steps` to the end of the run, s.

        The time includes the remaining validations.
        """
        ppo = self._config.ppo
        rate = self.rate(steps)
        rollout = ppo.envs * ppo.rollout_steps
        remaining = rollout * math.ceil(max(self._config.steps - steps, 0) / rollout)
        interval = rollout * math.ceil(self._config.validation.interval / rollout) or steps + remaining
        validations = math.ceil((steps + remaining - self._validated) / interval)
        return remaining / rate + validations * self._validation_time(rate)

    def _validation_time(self, rate: float) -> float:
        """Return the estimated duration of a validation, s: the mean of the measured durations, if there are any.

        Args:
            rate: Training speed, learner steps/s, from which the duration is estimated before the first validation.

        Returns:
            The duration, s.
        """
        if self._durations:
            return sum(self._durations) / len(self._durations)
        ppo = self._config.ppo
        scenario_count = len(self._config.complete_validation.scenarios)
        control_steps_per_second = rate * ppo.hold / ppo.envs * len(robots_per_scenario(self._config))
        return scenario_count * STEPS / control_steps_per_second


LINE_PERIOD = 5.0
"""Smallest time between two printed lines of progress if the output is not a terminal, s."""


class RecentIntervals:
    """Fraction of command intervals in which the command was tracked, averaged over the last rollouts.

    A command interval is the time during which the velocity command of a robot is constant. A single rollout may have
    no end of an interval, because robots that start together also end their intervals together.

    Args:
        rollouts: Number of rollouts over which the fraction is averaged.
    """

    def __init__(self, rollouts: int) -> None:
        self._counts = deque[tuple[float, float]](maxlen=rollouts)

    def update(self, intervals: float, tracked: float) -> float:
        """Add the counts of a rollout, and return the fraction of tracked command intervals over the last rollouts.

        Args:
            intervals: Number of command intervals that ended in the rollout.
            tracked: Fraction of these intervals in which the command was tracked, from 0 to 1.

        Returns:
            The fraction, from 0 to 1; NaN if no interval ended in the last rollouts.
        """
        self._counts.append((intervals, intervals * tracked if intervals else 0.0))
        ended, tracked_count = map(sum, zip(*self._counts, strict=True))
        return tracked_count / ended if ended else float("nan")


def summary(figures: Mapping[str, float]) -> str:
    """Describe the main metrics of a training rollout in one line of text.

    Reward and errors are means over the steps of the rollout, so that they do not depend on the number of finished
    episodes.

    Args:
        figures: Name of the metric -> value: the metrics of `MultiScenarioVectorEnv.pop_statistics`, `recently_tracked`
            from `RecentIntervals`, and `success` of the last validation, if there is one.

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
    """Displays the progress of a training run on standard output.

    Args:
        total: Number of learner steps of the complete run.
        estimator: Estimator of the speed and the remaining time.
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
        """Display the current number of learner steps and the metrics of the last rollout.

        Args:
            steps: Number of learner steps done.
            figures: Name of the metric -> value, see `summary`.
        """
        minutes, seconds = divmod(round(self.estimator.remaining_time(steps)), 60)
        pace = f"{self.estimator.rate(steps):6,.0f}/s  {minutes:3}:{seconds:02} left"
        line = f"{steps:>10,}/{self._total:,} steps  {pace}  {summary(figures)}"
        self._bar.update(self._task, completed=steps, description=line)
        now = time.monotonic()
        if not self._console.is_terminal and (now - self._printed >= LINE_PERIOD or steps >= self._total):
            self._printed = now
            self.note(line)

    def note(self, text: str) -> None:
        """Print a message `text` as a line of its own, above the progress bar if there is one."""
        self._console.print(Text(text), soft_wrap=True)

    def close(self) -> None:
        """Stop the progress bar."""
        self._bar.stop()
