"""Fall rules by hand."""

import numpy as np
import pytest

from evaluate.measures.episodes import blank
from quad_env.config import FALL_RULE
from quad_env.robots.simple_quad import SIMPLE_QUAD
from research.studies import fall_rules
from tests.evaluate.measures.uneventful import uneventful

STEPS = 6
UPRIGHT = {"height": 0.5, "tilt": 0.0, "trunk_contact": False, "leg_contact": False}
FALLS = {
    "sound": ({}, ()),
    "low": ({"height": 0.115}, (FALL_RULE, "height-only")),
    "crouching": ({"height": 0.13}, ("height-only",)),
    "crouching less": ({"height": 0.15}, ()),  # above 0.267 of 0.54 m, its height at home; its legs are of 0.6 m
    "leaning": ({"tilt": np.deg2rad(71)}, (FALL_RULE, "tilt-70")),
    "upside down": ({"tilt": np.deg2rad(91)}, (FALL_RULE, "tilt-70", "tilt-90")),
    "on its belly": ({"trunk_contact": True}, (FALL_RULE, "trunk-contact", "non-foot-contact")),
    "on its knees": ({"leg_contact": True}, ("non-foot-contact",)),
}


def episode(change: dict, **more):
    """Upright for two steps, then as `change` says for one, then upright again."""
    signals = {name: blank(SIMPLE_QUAD, name, STEPS, 1) for name in UPRIGHT}
    for name, signal in signals.items():
        signal[:] = UPRIGHT[name]
    for name, value in change.items():
        signals[name][2] = value
    return uneventful(SIMPLE_QUAD, STEPS, after_falls=True, **signals | more)


@pytest.mark.parametrize("name", FALLS)
def test_each_rule_sees_the_step_that_it_is_about(name) -> None:
    change, seen_by = FALLS[name]
    for rule in fall_rules.RULES.values():
        expected = 2 if rule.name in seen_by else STEPS
        assert fall_rules.first_step(rule, episode(change)).tolist() == [expected], rule.name


def test_a_divergence_is_a_fall_under_every_rule() -> None:
    record = episode({}, fall_step=np.array([4]), divergence_step=np.array([4]))
    assert {int(fall_rules.fall_step(rule, record)[0]) for rule in fall_rules.RULES.values()} == {4}
