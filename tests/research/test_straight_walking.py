"""Straight walking: the same speed for its size on every ground, and a table of what came of it."""

import re

import numpy as np
import pytest

from evaluate.__main__ import main
from quad_env import SIMPLE_QUAD, scenario
from research.studies.straight_walking import GROUNDS, scenarios
from tests.quad_env.robots.alike import alike


def test_everybody_is_told_to_walk_straight_ahead_at_one_speed(tmp_path) -> None:
    robot = alike(tmp_path)
    for of, speed in ((SIMPLE_QUAD, 0.5), (robot, 0.5 * 0.4**0.5)):
        walks = scenarios(of, (0.5,))
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
    assert main([*words, "--episodes", "2", "--threads", "1", "--page", str(page)]) == 0
    rows = [line.split(" | ") for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| level")]
    assert [row[1] for row in rows] == ["`stand`", "`trot`"]
    assert rows[0][2].startswith("0\N{NO-BREAK SPACE}%")
    assert rows[1][2].startswith("100\N{NO-BREAK SPACE}%")
    error = float(rows[1][4].split()[0])
    assert error < 0.2 < float(rows[0][4].split()[0])
    assert np.isfinite(float(re.match(r"[\d.]+", rows[1][5])[0]))
    assert "14.2 kg; 2 episodes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "reason"),
    [(["--robot", "go9"], "unknown robot"), (["--policies", "gallop"], "gallop"), (["--episodes", "1"], "episodes")],
)
def test_a_mistake_is_one_line(words, reason, capsys) -> None:
    assert main(["straight-walking", "--robot", "simple_quad", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert reason in line
