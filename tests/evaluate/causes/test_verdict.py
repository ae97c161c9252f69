"""Deciding event among several and its certainty, by hand."""

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluate.causes import rules
from evaluate.causes import verdict as verdicts
from evaluate.causes.record import EpisodeSignals
from evaluate.causes.rules import Event
from evaluate.causes.verdict import Verdict, verdict
from evaluate.measures.metrics import measure
from quad_env.config import AnyPose
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Motors, Pushes, SteadyForce
from quad_env.scenarios.scenario import Scenario
from tests.evaluate.causes.made import recorded, signal
from tests.evaluate.measures.uneventful import uneventful

FELL = SimpleNamespace(outcome=np.array(["succeeded", "fell"], object))
PUSH = Event(rules.PUSH, 140, 2.0, "a push", is_instantaneous=True)
TRIP = Event(rules.TRIP, 120, 1.2, "a trip", is_instantaneous=True)
ICE = Event(rules.SLIP, 130, 3.0, "ice")
LIMITS = Event(rules.REACH, 110, 9.0, "limits")


@pytest.fixture
def of(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function from all events to the verdict on a fall."""

    def found(*events: Event, **known: Any) -> Verdict:
        def rule(_: EpisodeSignals) -> Iterator[Event]:
            yield from events

        monkeypatch.setattr(rules, "RULES", (rule,))
        return verdict(recorded(**known), FELL)  # type: ignore[arg-type]

    return found


def test_the_first_sudden_event_decides_and_else_the_strongest_that_lasts(of: Any) -> None:
    assert of(PUSH, ICE, TRIP).event == TRIP
    assert of(PUSH, ICE).event == PUSH
    assert of(ICE, Event(rules.MOTOR, 110, 1.1, "weak")).event == ICE
    assert of(LIMITS, ICE).event == ICE  # joint limits have the lowest priority
    assert of(LIMITS).event == LIMITS
    assert of(PUSH._replace(score=0.99), ICE).event == ICE
    assert of(PUSH, ICE, TRIP).triggered_events == (TRIP, ICE, PUSH)  # by time


def test_it_is_certain_where_it_is_strong_and_nothing_else_had_begun(of: Any) -> None:
    assert of(PUSH).certain
    assert not of(PUSH._replace(score=1.49)).certain
    assert of(PUSH._replace(score=1.5)).certain
    assert not of(PUSH, ICE).certain
    assert not of(PUSH, ICE._replace(step=140)).certain
    assert of(PUSH, ICE._replace(step=141)).certain
    assert of(PUSH, PUSH._replace(step=100, score=0.9)).certain
    assert of(PUSH, LIMITS).certain
    assert not of(LIMITS).certain


def test_a_blow_such_as_it_has_taken_before_is_not_certain(of: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    windows, before = [], [TRIP._replace(step=20, score=0.9)]

    def trips(_: EpisodeSignals, window: slice) -> Iterator[Event]:
        windows.append(window)
        yield from before

    monkeypatch.setattr(verdicts, "trips", trips)
    hard = TRIP._replace(score=5.0)
    assert of(hard).certain
    before.append(TRIP._replace(step=40, score=1.0))
    assert not of(hard).certain
    assert windows == [slice(0, 110)] * 2  # up to the search for the cause
    assert of(hard._replace(step=200)).certain  # the impact of the trunk ends the episode


def test_a_robot_that_never_walked_has_no_clear_cause(of: Any) -> None:
    any_pose = Scenario("made", start=AnyPose())
    assert of(PUSH, scenario=any_pose).event.cause == rules.UNCLEAR
    assert of(PUSH, end=3).event.cause == rules.UNCLEAR
    assert of(PUSH, end=4, onset=2, window=slice(0, 4)).event == PUSH


def test_without_events_the_gait_is_the_cause_and_certain_where_nothing_disturbed_it(of: Any) -> None:
    assert of() == Verdict(Event(rules.GAIT, 150, 1.0, "it leaves its ordinary gait by itself"), True)
    assert of(PUSH._replace(score=0.49)).certain
    assert not of(PUSH._replace(score=0.5)).certain
    assert of(PUSH._replace(score=0.5)).event.cause == rules.GAIT
    assert of(PUSH._replace(score=0.75)).event.cause == rules.UNCLEAR
    assert of(LIMITS._replace(score=0.9)).certain
    assert not of(scenario=Scenario("made", pushes=Pushes(count=1))).certain
    fast = signal("command")
    fast[:, 1, 0] = 5.0
    assert not of(command=fast).certain
    diverged = np.array([300, 200])
    assert of(divergence_step=diverged).event.cause == rules.UNCLEAR
    assert of(divergence_step=diverged[::-1]).event.cause == rules.GAIT  # divergence of the other robot


def upright(
    velocities: list[tuple[float, float, float]],
    command: tuple[float, float, float] = (1.0, 0.0, 0.0),
    scenario: Scenario | None = None,
    **changes: Any,
) -> Verdict:
    """Return the verdict on the second of two robots, with a mean velocity per command interval of 2 s.

    The first robot follows its command.
    """
    steps = 200 * len(velocities)
    of_both = np.tile(np.float32(command), (steps, 2, 1))
    reached = of_both.copy()
    reached[:, 1] = np.repeat(velocities, 200, axis=0)
    quaternion = np.tile(np.float32([1.0, 0.0, 0.0, 0.0]), (steps, 2, 1))
    scenario = scenario or Scenario("made")
    signals = {"command": of_both, "heading_velocity": reached, "quaternion": quaternion, "scenario": scenario}
    episodes = uneventful(SIMPLE_QUAD, steps, 2, command_steps=200, **signals | changes)
    measures = measure(episodes)
    assert measures.outcome[0] == "succeeded"
    return verdict(EpisodeSignals(episodes, scenario, 1), measures)


def test_an_upright_robot_is_too_slow_stalled_or_off_its_command_where_it_is_worst() -> None:
    """The second of two intervals is the worst; the cause is certain below 0.8 of the command."""
    good, slow, still = (1.0, 0.0, 0.0), (0.6, 0.0, 0.0), (0.1, 0.0, 0.0)
    found = upright([good, slow])
    assert (found.event.cause, found.event.step, found.certain) == (rules.SLOW, 300, True)
    assert found.event.description == "moves at 0.60 of the commanded 1.00 m/s"
    assert upright([slow, good]).event.step == 100
    found = upright([(0.82, 0.33, 0.0)])
    assert (found.event.cause, found.certain) == (rules.SLOW, False)
    found = upright([slow, still])
    assert (found.event.cause, found.event.step, found.certain) == (rules.STALLED, 300, True)
    assert upright([(1.5, 0.0, 0.0)]).event.cause == rules.GAIT
    assert upright([(0.95, 0.5, 0.0)]).event.description.startswith(
        "moves at 0.95 m/s forward, 0.50 m/s left, 0.00 rad/s; "
    )
    assert not upright([(0.95, 0.5, 0.0)]).certain


def test_a_stalled_interval_decides_before_one_that_is_farther_off() -> None:
    """The velocity error is 1.9 m/s in the first interval; the robot stands still in the second interval."""
    found = upright([(1.0, 1.9, 0.0), (0.1, 0.0, 0.0)])
    assert (found.event.cause, found.event.step) == (rules.STALLED, 300)


def test_a_robot_that_turns_too_slowly_is_told_by_its_turn() -> None:
    found = upright([(0.5, 0.0, 0.5)], (0.5, 0.0, 1.0))
    assert (found.event.cause, found.event.description) == (rules.SLOW, "turns at 0.50 of the commanded 1.00 rad/s")
    assert upright([(0.5, 0.0, -0.5)], (0.5, 0.0, 1.0)).event.cause == rules.GAIT  # in the opposite direction


def test_disturbances_leave_it_open_whether_it_was_the_policy() -> None:
    windy = Scenario("made", force=SteadyForce(5.0))
    assert not upright([(0.1, 0.0, 0.0)], scenario=windy).certain
    assert upright([(1.5, 0.0, 0.0)], scenario=windy).event.cause == rules.UNCLEAR


def test_motors_at_their_limit_decide_of_an_upright_robot_and_are_certain_alone() -> None:
    torque = np.zeros((200, 2, 12), np.float32)
    torque[:, 1, :2] = 100.0
    found = upright([(0.6, 0.0, 0.0)], joint_torque=torque)
    assert (found.event.cause, found.certain) == (rules.MOTOR, True)
    torque[:, 1, 1] = 0.0  # 1 of 12 joints, relative to a tenth: close to the threshold
    for scenario in (Scenario("made"), Scenario("made", motors=Motors(bandwidth=20.0))):  # servos without lag
        found = upright([(0.6, 0.0, 0.0)], scenario=scenario, joint_torque=torque)
        assert (found.event.cause, found.certain) == (rules.SLOW, False)


def test_a_policy_that_failed_is_told_by_its_own_words_at_its_own_step() -> None:
    episodes = uneventful(
        SIMPLE_QUAD,
        300,
        2,
        failure=np.array(["raised", "gave\n targets that are   not finite"], object),
        failure_step=np.array([10, 42]),
        scenario=Scenario("made"),
    )
    found = verdict(EpisodeSignals(episodes, Scenario("made"), 1), replace(measure(episodes)))
    words = "the policy gave targets that are not finite"
    assert found == Verdict(Event(rules.POLICY, 42, 1.0, words), True)
