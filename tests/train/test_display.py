"""The line of progress: of what it tells nothing is more certain than it is."""

import pytest

from train.display import summary
from train.robots import Statistics


@pytest.mark.parametrize(
    ("statistics", "said"),
    [
        (Statistics(100, 12.0, 30.0), "no episode ended  velocity error 0.120 m/s  yaw-rate error 0.300 rad/s"),
        (Statistics(100, 12.0, 30.0, {}, 3, 3, 12.0), "return    4.00  3 of 3 episodes fell  velocity error 0.120 m/s"),
        (Statistics(100, 12.0, 30.0, {}, 160, 8, 1600.0), "return   10.00  8 of 160 episodes fell  velocity error"),
    ],
)
def test_falls_are_counted_among_the_episodes_that_ended(statistics, said) -> None:
    """In the first rollouts of a run those are few, and most of them fell, for who walks goes on."""
    assert summary(statistics.means()).startswith(said)
