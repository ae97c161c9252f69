"""`python -m quad_env describe` reports parameters of a model and whether it stands, and writes an editable file."""

from pathlib import Path

import pytest
from PIL import Image

from quad_env.__main__ import main
from quad_env.robots.registry import get_robot
from tests.quad_env.robots.made import Made


def test_what_it_found_is_printed_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, told = Made().write(tmp_path), tmp_path / "files" / "mine.toml"
    told.parent.mkdir()
    assert main(["describe", str(path), "--toml", str(told)]) == 0
    said = capsys.readouterr().out
    for text in (
        "made: 10.8 kg, 12 joints",
        "fr, fl, hr, hl: thigh 0.200 m",
        "knees bend backward",
        "B1 ",
        "It stands:",
    ):
        assert text in said
    again, first = get_robot(str(told)), get_robot(str(path))
    assert (again.mjcf.resolve(), again.joint_names) == (path, first.joint_names)
    assert again.servo_stiffness == pytest.approx(first.servo_stiffness, abs=1e-4)
    assert again.home_pose == pytest.approx(first.home_pose, abs=1e-4)


def test_what_is_missing_is_asked_for_and_can_be_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, told = Made(limits=()).write(tmp_path), tmp_path / "mine.toml"
    assert main(["describe", str(path), "--toml", str(told)]) == 2
    assert (
        "made.xml: neither limits nor a keyframe say which way all knees bend: give knee_direction"
        in capsys.readouterr().err
    )
    told.write_text(
        told.read_text(encoding="utf-8").replace("# knee_direction =", "knee_direction = -1"), encoding="utf-8"
    )
    assert main(["describe", str(told)]) == 0
    kept = told.read_text(encoding="utf-8")
    assert main(["describe", str(path), "--toml", str(told)]) == 2
    assert told.read_text(encoding="utf-8") == kept  # known values are not overwritten by unknown ones


def test_a_robot_that_does_not_stand_is_told_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = tmp_path / "mine.toml"
    told.write_text(f'mjcf = "{Made().write(tmp_path).name}"\nservo_stiffness = 2.0\n', encoding="utf-8")
    assert main(["describe", str(told)]) == 2
    assert "error: standing, " in capsys.readouterr().err


def test_what_is_no_robot_gets_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["describe", "nowhere.xml"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") == 1


def test_the_picture_shows_the_robot(tmp_path: Path) -> None:
    picture = tmp_path / "made.png"
    assert main(["describe", str(Made().write(tmp_path)), "--picture", str(picture)]) == 0
    with Image.open(picture) as shown:
        assert shown.size == (640, 480)
        assert len(shown.getcolors(1 << 20)) > 100
