"""Remaining time of a run."""

import time

import pytest

from quad_env.cli.progress import format_duration, show_bar, show_progress, show_waiting


def test_the_rest_takes_as_long_as_what_this_run_has_done(monkeypatch, capsys) -> None:
    """An earlier run completed one and a half of four cells; this run takes 10 s a cell."""
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
    assert format_duration(seconds) == words


def test_without_a_terminal_a_bar_says_every_few_seconds_how_far_the_work_is(monkeypatch, capsys) -> None:
    clock = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    with show_bar("filming") as report:
        for clock[0], share in ((1.0, 0.1), (6.0, 0.25), (9.0, 0.4), (18.0, 0.75), (19.0, 1.0)):
            report(share)
    assert capsys.readouterr().err.splitlines() == [
        "filming: 25 % (6 s, about 18 s left)",
        "filming: 75 % (18 s, about 6 s left)",
    ]


def test_work_that_is_done_at_once_says_nothing(capsys) -> None:
    with show_bar("filming") as report:
        report(1.0)
    with show_waiting("writing"):
        pass
    assert capsys.readouterr().err == ""


def test_work_of_unknown_length_is_named_after_a_while(capsys) -> None:
    with show_waiting("writing report.html", first_line_time=0.01):
        deadline = time.monotonic() + 20.0
        said = ""
        while not said and time.monotonic() < deadline:
            time.sleep(0.01)
            said = capsys.readouterr().err
    assert said == "writing report.html …\n"
