"""The README's table holds the figures of results.json."""

import json

import pytest

from evaluate.command_line import UsageError
from evaluate.readme import insert, main, table

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


def refused(capsys, tmp_path, content: str) -> str:
    """The one line about a results.json of that content; the README must not have changed."""
    readme, results = tmp_path / "README.md", tmp_path / "results.json"
    readme.write_text("<!-- results -->\n<!-- /results -->\n")
    results.write_text(content)
    assert main([str(results), "--readme", str(readme)]) == 2
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
    assert rows[2] == "| flat | `trot` | – [–] | – [–] | – [–] | – |"


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
