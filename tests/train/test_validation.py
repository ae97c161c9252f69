"""What the best policy is: the one that succeeds most often, and of two that do so alike the one with less error."""

import math

import pytest

from train.validation import cost_of_transport, rank, success


def means(success_rate, velocity_error, yaw_rate_error=0.0):
    return {"success_rate": success_rate, "velocity_error": velocity_error, "yaw_rate_error": yaw_rate_error}


def test_success_and_score_are_means_over_scenarios():
    results = {"flat": means(1.0, 0.1, 0.4), "rough": means(0.25, 0.3, 0.8)}
    assert success(results) == pytest.approx(0.625)
    assert rank(results) == (pytest.approx(0.375), pytest.approx(0.5))


def test_the_cost_of_transport_is_a_quotient_of_sums():
    flat, payload = {"energy": 10.0, "cost_of_transport": 2.0}, {"energy": 30.0, "cost_of_transport": 1.0}
    still = {"energy": 5.0, "cost_of_transport": math.nan}
    assert cost_of_transport({"flat": flat, "payload": payload, "still": still}) == pytest.approx(45.0 / (5.0 + 30.0))
    assert math.isnan(cost_of_transport({"still": still}))


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        ([means(0.9, 0.5)], [means(0.8, 0.1)]),
        ([means(0.9, 0.1)], [means(0.9, 0.2)]),
        ([means(0.5, 0.1, 0.1)], [means(0.5, 0.1, 0.2)]),
        ([means(1.0, 0.9), means(0.5, 0.9)], [means(0.7, 0.1), means(0.7, 0.1)]),
    ],
)
def test_success_comes_first_and_the_error_decides_between_equals(better, worse):
    assert rank(dict(enumerate(better))) < rank(dict(enumerate(worse)))
