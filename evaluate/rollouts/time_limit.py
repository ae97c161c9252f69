"""Rounds of an evaluation with a time limit: how many episodes fit into the time that is left.

A round adds the same number of episodes to every pair of policy and scenario, so that all comparisons stay paired. A
round is never cut off: it starts only if its expected end is within the time limit.
"""

import time
from collections.abc import Callable

FIRST_ROUND = 2
"""Number of episodes of each policy on each scenario in the first round, which is simulated in any case."""
ROUND_OVERHEAD = 1.0
"""Time of a round that does not depend on its number of episodes, as a multiple of the time of one episode.

It is the start of the worker processes, and the part of a control step that does not depend on the number of robots."""
MARGIN = 1.1
"""Factor on the expected time of a round, for the variation of the time between rounds."""


class RoundPlanner:
    """Plan of the rounds of one run.

    Args:
        minutes: Time limit of the run, min.
        clock: Function that returns the time, s.
    """

    def __init__(self, minutes: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._round_start = clock()
        self._end = self._round_start + 60.0 * minutes
        self._episode_time = 0.0
        """Longest time of an episode of all policies and scenarios in a round so far, s."""

    def start_round(self) -> None:
        """Record the start of a round."""
        self._round_start = self._clock()

    def finish_round(self, episodes: int) -> None:
        """Record the end of a round.

        Args:
            episodes: Number of episodes of each policy on each scenario that the round has simulated; 0 if they were
                stored by an earlier run.
        """
        if episodes:
            elapsed = self._clock() - self._round_start
            self._episode_time = max(self._episode_time, elapsed / (episodes + ROUND_OVERHEAD))

    def episodes_that_fit(self) -> int:
        """Return the number of episodes of the next round; 0 if the expected end of a round is after the time limit."""
        time_left = self._end - self._clock()
        if time_left <= 0.0:
            return 0
        if self._episode_time == 0.0:
            return FIRST_ROUND
        return max(0, int(time_left / (MARGIN * self._episode_time) - ROUND_OVERHEAD))
