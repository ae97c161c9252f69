"""Rollouts: one episode an env, the same starts for every policy, nothing after a fall."""

from dataclasses import replace

import numpy as np
import pytest

import policies
import quad_env
from evaluate import battery, rollout
from evaluate.experiment import EPISODES_AT_ONCE, Entrant, evaluation_seeds, run_cell
from evaluate.metrics import measure
from policies.base import Policy

STEPS = 150
PUSHED = replace(quad_env.SCENARIOS["push"], pushes=quad_env.Pushes(count=1, impulse=20.0, window=(0.1, 0.4)))
"""A push early enough to fell a standing robot within a short test."""


class Watcher(Policy):
    """Stands, and keeps every observation it was shown."""

    name = "watcher"

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[np.ndarray] = []

    def _act(self, observation: np.ndarray) -> np.ndarray:
        self.seen.append(observation.copy())
        return np.tile(quad_env.robot.HOME_POSE.astype(np.float32), (len(observation), 1))


def run(policy: str = "stand", scenario=PUSHED, count: int = 12, **options) -> rollout.Episodes:
    return rollout.run(policies.make(policy), scenario, evaluation_seeds(0, count), steps=STEPS, **options)


def test_there_is_one_episode_for_each_seed_however_many_fall() -> None:
    episodes = run()
    fell = episodes.fall_step < STEPS
    assert 0 < fell.sum() < 12, "some must fall and some not for this to show anything"
    assert episodes.command.shape == episodes.heading_velocity.shape == (STEPS, 12, 3)
    assert episodes.mechanical_power.shape == (STEPS, 12)
    np.testing.assert_array_equal(episodes.seeds, evaluation_seeds(0, 12))
    assert [reason is not None for reason in episodes.fall_reason] == fell.tolist()


def test_an_episode_is_the_same_in_any_company_and_on_any_threads() -> None:
    together, threads = run(nthread=2), run(nthread=1)
    alone = rollout.run(policies.make("stand"), PUSHED, evaluation_seeds(0, 12)[5:6], steps=STEPS, nthread=1)
    fall = together.fall_step[5]
    for name in ("command", "heading_velocity", "mechanical_power"):
        np.testing.assert_array_equal(getattr(together, name)[:fall], getattr(threads, name)[:fall])
        np.testing.assert_array_equal(getattr(together, name)[:fall, 5], getattr(alone, name)[:fall, 0])
    assert alone.fall_step[0] == fall
    for name in ("velocity_error", "yaw_rate_error", "mean_velocity_error", "energy", "distance"):
        assert getattr(measure(alone), name)[0] == getattr(measure(together), name)[5]


def test_the_policy_is_shown_the_latest_observation() -> None:
    """Step k's observation holds the velocity that step k−1's info reported, and the target sent in step k−1."""
    watcher = Watcher()
    episodes = rollout.run(watcher, "flat", evaluation_seeds(0, 3), steps=20)
    for step in range(1, 20):
        lateral_and_forward = watcher.seen[step][:, quad_env.OBSERVATION["linear_velocity"]]
        upright = np.abs(watcher.seen[step][:, 2] + 1.0) < 0.01
        planar = np.linalg.norm(lateral_and_forward[:, :2], axis=1)
        reported = np.linalg.norm(episodes.heading_velocity[step - 1, :, :2], axis=1)
        np.testing.assert_allclose(planar[upright], reported[upright], atol=0.05)
    assert len(watcher.seen) == 20


def test_progress_rises_and_ends_with_one_exactly_once() -> None:
    shares: list[float] = []
    run("document", "flat", 2, progress=shares.append)
    assert shares == sorted(shares)
    assert shares.count(1.0) == 1
    assert shares[-1] == 1.0


def test_a_diverged_episode_is_a_fall_with_its_own_column() -> None:
    recorder = rollout._Recorder(3, 2)
    infos = {
        "command": np.zeros((2, 3)),
        "heading_velocity": np.zeros((2, 3)),
        "mechanical_power": np.zeros(2),
        "overspeed": np.zeros(2),
        "fall": np.array([None, None], dtype=object),
        "diverged": np.array([True, False]),
    }
    recorder.record(0, np.array([True, False]), infos)
    episodes = recorder.episodes(np.array([0, 1]), 0.01, 2)
    np.testing.assert_array_equal(episodes.fall_step, [0, 3])
    np.testing.assert_array_equal(episodes.diverged, [True, False])
    assert episodes.fall_reason.tolist() == ["diverged", None]


def test_the_first_fall_counts() -> None:
    recorder = rollout._Recorder(5, 1)
    for step, terminated in enumerate((False, True, True, True)):
        infos = {
            "command": np.zeros((1, 3)),
            "heading_velocity": np.zeros((1, 3)),
            "mechanical_power": np.zeros(1),
            "overspeed": np.zeros(1),
            "fall": np.array(["tilt" if step == 1 else "height"], dtype=object),
            "diverged": np.array([False]),
        }
        recorder.record(step, np.array([terminated]), infos)
    assert recorder.fall_step.tolist() == [1]
    assert recorder.fall_reason.tolist() == ["tilt"]


def test_many_episodes_run_in_parts_with_the_same_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    assert EPISODES_AT_ONCE >= 128
    entrant, seeds = Entrant("document", policies.make("document")), evaluation_seeds(0, 5)
    whole = run_cell(entrant, quad_env.SCENARIOS["flat"], seeds, 2, lambda *_: None)
    monkeypatch.setattr("evaluate.experiment.EPISODES_AT_ONCE", 2)
    shares: list[float] = []
    parts = run_cell(entrant, quad_env.SCENARIOS["flat"], seeds, 2, lambda _, __, share: shares.append(share))
    np.testing.assert_array_equal(parts.seeds, seeds)
    np.testing.assert_array_equal(parts.measures.fall_time, whole.measures.fall_time)
    assert shares.count(1.0) == 1


def test_the_battery_lists_its_scenarios_when_asked_for_another() -> None:
    with pytest.raises(ValueError, match="flat, push, rough"):
        battery.resolve(("flatt",))
    with pytest.raises(ValueError, match="twice"):
        battery.resolve(("flat", "flat"))
    assert [s.name for s in battery.resolve(("all",))] == list(quad_env.SCENARIOS)
    assert set(battery.DEFAULT) <= set(quad_env.SCENARIOS)
