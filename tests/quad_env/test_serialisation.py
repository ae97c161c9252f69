"""Conversion of settings to plain values and back."""

import pytest

from quad_env.scenarios.axes import AXES
from quad_env.serialisation import from_json_values, to_json_values


def test_every_scenario_is_written_down_and_read_back() -> None:
    for axis in AXES.values():
        for scenario in (axis.level(k + 1) for k in range(len(axis.levels))):
            assert from_json_values(to_json_values(scenario)) == scenario


@pytest.mark.parametrize(
    "value",
    [
        {"type": "os.system", "command": "false"},
        {"type": "quad_env.physics.simulation.mujoco"},
        {"type": "Scenario", "name": "x", "unknown": 1},
        {"type": ["Scenario"], "name": "x"},
        {},
    ],
    ids=str,
)
def test_nothing_but_settings_of_quad_env_is_made_from_a_file(value) -> None:
    with pytest.raises(ValueError, match=r"of that kind|no part of|is missing"):
        from_json_values(value)
