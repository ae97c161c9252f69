"""Straight walking: a speed scaled to the robot's size on every ground, and a table of the results."""

import csv
import io

import pytest

from quad_env import SIMPLE_QUAD, scenario
from research.__main__ import main
from research.studies.straight_walking import GROUNDS, walk_scenarios
from tests.quad_env.robots.alike import alike


def test_all_walk_straight_ahead_at_one_speed(tmp_path) -> None:
    robot = alike(tmp_path)
    for of, speed in ((SIMPLE_QUAD, 0.5), (robot, 0.5 * 0.4**0.5)):
        walks = walk_scenarios(of, (0.5,))
        assert len(walks) == len(GROUNDS)
        for walk, name in zip(walks, GROUNDS, strict=True):
            assert walk.commands.forward == pytest.approx((speed, speed))
            assert (walk.commands.lateral, walk.commands.yaw_rate) == ((0.0, 0.0), (0.0, 0.0))
            assert walk.commands.zero_fraction == 0.0
            assert (walk.pushes, walk.terrain) == (scenario(name, of).pushes, scenario(name, of).terrain)


def test_the_table_has_a_row_for_each_and_goes_to_its_page(tmp_path, capsys) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- results -->\n<!-- /results -->\n", encoding="utf-8")
    words = ["straight-walking", "--robot", "simple_quad", "--policies", "stand", "trot", "--speeds", "0.5"]
    words += ["--episodes", "2", "--threads", "1", "--page", str(page), "--table", str(tmp_path / "table.csv")]
    assert main(words) == 0
    rows = list(csv.DictReader(io.StringIO((tmp_path / "table.csv").read_text(encoding="utf-8"))))
    stand, trot = (row for row in rows if row["ground"] == "level")
    assert (stand["policy"], stand["success_rate"]) == ("stand", "0")
    assert (trot["policy"], trot["success_rate"], trot["fall_rate"]) == ("trot", "1", "0")
    assert float(trot["velocity_error"]) < 0.2 < float(stand["velocity_error"])
    assert float(trot["cost_of_transport_low"]) <= float(trot["cost_of_transport"])
    (line,) = (line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| level"))
    assert f" | 100\N{NO-BREAK SPACE}%, {float(trot['cost_of_transport']):.2f} |" in line
    assert "14.2 kg; 2 episodes" in capsys.readouterr().out
