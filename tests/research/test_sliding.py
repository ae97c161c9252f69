"""Sliding feet: measurements agree with the settings and the laws of friction."""

import numpy as np
import pytest

from quad_env.config import GRAVITY
from quad_env.robots.scene import build_spec
from quad_env.robots.simple_quad import SIMPLE_QUAD
from research.__main__ import main
from research.studies import sliding
from research.studies.sliding import SETTINGS, ContactSetting, SlidingOptions, ball_spec, simulate_slide
from tests.seams import short_episodes


def ball(setting: ContactSetting = SETTINGS["today"], gravity: float | None = None):
    spec = setting.apply(ball_spec(SIMPLE_QUAD))
    if gravity is not None:
        spec.option.gravity[2] = -gravity
    return spec.compile()


@pytest.mark.parametrize("friction", [0.4, 0.8])
def test_with_exact_friction_a_ball_brakes_at_mu_g_and_stays_on_the_ground(friction: float) -> None:
    """The ball needs v / µg from 2 m/s to rest, 0.255 s at 0.8; MuJoCo's own contact lifts it."""
    exact = ContactSetting(SETTINGS["exact Coulomb friction"].options, friction=friction, exact=True)
    lift, _, whole = simulate_slide(ball(exact), 2.0, 1.0, exact=True)
    assert lift < 0.0
    assert whole == pytest.approx(1.0, abs=0.03)
    lift, _, whole = simulate_slide(ball(ContactSetting(friction=friction)), 2.0, 1.0, exact=False)
    assert lift > 1.0
    assert whole == pytest.approx(1.0, abs=0.03)


def test_another_gravity_is_seen() -> None:
    """The deceleration is in units of the earth's gravity."""
    assert simulate_slide(ball(gravity=0.5 * GRAVITY), 2.0, 1.0, exact=False)[2] == pytest.approx(0.5, abs=0.03)


def test_every_setting_reaches_ball_and_robot() -> None:
    for name, setting in SETTINGS.items():
        for model in (setting.apply(make(SIMPLE_QUAD)).compile() for make in (ball_spec, build_spec)):
            for option, value in setting.options.items():
                assert getattr(model.opt, option) == value, name
            solid = model.geom_contype > 0
            assert np.all(model.geom_friction[solid, 0] == (setting.friction or 0.8)), name
            assert np.all(model.geom_solref[solid] == (setting.solref or (0.01, 1.0))), name


def test_walks_have_the_setting_and_then_today_s_again(tmp_path, monkeypatch) -> None:
    """With a friction of 0.02 no robot walks; the next setting is unaffected."""
    monkeypatch.setitem(SETTINGS, "ice", ContactSetting(friction=0.02))
    monkeypatch.setattr(sliding, "measure_sliding", lambda setting: {})
    short_episodes(monkeypatch, 150)
    table = tmp_path / "sliding.csv"
    words = ["sliding", "--settings", "ice", "today", "--scenarios", "flat", "--episodes", "1", "--table", str(table)]
    assert main(words) == 0
    rows = [line.split(",") for line in table.read_text().splitlines()]
    assert rows[0] == ["setting", "flat success", "flat falls"]
    assert [row[:2] for row in rows[1:]] == [["ice", "0"], ["today", "1"]]


def test_exact_friction_walks_as_far_as_today_s(monkeypatch) -> None:
    """Nothing slides on flat ground: the trot succeeds with both contact models."""
    short_episodes(monkeypatch, 150)
    options = SlidingOptions(scenarios=("flat",), episodes=1)
    assert sliding.evaluate_walks(SETTINGS["exact Coulomb friction"], options)["flat success"] == 1.0


def test_mistakes_are_one_line(capsys) -> None:
    assert main(["sliding", "--settings", "rubber"]) == 2
    assert "--settings: there is no rubber; valid: today; time step 1 ms" in capsys.readouterr().err
