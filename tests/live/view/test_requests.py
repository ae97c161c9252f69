"""A page can make valid requests only."""

import contextlib
import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from live.view.loop import drop_superseded
from live.view.requests import MAX_IMPULSE, REQUESTS, Request, RequestError, parse


def test_a_request_is_read_as_it_was_written() -> None:
    asked = parse('{"do": "steer", "forward": 0.5, "left": -0.25, "turn": 1}')
    assert asked == Request("steer", {"forward": 0.5, "left": -0.25, "turn": 1.0})
    assert parse('{"do": "next"}') == Request("next", {})


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[" * 100_000, "JSON"),
        ("[]", '{"do": "reset"}'),
        ('{"do": "format_disk"}', "steer, let_go, push"),
        ('{"do": "steer", "forward": 0.5, "left": 0}', "steer takes forward, left, turn"),
        ('{"do": "next", "seed": 3}', "next takes nothing else"),
        ('{"do": "steer", "forward": NaN, "left": 0, "turn": 0}', "JSON"),
        ('{"do": "steer", "forward": 1e999, "left": 0, "turn": 0}', "between -3 and 3"),
        ('{"do": "steer", "forward": true, "left": 0, "turn": 0}', "forward is a number"),
        ('{"do": "steer", "forward": %s, "left": 0, "turn": 0}' % ("9" * 400), "between -3 and 3"),
        ('{"do": "push", "direction": 0, "impulse": 1e6}', f"between 0 and {MAX_IMPULSE:g}"),
        ('{"do": "reset", "seed": -1}', "whole number"),
        ('{"do": "reset", "seed": 1.5}', "whole number"),
        ('{"do": "scenario", "name": "a\\nb"}', "name of 1 to"),
        ('{"do": "pause", "on": 1}', "true or false"),
    ],
)
def test_what_is_no_request_is_refused_with_the_reason(text: str, told: str) -> None:
    with pytest.raises(RequestError) as refused:
        parse(text)
    assert told in str(refused.value)
    assert len(str(refused.value)) < 400


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@settings(max_examples=50)
@given(st.dictionaries(st.sampled_from(["do", *{name for wanted in REQUESTS.values() for name in wanted}]), ANYTHING))
def test_nothing_else_than_a_request_or_a_refusal_comes_of_anything(told: object) -> None:
    with contextlib.suppress(RequestError):
        assert parse(json.dumps(told)).do in REQUESTS


def test_of_many_scenarios_at_once_the_newest_is_done_and_all_else_stays_in_order() -> None:
    asked = [Request("scenario", {"name": f"push:{number}"}) for number in range(150)]
    steer, push = Request("steer", {"forward": 1.0}), Request("push", {"direction": 0.0, "impulse": 1.0})
    first, second = (Request("policy", {"robot": robot, "name": "trot"}) for robot in (0, 1))
    given = [*asked[:70], steer, first, push, second, *asked[70:], first, push]
    assert drop_superseded(given) == [steer, push, second, asked[-1], first, push]
    assert drop_superseded([]) == []
