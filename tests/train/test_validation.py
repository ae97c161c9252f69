"""Choice of the best policy: the highest success rate, then the lowest error."""

import math

import pytest

import policies
from evaluate.hardware import HardwareConfig
from quad_env.seeding import episode_seeds
from train import validation
from train.config import ValidationConfig
from train.validation import mean_success_rate, ranking_key, total_cost_of_transport


def means(success_rate, velocity_error, yaw_rate_error=0.0):
    return {"success_rate": success_rate, "velocity_error": velocity_error, "yaw_rate_error": yaw_rate_error}


def test_success_and_score_are_means_over_scenarios():
    results = {"flat": means(1.0, 0.1, 0.4), "rough": means(0.25, 0.3, 0.8)}
    assert mean_success_rate(results) == pytest.approx(0.625)
    assert ranking_key(results) == (pytest.approx(0.375), pytest.approx(0.5))


def test_the_cost_of_transport_is_a_quotient_of_sums():
    flat, payload = {"energy": 10.0, "cost_of_transport": 2.0}, {"energy": 30.0, "cost_of_transport": 1.0}
    still = {"energy": 5.0, "cost_of_transport": math.nan}
    assert total_cost_of_transport({"flat": flat, "payload": payload, "still": still}) == pytest.approx(
        45.0 / (5.0 + 30.0)
    )
    assert math.isnan(total_cost_of_transport({"still": still}))


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
    assert ranking_key(dict(enumerate(better))) < ranking_key(dict(enumerate(worse)))


def test_each_scenario_is_walked_on_the_validation_s_seeds_by_the_policy_that_is_made_for_it(monkeypatch):
    """A scenario on the hardware profile uses the policy made for this profile."""
    walked = []

    def run(policy, scenario, *, seeds, nthread, hardware):
        walked.append((policy.name, scenario.name, seeds.tolist(), nthread))
        return len(walked)

    monkeypatch.setattr(validation, "run", run)
    monkeypatch.setattr(validation, "summarise", lambda episodes: {"success_rate": float(episodes)})
    ideal, real = policies.make("trot"), policies.make("stand")
    config = ValidationConfig(scenarios=("flat", "push+hardware"), episodes=3)
    found = validation.validate(ideal, config, 2, HardwareConfig(), real)
    seeds = episode_seeds("validation", 0, 3).tolist()
    assert walked == [("trot", "flat", seeds, 2), ("stand", "push+hardware", seeds, 2)]
    assert found == {"flat": {"success_rate": 1.0}, "push+hardware": {"success_rate": 2.0}}
    validation.validate(ideal, config, 2, HardwareConfig())
    assert [name for name, *_ in walked[2:]] == ["trot", "trot"]
