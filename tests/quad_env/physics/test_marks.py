"""Marks are drawn where they are said to be, in their colours, into that one picture."""

import math

import numpy as np
import pytest

from quad_env.envs.env import SimpleQuadEnv
from quad_env.physics.marks import Arrow, Ghost
from quad_env.physics.rendering import Camera

WIDTH, HEIGHT = 320, 240
VISIBLE = 20
"""Difference of a pixel's colours; a renderer's first picture differs by less from its later ones."""
RED = (1.0, 0.0, 0.0, 1.0)
PER_METRE = HEIGHT / 2 / math.tan(math.radians(20.0)) / 2.0
"""Pixels at the trunk, of the camera `side`, which is 2 m to the right of it and sees 40° from top to bottom."""


def changed(marks: list[Arrow | Ghost]) -> np.ndarray:
    """Each pixel that the marks change, (n, 2), m above and ahead of the trunk's place in the picture."""
    env = SimpleQuadEnv()
    env.reset(seed=0, options={"command": (0.0, 0.0, 0.0)})
    camera, data = Camera(env.model, WIDTH, HEIGHT, "side"), env.data
    x, y, z = data.body("base_link").xpos
    there = [_moved(mark, (x, y, z)) for mark in marks]
    without = camera.draw(data).astype(int)
    drawn = camera.draw(data, marks=there).astype(int)
    assert np.abs(camera.draw(data) - without).max() < VISIBLE  # the next picture has none of them
    camera.close()
    rows, columns = np.nonzero(np.abs(drawn - without).max(axis=-1) > VISIBLE)
    eye = data.camera("side").xpos
    up, ahead = (HEIGHT / 2 - rows) / PER_METRE + eye[2] - z, (columns - WIDTH / 2) / PER_METRE + eye[0] - x
    return np.stack((up, ahead), axis=1)


def _moved(mark: Arrow | Ghost, origin: tuple[float, float, float]) -> Arrow | Ghost:
    if isinstance(mark, Ghost):
        return mark._replace(position=tuple(np.add(mark.position, origin)))
    return mark._replace(start=tuple(np.add(mark.start, origin)), end=tuple(np.add(mark.end, origin)))


@pytest.mark.rendering
def test_an_arrow_goes_from_its_start_to_its_end() -> None:
    of_no_length = Arrow((0.2, 0.0, 0.5), (0.2, 0.0, 0.5), 0.02, RED)
    up, ahead = changed([Arrow((0.2, 0.0, 0.2), (0.6, 0.0, 0.3), 0.02, RED), of_no_length]).T
    assert (ahead.min(), ahead.max()) == pytest.approx((0.2, 0.6), abs=0.03)
    assert (up.min(), up.max()) == pytest.approx((0.18, 0.3), abs=0.04)
    assert up[ahead > 0.5].mean() > up[ahead < 0.3].mean()


@pytest.mark.rendering
def test_a_ghost_is_as_long_and_high_as_the_robot_and_where_it_is_put() -> None:
    """Seen from its right: 0.6 m long; with its nose down its tail is up."""
    up, ahead = changed([Ghost((0.6, 0.0, 0.25), np.eye(3), (0.0, 1.0, 1.0, 0.5))]).T
    trunk = ahead[(up > 0.22) & (up < 0.28)]
    assert (trunk.min(), trunk.max()) == pytest.approx((0.3, 0.9), abs=0.05)
    assert 0.25 - up.min() == pytest.approx(0.55, abs=0.06)
    sin, cos = math.sin(0.4), math.cos(0.4)
    nose_down = np.array([(cos, 0.0, sin), (0.0, 1.0, 0.0), (-sin, 0.0, cos)])
    up, ahead = changed([Ghost((0.6, 0.0, 0.35), nose_down, (0.0, 1.0, 1.0, 0.5))]).T
    assert up[ahead < 0.4].max() - up[ahead > 0.8].max() > 0.5 * 0.5 * sin
