"""Invalid settings are refused at their construction, with the valid values."""

import math
from typing import Any

import pytest

import quad_env


@pytest.mark.parametrize(
    ("kind", "values", "says"),
    [
        (quad_env.Scenario, {"name": "x", "terrain": "rough"}, r"Scenario\.terrain .*\.SmoothRandom.* 'rough'"),
        (quad_env.Scenario, {"name": "x", "pushes": 3}, r"Scenario\.pushes is of the type .*\.Pushes \| None, got 3"),
        (quad_env.TaskConfig, {"reward_weights": {"tilt": -1.0}}, "reward_weights is of the type RewardWeights, got"),
        (quad_env.TaskConfig, {"timestep": 0.0}, r"timestep must be finite and more than 0, got 0\.0"),
        (quad_env.CommandRanges, {"interval": math.inf}, "interval must be from 0.01 s"),
        (quad_env.CommandRanges, {"forward": (1.0, -1.0)}, "a command range must rise"),
        (quad_env.CommandRanges, {"zero_fraction": 2.0}, "zero_fraction must be from 0 to 1"),
        (quad_env.Slope, {"angle": 1.6}, "angle must be from 0 to 80°"),
        (quad_env.Stairs, {"steps": 0}, "Stairs.steps must be from 1 to 1000"),
        (quad_env.Stairs, {"landing": 0.5}, "landing"),
        (quad_env.Ground, {"sink_depth": 0.0001}, "sink_depth must be 0 or"),
        (quad_env.Dropouts, {"duration": 3.0}, "4 dropouts of 3.0 s do not fit"),
        (quad_env.Latency, {"observation": math.nan}, r"Latency\.observation must be from 0 s to 10 s"),
        (quad_env.Motors, {"torque_limit": 0.0}, "torque_limit must be finite and more than 0"),
        (quad_env.Payload, {"reach": (-0.1, 0.1)}, "reach must be finite and at least 0"),
        (quad_env.Actuator, {"delay": -0.1}, "delay must be from 0 s to 1 s"),
        (quad_env.Actuator, {"thermal": quad_env.Thermal()}, "needs a curve"),
        (quad_env.Thermal, {"derated": 1.1}, "derated must be from 0 to 1"),
        (quad_env.Thermal, {"derating": 120.0}, "must rise from ambient to derating to shutdown"),
        (quad_env.SensorSuite, {"imu": None}, "imu is of the type Imu, got None"),
        (quad_env.FootContact, {"delay": 11.0}, "delay must be from 0 s to 10 s"),
        (quad_env.Imu, {"rotation": (0.0, 0.0, math.nan)}, "rotation must be finite"),
        (quad_env.Encoders, {"bits": 0}, "bits must be from 1 to 32"),
        (quad_env.HeightScan, {"spacing": "wide"}, "spacing is of the type float, got 'wide'"),
        (quad_env.HeightScan, {"ahead": 2.5}, "ahead is of the type int, got 2.5"),
        (quad_env.HeightScan, {"aside": 5000}, "at most 10000 points"),
    ],
)
def test_a_setting_of_the_wrong_kind_is_told_the_right_ones(kind: Any, values: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says) as refused:
        kind(**values)
    assert "\n" not in str(refused.value)
