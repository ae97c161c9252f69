"""Helpers for HTML."""

import re

import pytest

from evaluate.report.html import breakable


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("trot_feedback", ["trot_", "feedback"]),
        ("/home/me/own.py:MyPolicy", ["/home/", "me/", "own.py:", "MyPolicy"]),
        ("push:3+hardware", ["push:", "3+", "hardware"]),
        ("1.6 points [−2.1, 14.5]", ["1.6 points [−2.1, 14.5]"]),
        ("a < b_c", ["a &lt; b_", "c"]),
    ],
)
def test_names_may_break_at_the_ends_of_their_words_and_figures_nowhere(text: str, parts: list[str]) -> None:
    assert breakable(text).split("<wbr>") == parts
    assert re.sub("<wbr>", "", breakable(text)).replace("&lt;", "<") == text
