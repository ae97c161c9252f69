"""Texts from other sources never control the terminal."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from policies.base import PolicyError
from policies.external.reference import resolve_reference
from quad_env import SIMPLE_QUAD, Robot
from quad_env.files.text import MAX_LINE_LENGTH, escape_control_characters, one_line


@settings(max_examples=50)
@given(st.text())
def test_a_line_is_one_line_that_steers_nothing(text) -> None:
    line = one_line(text)
    assert line.isprintable()
    assert len(line) <= MAX_LINE_LENGTH + 2


def test_words_are_kept() -> None:
    assert one_line("a\x1b[31m red\n  line\x9b0m\u202e, ±1 °") == "a [31m red line 0m , ±1 °"


def test_control_characters_are_shown() -> None:
    assert escape_control_characters("a\x1b[31m\n\tb\x9b\u202e ±") == "a\\x1b[31m\n\\tb\\x9b\\u202e ±"


def test_names_of_files_that_steer_a_terminal_are_refused_visibly(tmp_path: Path) -> None:
    robot = tmp_path / "a\x1b[31mb.xml"
    robot.write_text(SIMPLE_QUAD.mjcf.read_text())
    with pytest.raises(ValueError, match="such as my_robot") as error:
        Robot.from_mjcf(robot)
    assert str(error.value).isprintable()
    policy = tmp_path / "a\x1b[31mb.toml"
    policy.write_text("network = 3")
    with pytest.raises(PolicyError, match="a policy's name must be printable") as error:
        resolve_reference(policy, trust=False)
    assert str(error.value).isprintable()
