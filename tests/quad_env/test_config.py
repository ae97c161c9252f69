"""Settings that are no setting are refused where they are written, with what to write instead."""

import math
from typing import Any

import pytest

import quad_env


@pytest.mark.parametrize(
    ("kind", "values", "says"),
    [
        (quad_env.Scenario, {"name": "x", "terrain": "rough"}, r"Scenario\.terrain .*quad_env\.SmoothRandom.* 'rough'"),
        (quad_env.Scenario, {"name": "x", "pushes": 3}, r"Scenario\.pushes is a quad_env\.Pushes or None, got 3"),
        (quad_env.TaskConfig, {"reward_weights": {"tilt": -1.0}}, r"write quad_env\.RewardWeights\(…\)"),
        (quad_env.TaskConfig, {"timestep": 0.0}, r"positive, s, or None, got 0\.0"),
        (quad_env.CommandRanges, {"interval": math.inf}, "interval must lie between"),
        (quad_env.CommandRanges, {"forward": (1.0, -1.0)}, "a command range must rise"),
        (quad_env.CommandRanges, {"zero_fraction": 2.0}, "zero_fraction must lie between"),
        (quad_env.Slope, {"angle": 1.6}, "angle must lie between 0 and 80°"),
        (quad_env.Stairs, {"steps": 0}, "stairs"),
        (quad_env.Stairs, {"landing": 0.5}, "landing"),
        (quad_env.Ground, {"sink_depth": 0.0001}, "sink_depth must be 0 or"),
        (quad_env.Dropouts, {"duration": 3.0}, "4 dropouts of 3.0 s do not fit"),
        (quad_env.Latency, {"observation": math.nan}, "latency of the observation must lie between"),
        (quad_env.Motors, {"torque_limit": 0.0}, "torque_limit must be finite and more than 0 N·m"),
        (quad_env.Payload, {"reach": (-0.1, 0.1)}, "reach must be finite and at least 0 m"),
        (quad_env.Actuator, {"gear": 10.0}, r"Actuator\.gear is a quad_env\.Gear or None, got 10\.0"),
        (quad_env.Actuator, {"delay": -0.1}, "delay must lie between 0 s and 1 s"),
        (quad_env.Actuator, {"thermal": quad_env.Thermal()}, "needs a curve"),
        (quad_env.Thermal, {"derated": 1.1}, "derated must lie between 0 and 1"),
        (quad_env.Thermal, {"derating": 120.0}, "must rise from ambient to derating to shutdown"),
        (quad_env.SensorSuite, {"imu": None}, r"write quad_env\.Imu\(…\)"),
        (quad_env.FootContact, {"delay": 11.0}, "delay must lie between 0 s and 10 s"),
        (quad_env.Imu, {"rotation": (0.0, 0.0, math.nan)}, "rotation must be finite"),
        (quad_env.Encoders, {"bits": 0}, "1 to 32 bits"),
        (quad_env.HeightScan, {"spacing": "wide"}, "spacing must be a number, got 'wide'"),
        (quad_env.HeightScan, {"ahead": 2.5}, "ahead must be a whole number"),
        (quad_env.HeightScan, {"aside": 5000}, "at most 10000"),
    ],
)
def test_a_setting_of_the_wrong_kind_is_told_the_right_ones(kind: Any, values: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says) as refused:
        kind(**values)
    assert "\n" not in str(refused.value)
