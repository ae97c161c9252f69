"""The time left."""

import time

import pytest

from quad_env.cli.progress import duration, show_progress


def test_the_rest_takes_as_long_as_what_this_run_has_done(monkeypatch, capsys) -> None:
    """Of four cells an earlier run had done one and a half; this run takes 10 s a cell."""
    clock = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    with show_progress(4) as progress:
        progress("trot", "flat", 1.0)
        progress("trot", "push", 0.5)
        for clock[0], scenario, share in ((5.0, "push", 1.0), (5.0, "rough", 0.0), (15.0, "rough", 1.0)):
            progress("trot", scenario, share)
    lines = [line.partition("(")[2] for line in capsys.readouterr().err.splitlines()]
    assert lines == ["0 s)", "5 s, about 20 s left)", "15 s, about 10 s left)"]


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.4, "0 s"), (59.4, "59 s"), (200.0, "3 min 20 s"), (7500.0, "2 h 5 min")]
)
def test_durations_read_as_people_say_them(seconds, words) -> None:
    assert duration(seconds) == words
