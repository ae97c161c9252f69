"""The line of progress: of what it tells nothing is more certain than it is."""

import pytest

from train.sb3.progress import summary


def counted(episodes=0, falls=0.0, returned=0.0):
    """With fixed errors."""
    return {"velocity_error": 0.12, "yaw_rate_error": 0.3, "episodes": episodes, "return": returned, "falls": falls}


@pytest.mark.parametrize(
    ("statistics", "said"),
    [
        (counted(), "no episode ended  velocity error 0.120 m/s  yaw-rate error 0.300 rad/s"),
        (counted(160, 0.05, 10.0), "return   10.00  8 of 160 episodes fell  velocity error"),
    ],
)
def test_falls_are_counted_among_the_episodes_that_ended(statistics, said) -> None:
    """In the first rollouts of a run those are few, and most of them fell, for who walks goes on."""
    assert summary(statistics).startswith(said)
