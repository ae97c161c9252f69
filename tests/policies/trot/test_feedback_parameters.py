"""The parameters of the trot with feedback: their limits, their file, and that none within the limits breaks it."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import policies
from policies.parameters import limits_of
from policies.trot.feedback import TrotFeedback
from policies.trot.feedback_parameters import (
    PARAMETERS_FILE,
    SEARCH_RANGES,
    FeedbackParameters,
    read_parameters,
    searched_parameters,
)
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.task.observations import observation_table

LIMITS = limits_of(FeedbackParameters)


def test_limits_hold_the_search_ranges_and_leave_no_parameter_out():
    names = {field.name for field in dataclasses.fields(FeedbackParameters)}
    assert set(LIMITS) == names
    assert set(dataclasses.asdict(searched_parameters())) == names
    for name, (low, high) in SEARCH_RANGES.items():
        assert LIMITS[name][0] <= low < high <= LIMITS[name][1], name
        assert low <= getattr(searched_parameters(), name) <= high, name


@pytest.mark.parametrize(
    "change", [{"frequency": 0.0}, {"duty": 1.0}, {"tilt_gain": float("nan")}, {"velocity_filter": 0.0}]
)
def test_impossible_parameters_are_refused(change):
    with pytest.raises(ValueError, match=f"{next(iter(change))} must be finite, from "):
        FeedbackParameters(**change)


@pytest.mark.parametrize("content", [None, "{", "[]", '{"gallop": 1}', '{"frequency": "fast"}', '{"frequency": 7}'])
def test_missing_or_damaged_parameter_file_names_the_search(tmp_path, content):
    file = tmp_path / "trot_feedback.json"
    if content is not None:
        file.write_text(content, encoding="utf-8")
    with pytest.raises(policies.PolicyError, match="train search feedback"):
        read_parameters(file)


def test_the_shipped_parameters_can_be_read():
    assert read_parameters(PARAMETERS_FILE) == searched_parameters()


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_within_the_limits_every_action_is_finite_whatever_is_read(data):
    drawn = {
        name: data.draw(st.floats(low, high) | st.sampled_from((low, high))) for name, (low, high) in LIMITS.items()
    }
    policy = TrotFeedback(FeedbackParameters(**drawn))
    rng, bound = np.random.default_rng(data.draw(st.integers(0, 1000))), observation_table(SIMPLE_QUAD).bound
    for scale in itertools.chain((0.01, 1.0), (1.0,) * 3):
        row = (scale * rng.uniform(-bound, bound)).astype(np.float32)
        assert np.isfinite(policy.act(row)).all()
