"""Settings that are no setting are refused where they are written, with what to write instead."""

from typing import Any

import pytest

import quad_env


@pytest.mark.parametrize(
    ("kind", "values", "says"),
    [
        (quad_env.Scenario, {"name": "x", "terrain": "rough"}, r"Scenario\.terrain .*quad_env\.SmoothRandom.* 'rough'"),
        (quad_env.Scenario, {"name": "x", "pushes": 3}, r"Scenario\.pushes is a quad_env\.Pushes or None, got 3"),
        (quad_env.Scenario, {"name": "x", "ground": None}, r"write quad_env\.Ground\(…\)"),
        (quad_env.TaskConfig, {"reward_weights": {"tilt": -1.0}}, r"write quad_env\.RewardWeights\(…\)"),
        (quad_env.TaskConfig, {"reward_terms": abs}, r"is a tuple of quad_env\.RewardTerm, got .*; write \(quad_env"),
        (quad_env.TaskConfig, {"reward_terms": (abs,)}, r"is a tuple of quad_env\.RewardTerm"),
        (quad_env.TaskConfig, {"timestep": 0.0}, r"positive, s, or None, got 0\.0"),
        (quad_env.RewardTerm, {"name": "a b", "function": abs, "weight": 1.0}, "is a word such as"),
        (quad_env.RewardTerm, {"name": "tilt", "function": abs, "weight": 1.0}, "tilt is a reward term of quad_env's"),
        (quad_env.RewardTerm, {"name": "mine", "function": 3, "weight": 1.0}, "must be a function of the state, got 3"),
        (quad_env.RewardTerm, {"name": "mine", "function": abs, "weight": float("nan")}, "must be finite, got nan"),
        (quad_env.TaskConfig, {"reward_terms": (quad_env.RewardTerm("mine", abs, 1.0),) * 2}, "name of its own, got m"),
        (quad_env.Actuator, {"gear": 10.0}, r"Actuator\.gear is a quad_env\.Gear or None, got 10\.0"),
        (quad_env.CommandRanges, {"interval": float("inf")}, "interval must lie between"),
        (quad_env.CommandRanges, {"forward": (1.0, -1.0)}, "a command range must rise"),
        (quad_env.CommandRanges, {"zero_fraction": 2.0}, "zero_fraction must lie between"),
        (quad_env.SensorSuite, {"imu": None}, r"write quad_env\.Imu\(…\)"),
    ],
)
def test_a_setting_of_the_wrong_kind_is_told_the_right_ones(kind: Any, values: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        kind(**values)
