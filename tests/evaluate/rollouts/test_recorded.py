"""Stored parts of a rollout, and their join into a cell, by hand."""

import dataclasses
from collections.abc import Generator, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import policies
from evaluate.cells import EpisodeChunk, LabelledPolicy, PolicyScenarioResult, Task, apply_success_rule, join
from evaluate.measures.episodes import shapes
from evaluate.measures.metrics import MEASURE_NAMES, measure
from evaluate.measures.outcomes import OFF_COMMAND, STALLED, SUCCEEDED, SuccessRule
from evaluate.rollouts.observers import FallRecorder, Step
from evaluate.rollouts.rollout import EpisodeRecorder
from evaluate.rollouts.run import RunSettings, StoreError, run_cells
from quad_env import SCENARIOS, SIMPLE_QUAD
from quad_env.config import FALL_REASONS
from quad_env.task.observations import observation_table
from tests.evaluate.measures.uneventful import uneventful

FLAT = SCENARIOS["flat"]
ENV: Any = SimpleNamespace(
    robot=SIMPLE_QUAD,
    observes_true_state=False,
    observation_table=observation_table(SIMPLE_QUAD),
    dt=0.02,
    scenario=FLAT,
    pushes=SimpleNamespace(first_step=np.array([[3], [4]]), force=np.full((2, 1, 2), 10.0), steps=5),
    simulation=SimpleNamespace(meter=SimpleNamespace(torque_limit=np.arange(12.0), speed_limit=np.arange(12.0) + 20.0)),
)
NONE = np.zeros(2, np.int8)


def told(number: int, fall: Sequence[str] = ("none", "none"), diverged: Sequence[bool] = (False, False)) -> Step:
    """Return a step of two robots; every signal is the index of the step, plus one half for the second robot."""
    infos: dict[str, Any] = {}
    for name, shape in shapes(SIMPLE_QUAD).items():
        infos[name] = (number + np.array([0.0, 0.5])).reshape(2, *(1,) * len(shape)) * np.ones((2, *shape))
    infos["foot_contact"], infos["leg_contact"] = np.full((2, 4), number % 2 == 0), np.full(2, number % 3 == 0)
    infos["fall"] = np.array([FALL_REASONS.index(reason) for reason in fall], np.int8)
    infos["diverged"] = np.array(diverged)
    observation = np.tile(np.arange(48.0), (2, 1)).astype(np.float32) + number
    return Step(number, ENV, np.zeros((2, 12), np.float32), observation, infos)


def test_every_step_is_kept_in_its_row_and_the_start_in_none() -> None:
    policy: Any = SimpleNamespace(stopped=np.array([False, True]))
    recorder = EpisodeRecorder(policy, np.array([7, 8]), 4)
    for number in range(4):
        policy.stopped = np.array([number == 2, True])
        recorder(told(number))
    found = recorder.episodes()
    np.testing.assert_array_equal(found.height, [[1.0, 1.5], [2.0, 2.5], [3.0, 3.5], [0.0, 0.0]])
    np.testing.assert_array_equal(found.joint_torque[1], np.tile([[2.0], [2.5]], 12))
    assert found.foot_contact[:, 0, 0].tolist() == [False, True, False, False]
    assert found.leg_contact[:, 0].tolist() == [False, False, True, False]
    assert found.stopped is not None
    assert found.stopped.tolist() == [[False, True], [True, True], [False, True], [False, False]]
    assert found.observed is not None
    np.testing.assert_array_equal(found.observed[1, 0], 2.0 + np.arange(9))  # gravity and velocities are first
    assert (found.dt, found.push_steps, found.seeds.tolist()) == (0.02, 5, [7, 8])
    np.testing.assert_allclose(found.push_impulse, 10.0 * 5 * 0.02)
    assert found.push_step.tolist() == [[3], [4]]
    assert found.torque_limit == tuple(range(12))
    assert found.speed_limit == tuple(range(20, 32))
    assert found.command_steps == FLAT.commands.steps(0.02)


def test_a_policy_that_is_shown_the_truth_and_never_stops_has_no_such_signals() -> None:
    policy: Any = SimpleNamespace()
    recorder = EpisodeRecorder(policy, np.array([7, 8]), 2)
    env = SimpleNamespace(**{**vars(ENV), "observes_true_state": True})
    recorder(dataclasses.replace(told(0), env=env))
    recorder(dataclasses.replace(told(1), env=env))
    found = recorder.episodes()
    assert found.stopped is None
    assert found.observed is None


def test_a_failure_counts_from_the_step_in_which_it_was_told_unless_the_robot_had_fallen() -> None:
    policy: Any = SimpleNamespace(failure=np.full(2, None, dtype=object))
    recorder = EpisodeRecorder(policy, np.array([7, 8]), 6)
    recorder(told(0))
    for number in range(1, 6):
        if number == 3:
            policy.failure = np.array(["raised", None], object)
        if number == 5:
            policy.failure = np.array(["raised", "late"], object)
        recorder(told(number, ("none", "tilt") if number >= 4 else ("none", "none")))
    found = recorder.episodes()
    assert found.failure.tolist() == ["raised", None]
    assert found.failure_step.tolist() == [2, 6]
    assert found.fall_step.tolist() == [6, 3]
    assert found.fall_reason.tolist() == [None, "tilt"]


def test_a_divergence_is_noted_though_the_robot_has_fallen_before_and_is_its_own_reason_else() -> None:
    falls = FallRecorder(3, 9)
    for number, fall, diverged in (
        (1, ["none"] * 3, [False] * 3),
        (2, ["height", "none", "none"], [False, True, False]),
        (3, ["height", "tilt", "none"], [True, True, False]),
        (4, ["none", "none", "trunk_contact"], [True, True, False]),
    ):
        codes = np.array([FALL_REASONS.index(reason) for reason in fall], np.int8)
        falls(Step(number, None, None, None, {"fall": codes, "diverged": np.array(diverged)}))  # type: ignore[arg-type]
    assert falls.step.tolist() == [1, 1, 3]
    assert falls.reason.tolist() == ["height", "diverged", "trunk_contact"]
    assert falls.divergence_step.tolist() == [2, 1, 9]


def cell(numbers: Sequence[int], policy: str = "trot") -> PolicyScenarioResult:
    """Return a cell; each measure of an episode encodes the number of the episode."""
    found = measure(uneventful(SIMPLE_QUAD, 200, len(numbers)))
    of_each = np.array(numbers, np.float64)
    fields = {}
    for name in MEASURE_NAMES:
        values = getattr(found, name)
        fields[name] = (
            values
            if values.dtype == object
            else (np.broadcast_to(of_each.reshape(-1, *(1,) * (values.ndim - 1)), values.shape).astype(values.dtype))
        )
    fields["outcome"] = np.array([f"outcome {each}" for each in numbers], object)
    measures = dataclasses.replace(found, **fields)
    reasons = np.array([f"reason {each}" for each in numbers], object)
    return PolicyScenarioResult(
        policy, FLAT, 100 + np.array(numbers), reasons, measures, np.array([f"why {n}" for n in numbers], object)
    )


def test_parts_of_a_cell_are_joined_in_the_order_of_their_episodes() -> None:
    parts = [EpisodeChunk(np.array(numbers), cell(numbers)) for numbers in ([3, 4], [0], [1, 2])]
    found, whole = join(parts), cell(range(5))
    assert found.seeds.tolist() == [100, 101, 102, 103, 104]
    assert found.fall_reason.tolist() == whole.fall_reason.tolist()
    assert found.failure.tolist() == whole.failure.tolist()
    for name in MEASURE_NAMES:
        ours, theirs = getattr(found.measures, name), getattr(whole.measures, name)
        np.testing.assert_array_equal(ours, theirs, err_msg=name)


class Kept:
    """Store that already has some parts of each cell."""

    def __init__(self, *there: Sequence[int], failing: bool = False) -> None:
        self.there, self.failing = there, failing
        self.saved: list[tuple[str, list[int]]] = []

    def load(self, policy: str, scenario: Any) -> list[EpisodeChunk]:
        return [EpisodeChunk(np.array(numbers), cell(numbers, policy)) for numbers in self.there]

    def save(self, chunk: EpisodeChunk) -> None:
        if self.failing:
            raise OSError(28, "No space left on device", "part")
        self.saved.append((chunk.cell.policy, chunk.episode_indices.tolist()))


def simulated(store: Kept, count: int = 10, names: Sequence[str] = ("trot", "stand"), **settings: Any) -> Any:
    """Return cells, tasks and progress of a run; its tasks finish in another order."""
    tasks: list[Task] = []
    shares: list[tuple[str, float]] = []

    def execute(all_of_them: Sequence[Task], progress: Any) -> Generator[tuple[int, EpisodeChunk]]:
        tasks.extend(all_of_them)
        for place in reversed(range(len(all_of_them))):
            task = all_of_them[place]
            progress(place, 0.5)
            yield place, EpisodeChunk(task.episode_indices, cell(task.episode_indices.tolist(), task.policy.label))

    how = RunSettings(
        1, lambda policy, _, share: shares.append((policy, share)), store=store, executor=execute, **settings
    )
    labelled = [LabelledPolicy(name, policies.make(name)) for name in names]
    return list(run_cells(labelled, [FLAT], 100 + np.arange(count), how)), tasks, shares


def test_what_is_stored_is_not_simulated_again_and_the_rest_in_stretches_without_a_gap() -> None:
    store = Kept([2, 3], [7])
    cells, tasks, shares = simulated(store, chunk_size=3)
    of_trot = [task.episode_indices.tolist() for task in tasks if task.policy.label == "trot"]
    assert of_trot == [[0, 1], [4, 5, 6], [8, 9]]
    assert [task.seeds.tolist() for task in tasks][:3] == [[100, 101], [104, 105, 106], [108, 109]]
    assert [each.policy for each in cells] == ["stand", "trot"]  # in the order of completion
    for each in cells:
        assert each.seeds.tolist() == list(range(100, 110))
    parts = [[8, 9], [4, 5, 6], [0, 1]]
    assert store.saved == [(policy, numbers) for policy in ("stand", "trot") for numbers in parts]
    of_one = [share for policy, share in shares if policy == "trot"]
    assert of_one == pytest.approx([0.4, 0.3 + 0.2 + 0.15, 0.3 + 0.5 + 0.1, 1.0])


def test_stretches_end_at_every_gap_however_long_a_part_may_be() -> None:
    _, tasks, _ = simulated(Kept([2, 3], [7]), chunk_size=50, names=("trot",))
    assert [task.episode_indices.tolist() for task in tasks] == [[0, 1], [4, 5, 6], [8, 9]]
    _, tasks, _ = simulated(Kept(), chunk_size=4, names=("trot",))
    assert [task.episode_indices.tolist() for task in tasks] == [[0, 1, 2, 3], [4, 5, 6], [7, 8, 9]]


def test_a_cell_that_is_stored_comes_before_anything_is_simulated() -> None:
    store = Kept(range(6), [9, 8, 7, 6])
    cells, tasks, shares = simulated(store)
    assert not tasks
    assert [each.policy for each in cells] == ["trot", "stand"]
    assert shares == [("trot", 1.0), ("stand", 1.0)]


def test_what_cannot_be_kept_ends_the_run() -> None:
    with pytest.raises(StoreError, match="No space left"):
        simulated(Kept(failing=True))


def test_a_policy_runs_on_its_own_scenarios_alone_and_on_the_hardware_profile_as_it_is_made_for_it() -> None:
    made, real = policies.make("trot"), policies.make("trot")
    policy = LabelledPolicy("trot", made, ("push",), real)
    hardware = dataclasses.replace(FLAT, hardware=True)
    assert [policy.runs_on(SCENARIOS[name]) for name in ("flat", "push")] == [False, True]
    assert policy.policy_for(FLAT) is made
    assert policy.policy_for(hardware) is real
    assert policy.variants == (made, real)
    alone = LabelledPolicy("trot", made)
    assert alone.runs_on(FLAT)
    assert alone.policy_for(hardware) is made
    assert alone.variants == (made,)


def test_another_rule_of_success_makes_successes_of_those_alone_that_follow_it() -> None:
    """The errors are 0.1 m/s, and 0.05 or 0.2 m/s are allowed.

    A fall or a failure of the policy is no success, and earlier failures remain.
    """
    found = cell(range(4))
    velocities = np.zeros((4, 1, 3))
    velocities[..., 0] = 0.9
    commands = np.zeros((4, 1, 3))
    commands[..., 0] = 1.0
    measures = dataclasses.replace(
        found.measures,
        commands=commands,
        mean_velocities=velocities,
        fell=np.array([False, False, True, False]),
        outcome=np.array([SUCCEEDED, STALLED, "fell", "policy_error"], object),
    )
    kept = dataclasses.replace(found, measures=measures, failure=np.array([None, None, None, "raised"], object))
    strict, lenient = (SuccessRule("rule", each, 1.0, 0.0) for each in (0.05, 0.2))
    assert apply_success_rule(kept, strict).measures.outcome.tolist() == [OFF_COMMAND, STALLED, "fell", "policy_error"]
    assert apply_success_rule(kept, lenient).measures.outcome.tolist() == [SUCCEEDED, SUCCEEDED, "fell", "policy_error"]
