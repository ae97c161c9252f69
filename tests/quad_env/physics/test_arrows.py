"""Arrows appear at their positions, and only in the picture that they were given for."""

import math

import numpy as np
import pytest

from quad_env.envs.env import SimpleQuadEnv
from quad_env.physics.arrows import Arrow, Ball
from quad_env.physics.rendering import Camera

WIDTH, HEIGHT = 320, 240
VISIBLE = 20
"""Least difference of a pixel's colours; the first picture of a renderer differs from its later ones by less."""
RED = (1.0, 0.0, 0.0, 1.0)
PER_METRE = HEIGHT / 2 / math.tan(math.radians(20.0)) / 2.0
"""px/m at the trunk, for the camera `side`, which is 2 m to the right and sees 40° vertically."""


def changed(arrows: list[Arrow | Ball]) -> np.ndarray:
    """Return the pixels that the marks change, (n, 2), m above and ahead of the trunk in the picture."""
    env = SimpleQuadEnv()
    env.reset(seed=0, options={"command": (0.0, 0.0, 0.0)})
    camera, data = Camera(env.model, WIDTH, HEIGHT, "side"), env.data
    x, _, z = trunk = data.body("base_link").xpos
    moved = [
        {k: tuple(trunk + v) for k, v in each._asdict().items() if k in ("start", "end", "centre")} for each in arrows
    ]
    there = [each._replace(**places) for each, places in zip(arrows, moved, strict=True)]
    without = camera.draw(data).astype(int)
    drawn = camera.draw(data, arrows=there).astype(int)
    assert np.abs(camera.draw(data) - without).max() < VISIBLE  # the next picture has no marks
    camera.close()
    rows, columns = np.nonzero(np.abs(drawn - without).max(axis=-1) > VISIBLE)
    eye = data.camera("side").xpos
    up, ahead = (HEIGHT / 2 - rows) / PER_METRE + eye[2] - z, (columns - WIDTH / 2) / PER_METRE + eye[0] - x
    return np.stack((up, ahead), axis=1)


@pytest.mark.rendering
def test_an_arrow_goes_from_its_start_to_its_end() -> None:
    of_no_length = Arrow((0.2, 0.0, 0.5), (0.2, 0.0, 0.5), 0.02, RED)
    up, ahead = changed([Arrow((0.2, 0.0, 0.2), (0.6, 0.0, 0.3), 0.02, RED), of_no_length]).T
    assert (ahead.min(), ahead.max()) == pytest.approx((0.2, 0.6), abs=0.03)
    assert (up.min(), up.max()) == pytest.approx((0.18, 0.3), abs=0.04)
    assert up[ahead > 0.5].mean() > up[ahead < 0.3].mean()


@pytest.mark.rendering
def test_a_ball_is_drawn_about_its_centre_with_its_name_next_to_it() -> None:
    up, ahead = changed([Ball((0.4, 0.0, 0.2), 0.08, RED, "")]).T
    assert (ahead.min(), ahead.max(), up.min(), up.max()) == pytest.approx((0.32, 0.48, 0.12, 0.28), abs=0.03)
    assert len(changed([Ball((0.4, 0.0, 0.2), 0.08, RED, "FL")])) > len(up)
