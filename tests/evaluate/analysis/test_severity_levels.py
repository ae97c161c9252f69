"""Axes of a run, grouped, with levels in order of severity."""

from evaluate.analysis.severity_levels import format_severity, severity_axes


def test_scenarios_of_an_axis_stand_together_from_mild_to_hard(made) -> None:
    found = severity_axes(made.cells)
    assert [axis.name for axis in found] == ["flat", "push", "rough"]
    assert found[1].scenario_names == ("push:1", "push:3", "push:5", "push:6")
    written = [format_severity(scenario).replace("\u00a0", " ") for scenario in found[1].scenarios]
    assert written == ["20 N·s", "50 N·s", "80 N·s", "100 N·s"]
    assert format_severity(found[0].scenarios[0]).replace("\u00a0", " ") == "1.5 m/s"
