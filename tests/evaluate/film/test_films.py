"""Films are what happens, at the speed they say, of every policy in the same episode; files are whole or absent."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

import policies
import quad_env
from evaluate.film import files
from evaluate.film.panel import ALARM, BAD, GOOD
from evaluate.film.shooting import film, shoot
from evaluate.film.take import Look, Take
from evaluate.rollouts.experiment import LabelledPolicy
from quad_env import Pushes
from quad_env.cli.command_line import UsageError

PUSHED = quad_env.Scenario("pushed", pushes=Pushes(count=1, window=(0.1, 0.3), impulse=20.0))
SMALL = Look(size=(160, 120))
FEW = Look(size=(160, 120), rate=5.0)
LINE = 14
"""Pixels from a line of its captions to the next."""
HEADER = 2 * LINE + 8


def take_of(*names: str, scenario: quad_env.Scenario = PUSHED, steps: int = 24, forward: float = 0.5) -> Take:
    entrants = tuple(LabelledPolicy(name, policies.make(name)) for name in names)
    return Take(entrants, scenario, 0, steps, "an episode", command=(forward, 0.0, 0.0))


def images_of(take: Take, look: Look = SMALL) -> list[np.ndarray]:
    return [np.asarray(image).astype(int) for image in shoot(take, look, lambda _: None)]


@pytest.mark.parametrize(
    ("speed", "rate", "every", "period"),
    [(1.0, 25.0, 4, 0.04), (0.25, 25.0, 1, 0.04), (0.1, 25.0, 1, 0.1), (2.0, 25.0, 8, 0.04), (1.0, 30.0, 3, 0.03)],
)
def test_a_film_lasts_as_long_as_its_speed_says(speed: float, rate: float, every: int, period: float) -> None:
    look = Look(speed=speed, rate=rate)
    assert (look.every, look.period) == (every, pytest.approx(period))


@pytest.mark.rendering
@pytest.mark.parametrize("kind", ["webp", "gif"])
def test_a_moving_picture_is_real_time_and_shows_movement(tmp_path: Path, kind: str) -> None:
    shares: list[float] = []
    film(take_of("trot"), SMALL, tmp_path / f"film.{kind}", shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    with Image.open(tmp_path / f"film.{kind}") as image:
        frames, lasting = [], []
        for frame in ImageSequence.Iterator(image):
            frames.append(np.asarray(frame.convert("RGB")).astype(int))
            lasting.append(image.info["duration"])
    assert lasting == [40] * 6 + [1540]
    assert np.abs(frames[-1][HEADER + 40 :] - frames[0][HEADER + 40 :]).max() > 40


@pytest.mark.rendering
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # imageio_ffmpeg leaves pipes open
def test_an_mp4_has_every_frame_and_holds_the_last_one(tmp_path: Path) -> None:
    encoder = pytest.importorskip("imageio_ffmpeg")
    film(take_of("trot"), Look(size=(161, 120)), tmp_path / "film.mp4", lambda _: None)
    facts, *frames = encoder.read_frames(str(tmp_path / "film.mp4"))
    assert (facts["size"][0], facts["size"][1] % 2, facts["fps"], len(frames)) == (162, 0, 25.0, 7 + 38)
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]


@pytest.mark.rendering
def test_every_policy_walks_the_same_episode() -> None:
    """Two of the same do the same, to the last pixel, beside another one that starts as they do."""
    take = take_of("trot", "trot", "stand", steps=16)
    pictures = np.array(images_of(take))[:, HEADER + 40 :]  # below what is written
    first, same, other = np.split(pictures, 3, axis=2)
    assert (first == same).all()
    assert np.abs(first - other).max(axis=(1, 2, 3))[-1] > 40
    assert (first[0] == other[0]).all()


@pytest.mark.rendering
def test_the_last_frame_says_what_came_of_each() -> None:
    """On a bar along the bottom; of a robot that has fallen every frame does."""
    take = take_of("trot", "stand", "document", scenario=quad_env.scenario("flat"), steps=150)
    bars = [[tuple(image[-3, 160 * place + 150]) for place in range(3)] for image in images_of(take, FEW)]
    assert len(bars) == 9
    assert bars[-1] == [GOOD, BAD, ALARM]
    assert [bar[2] == ALARM for bar in bars] == [False, False, *[True] * 7]
    assert not any(bar[0] == GOOD or bar[1] == BAD for bar in bars[:-1])


@pytest.mark.rendering
def test_a_film_ends_a_second_after_the_last_fall() -> None:
    pictures = images_of(take_of("document", scenario=quad_env.scenario("flat"), steps=260), FEW)
    assert len(pictures) == 8  # it falls after 0.3 s; the last frame is an extra one


@pytest.mark.rendering
def test_a_push_is_told_while_it_is_seen() -> None:
    bars = [tuple(image[-3, 150]) == ALARM for image in images_of(take_of("stand", steps=70))]
    assert 7 <= sum(bars) <= 9  # 0.1 s, and 0.2 s more
    assert not bars[0]
    assert not bars[-1]


@pytest.mark.rendering
def test_an_episode_too_short_to_be_judged_is_not() -> None:
    bar = images_of(take_of("stand", scenario=quad_env.scenario("flat"), steps=100), FEW)[-1][-3, 150]
    assert tuple(bar) not in (GOOD, BAD, ALARM)


@pytest.mark.rendering
def test_a_strip_is_of_the_whole_film(tmp_path: Path) -> None:
    film(take_of("trot", scenario=quad_env.scenario("flat"), steps=250), SMALL, tmp_path / "film.png", lambda _: None)
    with Image.open(tmp_path / "film.png") as image:
        assert image.size == (12 * 160, 120 + HEADER)
        sheet = np.asarray(image.convert("RGB")).astype(int)
    assert tuple(sheet[-3, -10]) in (GOOD, BAD)


def test_an_mp4_without_an_encoder_names_the_remedy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    files.check(tmp_path / "film.webp")
    with pytest.raises(UsageError, match=r'pip install -e "\.\[video\]"'):
        files.check(tmp_path / "film.mp4")


def test_what_cannot_be_written_to_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    (tmp_path / "film.gif").mkdir()
    for path in (tmp_path / "file" / "film.gif", tmp_path / "film.gif"):
        with pytest.raises(UsageError, match="--video"):
            files.check(path)
    with pytest.raises(UsageError, match=r"\.mp4, \.webp, \.gif, \.png, not 'film\.avi'"):
        files.check(tmp_path / "film.avi")
