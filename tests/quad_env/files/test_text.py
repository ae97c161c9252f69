"""Numbers are what people write as such, and no text of somebody else's steers a terminal."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quad_env.files.text import LONGEST, number, one_line
from quad_env.scenarios.named import combined


@settings(max_examples=50)
@given(st.floats(allow_nan=False))
def test_every_number_is_read_as_it_is_written(value) -> None:
    assert number(repr(value)) == value


def test_what_no_person_writes_for_a_number_is_none() -> None:
    for text in ("1_0", "1_000.5", "٣", "0x10", "", " ", "1e", "1e5_0", "--1", "1 0", "1,5", "∞"):
        with pytest.raises(ValueError, match="is no number"):
            number(text)
    with pytest.raises(ValueError, match="is no number; write"):
        combined("payload=15+slope=1_0")
    assert number("-inf") == -math.inf
    assert math.isnan(number("NaN"))


@settings(max_examples=50)
@given(st.text())
def test_a_line_is_one_line_that_steers_nothing(text) -> None:
    line = one_line(text)
    assert line.isprintable()
    assert len(line) <= LONGEST + 2


def test_words_are_kept() -> None:
    assert one_line("a\x1b[31m red\n  line\x9b0m\u202e, ±1 °") == "a [31m red line 0m , ±1 °"
