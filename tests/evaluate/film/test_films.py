"""Films show the simulated motion at the stated speed, all policies in the same episode; files are whole or absent."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

import policies
import quad_env
from evaluate.cells import LabelledPolicy
from evaluate.film import files
from evaluate.film.shooting import ALARM, BAD, GOOD, FilmSpec, RenderOptions, render_frames
from quad_env import Pushes
from quad_env.cli.command_line import UsageError

PUSHED = quad_env.Scenario("pushed", pushes=Pushes(count=1, window=(0.1, 0.3), impulse=20.0))
SMALL = RenderOptions(size=(160, 120))
FEW = RenderOptions(size=(160, 120), rate=5.0)
LINE = 14
"""px. Distance between two lines of the captions."""
HEADER = 2 * LINE + 8


def take_of(*names: str, scenario: quad_env.Scenario = PUSHED, steps: int = 24, forward: float = 0.5) -> FilmSpec:
    entrants = tuple(LabelledPolicy(name, policies.make(name)) for name in names)
    return FilmSpec(entrants, scenario, 0, steps, "an episode", command=(forward, 0.0, 0.0))


def images_of(take: FilmSpec, look: RenderOptions = SMALL) -> list[np.ndarray]:
    return [np.asarray(image).astype(int) for image in render_frames(take, look, lambda _: None)]


@pytest.mark.parametrize(
    ("speed", "rate", "every", "period"), [(1.0, 25.0, 4, 0.04), (0.1, 25.0, 1, 0.1), (1.0, 30.0, 3, 0.03)]
)
def test_a_film_lasts_as_long_as_its_speed_says(speed: float, rate: float, every: int, period: float) -> None:
    look = RenderOptions(speed=speed, rate=rate)
    assert (look.steps_per_frame, look.period) == (every, pytest.approx(period))


def blinking(count: int, width: int = 160) -> list[Image.Image]:
    """Return images that alternate between black and white; the last one is green."""
    return [Image.new("RGB", (width, 120), ("black", "white")[k % 2]) for k in range(count - 1)] + [
        Image.new("RGB", (width, 120), (0, 128, 0))
    ]


@pytest.mark.parametrize("kind", ["webp", "gif"])
def test_a_moving_picture_has_every_image_and_holds_the_last_one(tmp_path: Path, kind: str) -> None:
    files.write_film(blinking(7), tmp_path / f"film.{kind}", 0.04)
    with Image.open(tmp_path / f"film.{kind}") as image:
        frames, lasting = [], []
        for frame in ImageSequence.Iterator(image):
            frames.append(frame.convert("RGB").getpixel((80, 60))[1])
            lasting.append(image.info["duration"])
    assert lasting == [40] * 6 + [1540]
    np.testing.assert_allclose(frames, [0, 255, 0, 255, 0, 255, 128], atol=3)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # imageio_ffmpeg leaves pipes open
def test_an_mp4_has_every_frame_and_holds_the_last_one(tmp_path: Path) -> None:
    encoder = pytest.importorskip("imageio_ffmpeg")
    files.write_film(blinking(7, width=161), tmp_path / "film.mp4", 0.04)
    facts, *frames = encoder.read_frames(str(tmp_path / "film.mp4"))
    assert (facts["size"], facts["fps"], len(frames)) == ((162, 120), 25.0, 7 + 38)
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]


def test_a_strip_is_of_the_whole_film(tmp_path: Path) -> None:
    files.write_film(blinking(30), tmp_path / "film.png", 0.04)
    with Image.open(tmp_path / "film.png") as image:
        assert image.size == (12 * 160, 120)
        assert [image.getpixel((x, 60)) for x in (0, 1919)] == [(0, 0, 0), (0, 128, 0)]


@pytest.mark.rendering
def test_every_policy_walks_the_same_episode_and_the_last_frame_says_what_came_of_each() -> None:
    """Two equal policies give equal pixels; the outcome is a bar at the bottom of the last frame."""
    pictures = np.array(images_of(take_of("trot", "trot", "stand", scenario=quad_env.scenario("flat"), steps=150), FEW))
    first, same, other = np.split(pictures[:, HEADER + 40 :], 3, axis=2)  # the rows below the text
    assert (first == same).all()
    assert (first[0] == other[0]).all()
    assert np.abs(first - other)[1:].max(axis=(1, 2, 3)).min() > 40
    bars = [[tuple(image[-3, 160 * place + 150]) for place in range(3)] for image in pictures]
    assert len(bars) == 9
    assert bars[-1] == [GOOD, GOOD, BAD]
    assert not {GOOD, BAD, ALARM} & {colour for bar in bars[:-1] for colour in bar}


@pytest.mark.rendering
def test_a_film_ends_a_second_after_the_last_fall_of_which_every_frame_tells() -> None:
    pictures = images_of(take_of("document", scenario=quad_env.scenario("flat"), steps=260), FEW)
    bars = [tuple(image[-3, 150]) == ALARM for image in pictures]
    assert bars == [False] * 2 + [True] * 6  # the fall is at 0.3 s; the last frame is an additional one
    assert [tuple(image[HEADER + 50, 0]) == ALARM for image in pictures] == bars


@pytest.mark.rendering
def test_a_push_is_told_while_it_is_seen() -> None:
    bars = [tuple(image[-3, 150]) for image in images_of(take_of("stand", steps=70))]
    assert 7 <= bars.count(ALARM) <= 9  # 0.1 s of push, and 0.2 s more
    assert bars[0] != ALARM
    assert bars[-1] not in (GOOD, BAD, ALARM), "an episode of less than a second has no outcome"


def test_what_cannot_be_written_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    files.check_film_path(tmp_path / "film.webp")
    with pytest.raises(UsageError, match=r'pip install -e "\.\[video\]"'):
        files.check_film_path(tmp_path / "film.mp4")
    (tmp_path / "file").write_text("", encoding="utf-8")
    (tmp_path / "film.gif").mkdir()
    for path in (tmp_path / "file" / "film.gif", tmp_path / "film.gif"):
        with pytest.raises(UsageError, match="--video"):
            files.check_film_path(path)
    with pytest.raises(UsageError, match=r"\.mp4, \.webp, \.gif, \.png, not 'film\.avi'"):
        files.check_film_path(tmp_path / "film.avi")
