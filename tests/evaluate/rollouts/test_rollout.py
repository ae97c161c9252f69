"""Rollouts: one episode per environment, equal initial states for every policy, and no data after a fall."""

from dataclasses import fields, replace

import numpy as np
import pytest

import policies
import quad_env
from evaluate.cells import LabelledPolicy, evaluation_seeds
from evaluate.measures.episodes import OBSERVED_SIGNAL, POLICY_SIGNALS, Episodes, shapes
from evaluate.measures.metrics import measure
from evaluate.rollouts import rollout
from evaluate.rollouts.observers import FallRecorder, Step
from evaluate.rollouts.run import RunSettings, run_cells
from policies.base import Policy
from quad_env.robots.simple_quad import SIMPLE_QUAD

STEPS = 150
PUSHED = replace(quad_env.SCENARIOS["push"], pushes=quad_env.Pushes(count=1, impulse=20.0, window=(0.1, 0.4)))
"""Scenario with a push that is early enough to fell a standing robot within a short test."""


class Watcher(Policy):
    """Standing policy that stores its observations."""

    name = "watcher"

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[np.ndarray] = []
        self.asked, self.answers = False, []

    def _act(self, observation: np.ndarray) -> np.ndarray:
        self.seen.append(observation.copy())
        self.answers.append(self.asked)
        return np.tile(SIMPLE_QUAD.home_pose.astype(np.float32), (len(observation), 1))


def run(policy: str = "stand", scenario=PUSHED, count: int = 12, **options) -> Episodes:
    return rollout.run(policies.make(policy), scenario, evaluation_seeds(0, count), steps=STEPS, **options)


def test_there_is_one_episode_for_each_seed_however_many_fall() -> None:
    episodes = run()
    fell = episodes.fall_step < STEPS
    assert 0 < fell.sum() < 12, "some must fall and some not for this to show anything"
    assert episodes.command.shape == episodes.heading_velocity.shape == (STEPS, 12, 3)
    assert episodes.joint_torque.shape == (STEPS, 12, 12)
    np.testing.assert_array_equal(episodes.seeds, evaluation_seeds(0, 12))
    assert [reason is not None for reason in episodes.fall_reason] == fell.tolist()


def test_a_record_knows_what_its_scenario_gave() -> None:
    often = replace(PUSHED, commands=replace(PUSHED.commands, interval=2.0))
    episodes = run(scenario=often, count=3)
    assert episodes.command_steps == 200
    np.testing.assert_allclose(np.linalg.norm(episodes.push_impulse, axis=-1), 20.0)
    weak = rollout.run(policies.make("stand"), "weak_motors=10", evaluation_seeds(0, 1), steps=1)
    assert weak.torque_limit == pytest.approx((10.0,) * 12)
    assert weak.speed_limit == (weak.robot.rated_speed,) * 12


@pytest.mark.parametrize(
    "change", [{"kicks": quad_env.Kicks()}, {"commands": quad_env.CommandRanges(random_intervals=True)}]
)
def test_a_scenario_of_the_training_alone_is_no_record(change: dict) -> None:
    with pytest.raises(ValueError, match="scenario push: kicks and random command intervals are for training only"):
        run(scenario=replace(PUSHED, **change), count=1)


def test_an_episode_is_the_same_in_any_company_and_on_any_threads() -> None:
    together, threads = run(nthread=2), run(nthread=1)
    alone = rollout.run(policies.make("stand"), PUSHED, evaluation_seeds(0, 12)[5:6], steps=STEPS, nthread=1)
    fall = together.fall_step[5]
    for name in set(shapes(SIMPLE_QUAD)) - {*POLICY_SIGNALS, OBSERVED_SIGNAL}:
        np.testing.assert_array_equal(getattr(together, name)[:fall], getattr(threads, name)[:fall])
        np.testing.assert_array_equal(getattr(together, name)[:fall, 5], getattr(alone, name)[:fall, 0])
    assert alone.fall_step[0] == fall
    one, many = measure(alone), measure(together)
    for field in (each for each in fields(one) if each.name != "extra"):
        np.testing.assert_array_equal(getattr(one, field.name)[0], getattr(many, field.name)[5], err_msg=field.name)


def test_the_policy_is_shown_the_latest_observation() -> None:
    """The observation of step k has the velocity in the info of step k−1 and the target of step k−1."""
    watcher = Watcher()
    episodes = rollout.run(watcher, "flat", evaluation_seeds(0, 3), steps=20)
    for step in range(1, 20):
        lateral_and_forward = watcher.seen[step][:, quad_env.OBSERVATION["linear_velocity"]]
        upright = np.abs(watcher.seen[step][:, 2] + 1.0) < 0.01
        planar = np.linalg.norm(lateral_and_forward[:, :2], axis=1)
        reported = np.linalg.norm(episodes.heading_velocity[step - 1, :, :2], axis=1)
        np.testing.assert_allclose(planar[upright], reported[upright], atol=0.05)
    assert len(watcher.seen) == 20


def after(number: int, fall: list[str], diverged: list[bool]) -> Step:
    """Return the step that observers receive for robots with these causes of a fall."""
    codes = np.array([quad_env.FALL_REASONS.index(reason) for reason in fall], np.int8)
    return Step(number, None, None, None, {"fall": codes, "diverged": np.array(diverged)})


def test_the_first_fall_counts_and_a_divergence_is_one_with_its_own_column() -> None:
    falls = FallRecorder(2, 3)
    falls(after(1, ["none", "none"], [True, False]))
    np.testing.assert_array_equal(falls.step, [0, 3])
    np.testing.assert_array_equal(falls.divergence_step, [0, 3])
    assert falls.reason.tolist() == ["diverged", None]
    assert falls.fell.tolist() == [True, False]
    falls = FallRecorder(1, 5)
    for number, reason in enumerate(("none", "none", "tilt", "height", "height")):
        falls(after(number, [reason], [False]))
    assert (falls.step.tolist(), falls.reason.tolist()) == ([1], ["tilt"])


def test_observers_are_told_the_start_and_every_step_in_order_until_one_has_seen_enough() -> None:
    told: list[tuple[str, int]] = []
    watcher = Watcher()

    def first(step: Step) -> bool:
        told.append(("first", step.number))
        return step.number == 3

    def second(step: Step) -> None:
        told.append(("second", step.number))

    rollout.roll_out(watcher, "flat", evaluation_seeds(0, 2), first, second, steps=20)
    assert told == [(name, number) for number in range(4) for name in ("first", "second")]
    assert len(watcher.seen) == 3


def test_a_rollout_ends_when_no_robot_moves_any_more() -> None:
    numbers: list[int] = []
    falls = FallRecorder(2, STEPS)
    rollout.roll_out(
        policies.make("document"),
        "flat",
        evaluation_seeds(0, 2),
        falls,
        lambda step: numbers.append(step.number),
        steps=STEPS,
    )
    assert falls.fell.all()
    assert numbers == list(range(falls.step.max() + 2))


def test_what_an_observer_asks_of_the_policy_counts_from_the_next_action_and_the_command_is_held() -> None:
    policy, commands = Watcher(), []

    def watch(step: Step) -> None:
        commands.append(step.observation[:, quad_env.OBSERVATION["command"]].tolist())
        policy.asked = step.number == 3

    held = [[0.25, 0.0, 0.5], [0.0, -0.5, 0.0]]
    rollout.roll_out(policy, "flat", evaluation_seeds(0, 2), watch, steps=6, command=held)
    assert policy.answers == [False, False, False, True, False, False]
    assert commands == [held] * 7


def test_many_episodes_run_in_chunks_with_the_same_outcome() -> None:
    assert RunSettings.chunk_size >= 128
    policy, seeds = LabelledPolicy("document", policies.make("document")), evaluation_seeds(0, 5)
    whole = next(run_cells([policy], [quad_env.SCENARIOS["flat"]], seeds, RunSettings(2, lambda *_: None)))
    shares: list[float] = []
    settings = RunSettings(2, lambda _, __, share: shares.append(share), chunk_size=2)
    chunks = next(run_cells([policy], [quad_env.SCENARIOS["flat"]], seeds, settings))
    np.testing.assert_array_equal(chunks.seeds, seeds)
    np.testing.assert_array_equal(chunks.measures.fall_time, whole.measures.fall_time)
    assert (shares, shares.count(1.0)) == (sorted(shares), 1)


def test_a_policy_of_another_control_period_or_robot_is_refused_with_the_remedy() -> None:
    longer = replace(SIMPLE_QUAD, name="longer", calf_length=0.31)
    for policy in (policies.make("trot", control_period=0.02), policies.make("trot", robot=longer)):
        with pytest.raises(ValueError, match=r"robot=env.unwrapped.robot, control_period=env.unwrapped.dt"):
            rollout.run(policy, "flat", evaluation_seeds(0, 1), steps=1)


class Failing(Watcher):
    """Standing policy that reports a failure of every robot from a given call on."""

    def __init__(self, call: int) -> None:
        super().__init__()
        self._call = call

    @property
    def failure(self) -> np.ndarray:
        reason = "raised" if len(self.seen) >= self._call else None
        return np.full(self.num_envs, reason, dtype=object)


def test_a_failure_of_the_policy_counts_unless_the_robot_has_fallen_before() -> None:
    seeds = evaluation_seeds(0, 12)
    for call, counts in ((1, np.ones(12, bool)), (STEPS, run().fall_step >= STEPS - 1)):
        episodes = rollout.run(Failing(call), PUSHED, seeds, steps=STEPS)
        assert counts.sum() > 0
        np.testing.assert_array_equal(episodes.failed, counts)
        assert set(measure(episodes).outcome[counts]) == {"policy_error"}
    assert not run().failed.any()
