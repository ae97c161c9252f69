"""The gaits' figures: changes of gait hold on flat ground, the diagram's bars by hand, mistakes are one line."""

import matplotlib.image
import pytest

from policies.gaits.parameters import GAITS
from policies.gaits.policy import TARGET_RATE_LIMIT
from quad_env.seeding import episode_seeds
from research.__main__ import main
from research.studies import gaits


@pytest.mark.parametrize("first", GAITS)
def test_no_robot_falls_in_a_change_of_gait(first) -> None:
    others = tuple(gait for gait in GAITS if gait != first)
    for other, found in zip(others, gaits.changes(first, others, episode_seeds("search", 8, 4)), strict=True):
        assert not found.fell.any(), other
        assert found.target_rate.max() < TARGET_RATE_LIMIT, other
        assert len(found.phase) == gaits.CHANGE_STEPS


def test_command_prints_a_row_a_gait_and_a_row_a_change(capsys) -> None:
    assert main(["gaits", "--gaits", "walk", "stand", "--robots", "2", "--seconds", "4"]) == 0
    printed = capsys.readouterr().out
    assert "from \\ to" in printed
    assert sum(line.startswith("│ walk") for line in printed.splitlines()) == 2


def test_diagram_is_drawn(tmp_path, capsys) -> None:
    out = tmp_path / "new" / "gait.png"
    assert main(["gait-diagram", "--gait", "pace", "--then", "stand", "--start", "1", "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    picture = matplotlib.image.imread(out)
    assert picture[..., :3].std() > 0.1


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["gaits", "--gaits", "gallop"], "walk"),
        (["gaits", "--gaits", "walk", "walk"], "once"),
        (["gait-diagram", "--then", "gallop"], "gallop"),
        (["gait-diagram", "--length", "1000"], "--length"),
        (["gait-diagram", "--command", "nan", "0", "0"], "--command"),
        (["gait-diagram", "--out", "gait.pdf"], "--out"),
    ],
)
def test_mistakes_are_one_line(arguments, word, capsys) -> None:
    assert main(arguments) == 2
    complaint = capsys.readouterr().err
    assert len(complaint.splitlines()) == 1
    assert word in complaint
