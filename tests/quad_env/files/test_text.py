"""No text of somebody else's steers a terminal."""

from hypothesis import given, settings
from hypothesis import strategies as st

from quad_env.files.text import LONGEST, one_line


@settings(max_examples=50)
@given(st.text())
def test_a_line_is_one_line_that_steers_nothing(text) -> None:
    line = one_line(text)
    assert line.isprintable()
    assert len(line) <= LONGEST + 2


def test_words_are_kept() -> None:
    assert one_line("a\x1b[31m red\n  line\x9b0m\u202e, ±1 °") == "a [31m red line 0m , ±1 °"
