"""`python -m quad_env film`: user errors are one line, and incomplete files do not exist."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from quad_env.__main__ import main


@pytest.mark.rendering
def test_policies_are_filmed_side_by_side_on_the_scenario_and_command_that_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    film = tmp_path / "new" / "walk.webp"
    words = ["--policies", "stand", "trot", "--scenario", "slope=5", "--command", "0.4", "0", "0", "--seconds", "0.4"]
    assert main(["film", str(film), *words, "--size", "160", "120", "--speed", "0.5", "--no-arrows"]) == 0
    assert capsys.readouterr().out == f"{film}\n"
    with Image.open(film) as image:
        assert image.size == (320, 120 + 36)
        assert image.n_frames == 21  # slow motion at 25 frames/s: every second control step
        pictures = []
        for number in (0, 20):
            image.seek(number)
            pictures.append(np.asarray(image.convert("RGB")).astype(int)[90:])
    moved = (np.abs(pictures[1] - pictures[0]).max(axis=-1) > 40).reshape(-1, 2, 160).mean(axis=(0, 2))
    assert moved[1] > 2 * moved[0]


def test_where_nothing_can_be_drawn_a_line_says_so(tmp_path: Path) -> None:
    """The environment requests windows, without a display."""
    bare = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-m", "quad_env", "film", str(tmp_path / "film.gif"), "--policies", "stand"]
    run = subprocess.run(command, env=bare | {"MUJOCO_GL": "glfw"}, capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert run.stderr.splitlines()[-1].startswith("error: nothing can be drawn here (")
    assert not list(tmp_path.iterdir())


@pytest.mark.rendering
def test_ctrl_c_leaves_what_was_there(tmp_path: Path, running: Any) -> None:
    pytest.importorskip("imageio_ffmpeg")
    film = tmp_path / "walk.mp4"
    film.write_text("of before", encoding="utf-8")
    command = [sys.executable, "-m", "quad_env", "film", str(film), "--policies", "trot", "--size", "64", "64"]
    with running([*command, "--seconds", "300"]) as filming:
        while len(list(tmp_path.iterdir())) < 2:
            assert filming.poll() is None
            time.sleep(0.05)
        filming.send_signal(signal.SIGINT)
        out, error = filming.communicate(timeout=60)
    assert (filming.returncode, out) == (130, "")
    assert error == "interrupted: no further file was written\n"
    assert [path.read_text(encoding="utf-8") for path in tmp_path.iterdir()] == ["of before"]
