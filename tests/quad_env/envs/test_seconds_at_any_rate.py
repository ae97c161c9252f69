"""Settings in seconds and hertz keep their meaning at any control rate."""

from dataclasses import replace

import pytest

from quad_env import TaskConfig
from tests.quad_env.envs.effects.robot import Effect
from tests.quad_env.envs.effects.settings import AT_50_HZ, check


@pytest.mark.parametrize(("field", "effect"), AT_50_HZ, ids=lambda each: each if isinstance(each, str) else "")
def test_seconds_are_seconds_at_any_control_rate(field: str, effect: Effect) -> None:
    slower = {"config": TaskConfig(control_rate=50.0)}
    check(field, replace(effect, given=effect.given | slower))
