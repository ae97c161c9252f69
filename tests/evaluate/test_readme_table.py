"""The README's table holds the figures of results.json."""

import pytest

from evaluate.command_line import UsageError
from evaluate.readme import insert, table

CELL = {
    "fall_rate": 0.25,
    "fall_rate_ci": [0.18, 0.33],
    "velocity_error": 0.1234,
    "velocity_error_ci": [0.11, 0.14],
    "yaw_rate_error": 0.2,
    "yaw_rate_error_ci": [0.19, 0.21],
    "mean_velocity_error": 0.05,
}
FOUND = {
    "episodes": 128,
    "seed": 0,
    "versions": {"mujoco": "4.0.0", "python": "3.11.7"},
    "policies": {"trot": {"scenarios": {"flat": CELL}}, "stand": {"scenarios": {"flat": CELL | {"fall_rate": 0.0}}}},
}


def test_a_row_for_each_policy_on_each_scenario() -> None:
    rows = [line for line in table(FOUND).splitlines() if line.startswith("| flat")]
    assert [row.split("|")[2].strip() for row in rows] == ["`trot`", "`stand`"]
    assert "25" in rows[0]
    assert "0.123" in rows[0]


def test_only_what_is_between_the_markers_changes() -> None:
    text = "head\n<!-- results -->\nold\n<!-- /results -->\ntail\n"
    assert insert(text, "new") == "head\n<!-- results -->\nnew\n<!-- /results -->\ntail\n"
    assert insert(insert(text, "a"), "b") == insert(text, "b")
    with pytest.raises(UsageError, match="results"):
        insert("nothing here", "new")
