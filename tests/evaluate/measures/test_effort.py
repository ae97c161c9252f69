"""Measures of motor effort and of the corrections of a residual, against values computed by hand."""

from collections.abc import Callable

import numpy as np
import pytest

import policies
import quad_env
from evaluate.analysis.summary import summarise
from evaluate.cells import PolicyScenarioResult
from evaluate.measures import metrics
from evaluate.measures.episodes import empty_signal, weight
from evaluate.rollouts import rollout
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.evaluate.measures.uneventful import uneventful

DT = 0.1
STEPS = 50
SETTLING = 10
JUDGED = STEPS - SETTLING
FALL = 30
"""Step of the fall in the episodes with a fall; half of the judged steps come before it."""


def signal(name: str, change: Callable[[np.ndarray], None]) -> np.ndarray:
    """Return a record of one episode of zeros, changed by `change` in its steps, (steps, …)."""
    record = empty_signal(SIMPLE_QUAD, name, STEPS, 1)
    change(record[:, 0])
    return record


def joints(name: str, *places: tuple[slice | int, slice | int, float]) -> dict[str, np.ndarray]:
    """Return a joint signal of zeros, except for the values at (steps, joints)."""

    def change(record: np.ndarray) -> None:
        for steps, which, value in places:
            record[steps, which] = value

    return {name: signal(name, change)}


def measured(name: str, **changes) -> float:
    return getattr(metrics.measure(uneventful(SIMPLE_QUAD, STEPS, dt=DT, **changes)), name)[0]


ALL, FELL = slice(None), {"fall_step": np.array([FALL])}
WALK = {"heading_velocity": signal("heading_velocity", lambda record: np.copyto(record, (0.5, 0.0, 0.0)))}
BRAKING = joints("positive_work", (ALL, 0, 4.0)) | joints("regeneration", (ALL, 1, 3.0))
"""70 W: 40 W into one joint and 30 W out of another one, without storage in springs."""


def test_what_is_carried_is_weighed() -> None:
    """The weight includes the payload of 5 kg, in the record of the episodes and in their summary."""
    bare, loaded = quad_env.scenario("flat"), quad_env.scenario("payload=5")
    assert weight(SIMPLE_QUAD, loaded) == pytest.approx((SIMPLE_QUAD.mass + 5.0) * 9.81)
    seeds = np.arange(2)
    masses = [rollout.run(policies.make("stand"), each, seeds, steps=20).weight / 9.81 for each in (bare, loaded)]
    assert masses == pytest.approx([SIMPLE_QUAD.mass, SIMPLE_QUAD.mass + 5.0])
    measures = metrics.measure(uneventful(SIMPLE_QUAD, STEPS, dt=DT, **BRAKING, **WALK))
    cell = PolicyScenarioResult(
        "stand", loaded, seeds[:1], np.array([None], object), measures, np.array([None], object)
    )
    expected = 280 / (weight(SIMPLE_QUAD, loaded) * 2.0)
    assert summarise(cell, SIMPLE_QUAD).cost_of_transport == pytest.approx(expected)


def test_mechanical_power() -> None:
    assert measured("mechanical_power", **BRAKING) == pytest.approx(70)
    assert measured("mechanical_power", **BRAKING, **FELL) == pytest.approx(70)


def test_work_regeneration_and_heat() -> None:
    """Each of two joints has 40 W of work, 30 W of regeneration and 5 W of heat for 4 s; a fall leaves 2 s."""
    warm = joints("joule_heat", (ALL, slice(2, 4), 0.5))
    for fall, seconds in (({}, 4.0), (FELL, 2.0)):
        for name, power in (("energy", 70), ("positive_work", 40), ("regeneration", 30), ("joule_heat", 10)):
            assert measured(name, **BRAKING, **warm, **fall) == pytest.approx(power * seconds), name
    no_curve = {"joule_heat": signal("joule_heat", lambda record: record.fill(np.nan))}
    assert np.isnan(measured("joule_heat", **no_curve))


def test_peak_and_mean_torque() -> None:
    assert measured("mean_torque", **joints("mean_torque", (ALL, 0, 12.0))) == pytest.approx(1.0)
    late = joints("peak_torque", (20, 3, 80.0), (25, 4, 60.0), (FALL + 5, 5, 95.0), (3, 5, 99.0))
    assert measured("peak_torque", **late) == 95
    assert measured("peak_torque", **late, **FELL) == 80


def test_shares_of_the_motors_limits() -> None:
    """The largest share counts: 15 of 20 N·m exceeds 30 of 60 N·m, and 4 of 8 rad/s exceeds 6 of 24 rad/s."""
    strong, fast = (20.0, *[60.0] * 11), (8.0, *[24.0] * 11)
    torque = joints("peak_torque", (20, 0, 15.0), (20, 1, 30.0), (5, 0, 20.0))
    speed = joints("peak_speed", (20, 0, 4.0), (20, 1, 6.0), (FALL, 0, 8.0))
    assert measured("torque_share", **torque, torque_limit=strong) == pytest.approx(0.75)
    assert measured("speed_share", **speed, speed_limit=fast, **FELL) == pytest.approx(0.5)
    assert measured("torque_share", **torque, torque_limit=60.0) == pytest.approx(0.5)


def test_torque_rate() -> None:
    """The torque of one of twelve joints changes by 12 N·m in every control step of 0.1 s: 120 N·m/s."""
    assert measured("torque_rate", **joints("torque_change", (ALL, 0, 12.0))) == pytest.approx(10.0)


def test_overspeed() -> None:
    fast = joints("joint_velocity", (slice(20, 26), 0, -10.5), (slice(20, 26), 1, 9.5))
    assert measured("overspeed", **fast) == pytest.approx(6 / (JUDGED * 12))


def test_action_rate() -> None:
    """One target jumps by 0.3 rad once: 3 rad/s in one of the judged steps, over twelve joints."""
    step = joints("action", (slice(20, None), 0, 0.3))
    assert measured("action_rate", **step) == pytest.approx(3 / np.sqrt(JUDGED * 12))
    first = joints("action", (slice(SETTLING, None), 0, 0.3))
    assert measured("action_rate", **first) == pytest.approx(3 / np.sqrt(JUDGED * 12)), "from the step before"
    assert measured("action_rate", **joints("action", (slice(FALL, None), 0, 0.3)), **FELL) == 0
