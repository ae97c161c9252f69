"""Strips of frames and moving pictures show the robots moving."""

import numpy as np
import pytest
from PIL import Image, ImageSequence

from research.__main__ import main
from tests.quad_env.robots.alike import alike


@pytest.mark.rendering
def test_a_row_for_each_policy_shows_it_moving(tmp_path, capsys) -> None:
    out = tmp_path / "new" / "strip.png"
    arguments = ["--policies", "stand", "trot", "--scenarios", "flat", "--start", "0.5", "--every", "0.1"]
    assert main(["pictures", *arguments, "--frames", "3", "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    with Image.open(out) as image:
        picture = np.asarray(image.convert("RGB")).astype(int)
    assert picture.shape == (2 * 200, 3 * 240, 3)
    frames = picture.reshape(2, 200, 3, 240, 3).swapaxes(1, 2)[:, :, 40:]  # below the label
    assert frames.std(axis=(2, 3)).min() > 5.0  # something is to be seen
    moved = (np.abs(np.diff(frames, axis=1)).max(axis=-1) > 40).mean(axis=(2, 3))
    assert moved[1].min() > 0.005  # the trot's legs
    assert moved[1].min() > 2.0 * moved[0].max()  # and the other one stands


@pytest.mark.rendering
def test_policies_move_side_by_side_over_and_over(tmp_path) -> None:
    out = tmp_path / "walking.webp"
    arguments = ["pictures", "--policies", "stand", "trot", "--scenarios", "flat", "--start", "0.5", "--every", "0.1"]
    assert main([*arguments, "--frames", "3", "--out", str(out)]) == 0
    with Image.open(out) as picture:
        assert (picture.size, picture.n_frames, picture.info["loop"]) == ((2 * 240, 200), 3, 0)
        frames = np.array([frame.convert("RGB") for frame in ImageSequence.Iterator(picture)]).astype(int)
        assert picture.info["duration"] == 100
    tiles = frames[:, 40:].reshape(3, 160, 2, 240, 3)
    moved = (np.abs(np.diff(tiles, axis=0)).max(axis=-1) > 40).mean(axis=(0, 1, 3))
    assert moved[1] > 0.005 > 2.0 * moved[0]  # the trot's legs; the other one stands


@pytest.mark.rendering
def test_robots_walk_side_by_side(tmp_path) -> None:
    alike(tmp_path)
    out = tmp_path / "robots.png"
    robots = ["--robots", "simple_quad", str(tmp_path / "alike.xml"), "--policies", "trot", "--scenarios", "flat"]
    assert main(["pictures", *robots, "--start", "0.5", "--every", "0.1", "--frames", "2", "--out", str(out)]) == 0
    with Image.open(out) as image:
        picture = np.asarray(image.convert("RGB")).astype(int)
    ours, theirs = picture.reshape(2, 200, 2, 240, 3).swapaxes(1, 2)[:, :, 40:]
    assert np.abs(ours - theirs).mean() > 1.0
    for frames in (ours, theirs):
        assert (np.abs(np.diff(frames, axis=0)).max(axis=-1) > 40).mean() > 0.005  # each walks
