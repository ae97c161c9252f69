"""The safety layer does on a few episodes what the study reports of many."""

import numpy as np
import pytest

import policies
from policies.safety import Safe
from quad_env.scenarios.axes import AXES
from quad_env.seeding import episode_seeds
from research.studies import safety


def test_pushed_robots_that_fall_alone_recover_with_the_layer_which_gave_alarm_before(monkeypatch) -> None:
    monkeypatch.setattr(safety, "STEPS", 600)
    where, seeds = AXES["push"].scenario(65.0, "push"), episode_seeds("search", 0, 8)
    alone, guarded = (
        safety.run(policy, where, seeds) for policy in (policies.make("trot"), Safe(policies.make("trot")))
    )
    assert alone.fell.sum() >= 3
    assert guarded.fell.sum() <= 1
    assert not any(map(len, alone.alarms))
    saved = np.flatnonzero(alone.fell & ~guarded.fell)
    assert all(safety.lead(guarded.alarms[robot], alone.fall_step[robot]) > 0.0 for robot in saved)


@pytest.mark.parametrize(("fall_step", "expected"), [(100, 0.2), (60, 0.1), (50, 0.0), (20, 0.0)])
def test_lead_is_the_time_from_the_last_alarm_before_the_fall(fall_step, expected) -> None:
    assert safety.lead(np.array([50, 80]), fall_step) == pytest.approx(expected)
