"""The README's table holds the figures of results.json."""

import json

import pytest

from evaluate.__main__ import main
from evaluate.commands.options import DEFAULT_POLICIES
from evaluate.commands.readme import insert, table
from evaluate.rollouts.battery import BATTERIES
from evaluate.terminal.command_line import UsageError

CELL = {
    "fall_rate": 0.25,
    "fall_rate_ci": [0.18, 0.33],
    "velocity_error": 0.1234,
    "velocity_error_ci": [0.11, 0.14],
    "yaw_rate_error": 0.2,
    "yaw_rate_error_ci": [0.19, 0.21],
    "mean_velocity_error": 0.05,
}
POINT = {"axis": "push", "unit": "N·s", "lowest": 20.0, "highest": 100.0, "hardest": 100.0}
POINTS = [
    POINT | {"policy": "trot", "severity50": 48.2, "ci": [45.0, None], "found": "crossed"},
    POINT | {"policy": "stand", "severity50": None, "ci": [None, None], "found": "never"},
    POINT | {"axis": "soft", "policy": "stand", "severity50": None, "ci": [None, None], "found": "always", "unit": "m"},
]
NOISE = {
    "axis": "noise",
    "scenario": "noise:4",
    "severity": 0.8,
    "unit": "rad/s",
    "felt": True,
    "undisturbed_fall_rate": 0.0,
    "falls": 0.25,
    "falls_ci": [0.1, 0.4],
    "falls_p_value": 0.001,
    "velocity_error": 0.5,
    "velocity_error_ci": [0.4, None],
    "velocity_error_p_value": 0.001,
}
FOUND = {
    "breaking_points": [],
    "sensitivities": [],
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


def test_breaking_points_are_a_table_of_axes_and_policies() -> None:
    text = table(FOUND | {"breaking_points": POINTS}).replace("\u00a0", " ")
    assert "| push, N·s | 48.2 N·s [45, > 100] | none up to 100 N·s |" in text
    assert "| soft, m | – | already at 20 m |" in text
    assert "half of the episodes fall" not in table(FOUND)


def test_what_disturbances_do_is_a_table_of_axes_and_policies() -> None:
    both = [NOISE | {"policy": "trot", "felt": False}, NOISE | {"policy": "stand"}]
    text = table(FOUND | {"sensitivities": both}).replace("\u00a0", " ")
    assert "| noise, 0.8 rad/s | the same to the bit | +25 points, +0.50 m/s |" in text
    assert "| disturbance |" not in table(FOUND)


@pytest.mark.parametrize(
    ("changes", "command"),
    [
        ({}, "python -m evaluate --policies trot stand --scenarios flat --episodes 128"),
        (
            {"provenance": {"hardware": {"actuator": "motor", "sensors": "truth"}}},
            "python -m evaluate --policies trot stand --scenarios flat --episodes 128 --actuator motor",
        ),
        ({"seed": 3, "episodes": 64}, "python -m evaluate --policies trot stand --scenarios flat --seed 3"),
    ],
)
def test_the_command_that_makes_the_table_is_below_it(changes, command) -> None:
    assert table(FOUND | changes).splitlines()[-1].startswith(f"`{command}`;")


@pytest.mark.parametrize(("battery", "words"), [("default", ""), ("quick", " --scenarios quick")])
def test_a_battery_is_called_by_its_name(battery, words) -> None:
    cells = dict.fromkeys((scenario.name for scenario in BATTERIES[battery]()), CELL)
    of = {policy: {"scenarios": cells} for policy in DEFAULT_POLICIES}
    line = table(FOUND | {"policies": of, "episodes": 64}).splitlines()[-1]
    assert line.startswith(f"`python -m evaluate{words}`;")


def test_of_a_whole_battery_three_scenarios_are_shown() -> None:
    scenarios = dict.fromkeys(("flat", "push:1", "push", "rough", "ice"), CELL)
    rows = table(FOUND | {"policies": {"trot": {"scenarios": scenarios}}}).splitlines()[4:]
    assert [row.split("|")[1].strip() for row in rows if row.startswith("| ")] == ["flat", "push", "rough"]


def test_only_what_is_between_the_markers_changes() -> None:
    text = "head\n<!-- results -->\nold\n<!-- /results -->\ntail\n"
    assert insert(text, "new") == "head\n<!-- results -->\nnew\n<!-- /results -->\ntail\n"
    assert insert(insert(text, "a"), "b") == insert(text, "b")
    with pytest.raises(UsageError, match="results"):
        insert("nothing here", "new")


def refused(capsys, tmp_path, content: str) -> str:
    """The one line about a results.json of that content; the README must not have changed."""
    readme, results = tmp_path / "README.md", tmp_path / "results.json"
    readme.write_text("<!-- results -->\n<!-- /results -->\n")
    results.write_text(content)
    assert main(["readme", str(results), "--readme", str(readme)]) == 2
    assert readme.read_text() == "<!-- results -->\n<!-- /results -->\n"
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    return error


def test_figures_that_do_not_exist_are_dashes() -> None:
    """As after a run of a single episode, whose intervals are null."""
    absent = dict.fromkeys(CELL) | {f"{name}_ci": [None, None] for name in ("fall_rate", "velocity_error")}
    absent["yaw_rate_error_ci"] = [None, None]
    rows = table(FOUND | {"policies": {"trot": {"scenarios": {"flat": absent}}}}).splitlines()
    assert rows[4] == "| flat | `trot` | – [–] | – [–] | – [–] | – |"


def test_a_cell_that_an_interrupted_run_lacks_is_named(capsys, tmp_path) -> None:
    policies = {"trot": {"scenarios": {"flat": CELL, "push": CELL}}, "stand": {"scenarios": {"flat": CELL}}}
    assert "stand on push" in refused(capsys, tmp_path, json.dumps(FOUND | {"policies": policies}))
    reverse = dict(reversed(policies.items()))
    assert "stand on push" in refused(capsys, tmp_path, json.dumps(FOUND | {"policies": reverse}))


@pytest.mark.parametrize(
    "content", ["", "{", "[]", "null", "{}", '{"policies": []}', json.dumps(FOUND | {"versions": None})]
)
def test_what_is_no_outcome_is_refused(capsys, tmp_path, content) -> None:
    assert "results.json" in refused(capsys, tmp_path, content)
