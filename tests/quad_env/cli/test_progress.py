"""The time left."""

import pytest

from quad_env.cli.progress import Forecast, duration


def test_the_rest_takes_as_long_as_the_policys_finished_cells_did() -> None:
    """Two policies on three scenarios; the first takes 10 s a cell, the second 2 s."""
    forecast = Forecast(("slow", "quick") * 3, now=0.0)
    assert forecast.seconds is None
    forecast.update("slow", "flat", 0.0, 0.0)
    forecast.update("slow", "flat", 0.5, 5.0)
    assert forecast.seconds == pytest.approx(5.5 * 10.0)  # as if all were slow
    forecast.update("slow", "flat", 1.0, 10.0)
    forecast.update("quick", "flat", 0.0, 10.0)
    forecast.update("quick", "flat", 1.0, 12.0)
    assert forecast.seconds == pytest.approx(2 * 10.0 + 2 * 2.0)


def test_what_was_done_before_counts_for_no_time() -> None:
    forecast = Forecast(("slow",) * 4, now=0.0)
    forecast.update("slow", "a", 1.0, 0.0)  # kept whole
    forecast.update("slow", "b", 0.5, 0.0)  # kept by half
    assert forecast.seconds is None
    forecast.update("slow", "b", 1.0, 5.0)
    assert forecast.seconds == pytest.approx(2 * 10.0)


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.4, "0 s"), (59.4, "59 s"), (200.0, "3 min 20 s"), (7500.0, "2 h 5 min")]
)
def test_durations_read_as_people_say_them(seconds, words) -> None:
    assert duration(seconds) == words
