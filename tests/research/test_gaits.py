"""Measured gaits: strides from contacts, numbers and figures on the pages of controllers, and the list of pages."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import policies
from research.__main__ import main
from research.studies.gaits import PLACE, draw_gait_diagram, find_stride
from tests.seams import short_episodes

ROOT = Path(__file__).parents[2]
PAGES = "".join(
    path.read_text(encoding="utf-8") for folder in ("docs", "models") for path in (ROOT / folder).rglob("*.md")
)
STANDING = {"stand", "crouch", "document", "gaits", "behaviour", "mpc_wbc_sighted", "trot_reference"}
"""Policies that stand, fall, or walk like another policy."""


def rows(*spans: tuple[int, int]) -> np.ndarray:
    """Return contacts of four feet over 200 steps; the third foot has the given spans, and the others none."""
    contact = np.zeros((200, 4), np.bool_)
    for first, end in spans:
        contact[first:end, 2] = True
    return contact


def test_a_stride_is_from_a_touch_down_to_the_next_of_that_foot_and_rattling_is_none() -> None:
    assert find_stride(rows((0, 20), (50, 70), (72, 80), (110, 130))) == (50, 110)
    assert find_stride(rows((0, 200))) == find_stride(rows((0, 20), (50, 70))) == (0, 200)


def test_the_diagram_is_filled_where_the_foot_is_on_the_ground() -> None:
    image = np.asarray(draw_gait_diagram(rows((50, 100)), [60], ("a", "b", "c", "d"), 1265)).astype(int)
    blue = image[..., 2] - image[..., 0] > 60
    filled = np.argwhere(blue)
    left, wide = 40, 1265 - 40 - 25
    np.testing.assert_allclose(filled[:, 1].min(), left + wide * 0.25, atol=3)
    np.testing.assert_allclose(filled[:, 1].max(), left + wide * 0.5, atol=3)
    high = 150 - 12 - 48
    assert 12 + high / 2 <= filled[:, 0].min()
    assert filled[:, 0].max() <= 12 + high * 3 / 4
    marked = np.flatnonzero((image.max(axis=-1) < 60)[12 + high - 3])  # the time axis of the feet at row 40 is below
    np.testing.assert_allclose(marked[marked > left + 3].mean(), left + wide * 120.5 / 200, atol=3)


@pytest.mark.rendering
def test_a_page_gets_figures_film_and_strip_of_each_controller_that_it_names(tmp_path, monkeypatch) -> None:
    short_episodes(monkeypatch, 620)
    page, out = tmp_path / "page.md", tmp_path / "pictures"
    page.write_text("a\n<!-- gaits simple_quad trot stand@flat -->\nold\n<!-- /gaits -->\nb\n", encoding="utf-8")
    assert main(["gaits", str(page), "--out", str(out)]) == 0
    text = page.read_text(encoding="utf-8")
    assert text.startswith("a\n<!-- gaits simple_quad trot stand@flat -->\n| controller |")
    assert text.endswith("\n<!-- /gaits -->\nb\n")
    assert "old" not in text
    trot, stand = re.findall(r"^\| (`.*?) \| (.*) \|$", text, re.MULTILINE)[:2]
    assert (trot[0], stand[0]) == ("`trot`", "`stand` on `flat`")
    speed, rate, duty, *_ = map(float, trot[1].split(" | "))
    assert abs(speed - 0.5) < 0.1
    assert rate > 1.0
    assert 0.0 < duty < 1.0
    assert stand[1].split(" | ")[1:4] == ["0.00", "1.00", "0.0"]
    assert all((tmp_path / file).is_file() for file in re.findall(r"\]\((.+?)\)", text))
    with Image.open(out / "simple_quad_trot_film.webp") as film, Image.open(out / "simple_quad_trot.webp") as still:
        film.load()  # the duration is known after loading
        assert (film.size, film.n_frames, film.info["duration"]) == ((160, 100), 34, 60)
        assert still.size == (8 * 160, 250)
        frames = np.asarray(still.convert("RGB")).astype(int)[150:].reshape(100, 8, 160, 3)
    assert (np.abs(np.diff(frames, axis=1)).max(axis=-1) > 40).mean(axis=(0, 2)).min() > 0.005  # the legs move


def test_what_is_no_place_and_no_policy_is_said_before_anything_is_drawn(tmp_path, capsys) -> None:
    page = tmp_path / "page.md"
    for text, said in (
        ("none\n", "no place for gaits in"),
        ("<!-- gaits simple_quad trott -->\n<!-- /gaits -->", "trott"),
    ):
        page.write_text(text, encoding="utf-8")
        assert main(["gaits", str(page), "--out", str(tmp_path / "pictures")]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert said in line
        assert page.read_text(encoding="utf-8") == text
    assert not (tmp_path / "pictures").exists()


def test_every_controller_that_walks_has_its_picture_on_a_page() -> None:
    shown = {(robot, name) for robot, names, _ in PLACE.findall(PAGES) for name in names.split()}
    assert {("simple_quad", name) for name in {*policies.names()} - STANDING} <= shown
    for robot in ("go1", "go2"):
        assert {(robot, name) for name in ("trot", "trot_feedback", "mpc_wbc", "residual")} <= shown
