"""Settings as plain values and back."""

import pytest

from quad_env.scenarios.axes import AXES
from quad_env.scenarios.disturbances import Motors
from quad_env.serialisation import from_plain, to_plain


def test_every_scenario_is_written_down_and_read_back() -> None:
    for axis in AXES.values():
        for scenario in (axis.level(k + 1) for k in range(len(axis.levels))):
            assert from_plain(to_plain(scenario)) == scenario


@pytest.mark.parametrize(("written", "read"), [(100.0, None), (50.0, 50.0)])
def test_results_up_to_2026_named_the_only_robots_own_torque_where_nothing_was_said(written, read) -> None:
    """A scenario of theirs is today's, not a changed one."""
    then = to_plain(Motors(written, 5.0)) | {"type": "quad_env.disturbances.Motors"}
    assert from_plain(then) == Motors(read, 5.0)
    assert from_plain(to_plain(Motors(written))) == Motors(written)


@pytest.mark.parametrize(
    "value",
    [
        {"type": "os.system", "command": "false"},
        {"type": "quad_env.physics.simulation.mujoco"},
        {"type": "quad_env.scenarios.named.Scenario", "name": "x", "unknown": 1},
        {},
    ],
    ids=str,
)
def test_nothing_but_settings_of_quad_env_is_made_from_a_file(value) -> None:
    with pytest.raises(ValueError, match=r"of that kind|no part of|is missing"):
        from_plain(value)
