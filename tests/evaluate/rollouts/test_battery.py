"""Names of scenarios on the command line, and scenarios of a user's file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evaluate.__main__ import main
from evaluate.rollouts import battery
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.axes import AXES


def names(*given: str) -> list[str]:
    return [scenario.name for scenario in battery.resolve(given)]


def test_a_level_and_all_levels_of_an_axis() -> None:
    assert names("push:3", "rough") == ["push:3", "rough"]
    assert names("push:all") == [f"push:{level}" for level in range(1, 1 + len(AXES["push"].levels))]
    assert battery.resolve(("push:3",))[0].severity == AXES["push"].levels[2]


@pytest.mark.parametrize("name", ["default", "full", "all"])
def test_a_battery_has_the_nominal_three_and_no_scenario_twice(name) -> None:
    scenarios = battery.resolve((name,))
    assert {"flat", "push", "rough"} <= {scenario.name for scenario in scenarios}
    assert len({replace(scenario, name="") for scenario in scenarios}) == len(scenarios)


def test_the_quick_battery_has_every_axis_at_one_severity_of_the_default_battery_in_both_worlds() -> None:
    quick = battery.resolve(("quick",))
    worlds = {
        hardware: [each for each in quick if each.hardware == hardware and each.axis] for hardware in (False, True)
    }
    for scenarios in worlds.values():
        assert [each.axis for each in scenarios] == list(AXES)
    assert [each.severity for each in worlds[False]] == [each.severity for each in worlds[True]]
    own = {each.name: each for each in quick if not each.hardware}
    default = {each.name: each for each in battery.resolve(("default",))}
    assert own.items() <= default.items()
    assert {"flat", "steady"} <= set(own)
    assert len({replace(each, name="") for each in quick}) == len(quick)


def test_the_full_battery_has_every_severity_of_every_axis() -> None:
    there = {(scenario.axis, scenario.severity) for scenario in battery.BATTERIES["full"](SIMPLE_QUAD)}
    assert there >= {(axis.name, level) for axis in AXES.values() for level in axis.levels}


def test_the_default_battery_has_every_axis_at_its_nominal_severity_and_the_next_two() -> None:
    found: dict[str, list[float]] = {}
    for scenario in battery.BATTERIES["default"](SIMPLE_QUAD):
        if scenario.axis and not scenario.hardware:
            found.setdefault(scenario.axis, []).append(scenario.severity)
    assert list(found) == list(AXES)
    assert found["push"] == [35.0, 50.0, 65.0]
    assert found["slippery"] == [0.4, 0.2, 0.1]
    assert found["surprise"] == [1.0, 1.5, 2.0]
    assert found["slow"] == [0.2, 0.1, 0.05]
    assert {len(severities) for severities in found.values()} == {3}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("flatt",), "flat, push, rough.*quick, default, full, all.*push:3.*my_file.py:NAME"),
        (("push:99",), f"levels 1 to {len(AXES['push'].levels)}, not 99"),
        (("push:all", "push:2"), "twice: push:2"),
        (("push=42", "push=42.0"), "twice: push=42"),
        ((), "no scenario"),
    ],
)
def test_a_name_that_is_none_lists_the_valid_ones(given, words) -> None:
    with pytest.raises(ValueError, match=words):
        battery.resolve(given)


def written(folder: Path, text: str) -> Path:
    """Write a user's file and return its path."""
    path = folder / "my_file.py"
    path.write_text(f"import quad_env\n{text}", encoding="utf-8")
    return path


def test_a_scenario_in_a_file(tmp_path) -> None:
    several = "[quad_env.Scenario(f'gust {i}', pushes=quad_env.Pushes(impulse=float(i))) for i in (1, 2)]"
    file = written(tmp_path, f"SEVERAL = {several}\nGUST = SEVERAL[1]")
    (gust,) = battery.resolve((f"{file}:GUST",))
    assert (gust.name, gust.pushes.impulse) == ("gust 2", 2.0)
    assert names(f"{file}:SEVERAL", "flat") == ["gust 1", "gust 2", "flat"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("OTHER = quad_env.Scenario('other')", "has no 'GUST'; its scenarios: OTHER"),
        ("GUST = 3", "must be a quad_env.Scenario or a tuple of them, not 3"),
        ("GUST = quad_env.SCENARIOS['push']", "call it differently"),
        ("class Ice(quad_env.Flat): ...\nGUST = quad_env.Scenario('icy', terrain=Ice())", "Ice is no part of quad_env"),
        ("1 / 0", "fails: ZeroDivisionError"),
        ("raise SystemExit('no')", "fails: SystemExit: no"),
        ("GUST = quad_env.Scenario('x', pushes=quad_env.Pushes(count=-1))", "do not fit"),
        ("GUST = quad_env.Scenario('')", "needs a name"),
    ],
)
def test_what_is_no_scenario_in_a_file_is_one_line(tmp_path, refused, content, words) -> None:
    file = written(tmp_path, content)
    assert words in refused(main, "trot", "--scenarios", f"{file}:GUST", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_two_terrains_of_one_name_are_told_apart_in_a_line(tmp_path) -> None:
    """For files of one name in two folders, the line names both and a remedy, and the remedy works."""
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        np.save(tmp_path / folder / "hill.npy", np.zeros((4, 4)))
        (tmp_path / folder / "hill.toml").write_text('file = "hill.npy"\nsize = [8.0, 8.0]\n', encoding="utf-8")
    one, other = (str(tmp_path / folder / "hill.toml") for folder in ("a", "b"))
    with pytest.raises(ValueError, match="give one of them another name") as caught:
        battery.resolve((one, other))
    assert one in str(caught.value)
    assert other in str(caught.value)
    with pytest.raises(ValueError, match="given twice"):
        battery.resolve((one, one))
    (tmp_path / "b" / "hill.toml").rename(tmp_path / "b" / "mount.toml")
    names = [each.name for each in battery.resolve((one, str(tmp_path / "b" / "mount.toml")))]
    assert names == ["hill", "mount"]
