"""Several policies in one batch of robots give the episodes of one batch per policy, bit for bit."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

import policies
from evaluate.cells import (
    EpisodeChunk,
    LabelledPolicy,
    PolicyScenarioResult,
    Task,
    evaluation_seeds,
    load_labelled_policy,
)
from evaluate.hardware import IDEAL
from evaluate.measures import metrics
from evaluate.records.episode_table import table
from evaluate.rollouts import battery, rollout, workers
from evaluate.rollouts.run import RunSettings, run_cells, sequential, simulate_group
from evaluate.rollouts.task_groups import group_tasks
from policies.history import Inputs
from policies.network import Network
from policies.residual import Features, ResidualPolicy
from policies.safety import Safe
from quad_env import SCENARIOS as SCENARIO_REGISTRY
from quad_env import Scenario
from tests.batches import begun

STEPS = 130
EPISODES = 3
SHIPPED = ("trot", "trot_reference", "mpc", "models/residual")
SCENARIOS = ("push:4", "rough:3+randomised", "push:4+hardware")
Stand = type(policies.make("stand"))


class Collapse(Stand):
    """Policy whose robots all fall in the first second."""

    def _act(self, observation):
        return np.tile(self.robot.joint_lower.astype(np.float32), (len(observation), 1))


class Raising(Stand):
    """Policy that raises in its 40th action."""

    calls = 0

    def _act(self, observation):
        self.calls += 1
        if self.calls == 40:
            raise ZeroDivisionError("a bug")
        return super()._act(observation)


class NotFinite(Stand):
    """Policy with targets that are not finite."""

    def _act(self, observation):
        return np.full_like(super()._act(observation), np.nan)


class Precise(Stand):
    """Policy with targets in double precision, which single precision would round."""

    def _act(self, observation):
        return super()._act(observation).astype(np.float64) + 1e-9


def with_history() -> ResidualPolicy:
    """Return a policy whose network reads past observations, with random weights."""
    base = policies.make("trot", servo=(60.0, 2.0))
    inputs = Inputs(lags=(0.04, 0.08), averages=(0.5,))
    rng = np.random.default_rng(3)
    width = Features(base, inputs).width
    weights = rng.normal(0.0, 0.02, size=(width, base.robot.num_joints)).astype(np.float32)
    network = Network((weights,), (np.zeros(base.robot.num_joints, np.float32),))
    return ResidualPolicy(base, network, inputs=inputs)


def compared(scenarios: Sequence[Scenario]) -> list[LabelledPolicy]:
    """Return policies of several servo gains: with a network, memory, a solver, a safety layer, and one that falls."""
    loaded = [load_labelled_policy(name, IDEAL, scenarios) for name in SHIPPED]
    own = {"history": with_history(), "collapse": Collapse(), "precise": Precise(), "safe": Safe(policies.make("trot"))}
    return [*loaded, *(LabelledPolicy(name, policy) for name, policy in own.items())]


def tables(cells: Sequence[PolicyScenarioResult]) -> dict[tuple[str, str], pa.Table]:
    """Return the rows of episodes.parquet of each cell."""
    return {(cell.policy, cell.scenario.name): table(cell) for cell in cells}


def simulated(scenarios: Sequence[Scenario], **settings) -> dict[tuple[str, str], pa.Table]:
    how = RunSettings(1, lambda *_: None, steps=STEPS, **settings)
    return tables(list(run_cells(compared(scenarios), scenarios, evaluation_seeds(0, EPISODES), how)))


def assert_same(ours: dict[tuple[str, str], pa.Table], theirs: dict[tuple[str, str], pa.Table]) -> None:
    assert set(ours) == set(theirs)
    for cell, rows in theirs.items():
        for name in rows.column_names:
            assert ours[cell].column(name).to_pylist() == rows.column(name).to_pylist(), (cell, name)


@pytest.fixture(scope="module")
def scenarios() -> tuple[Scenario, ...]:
    return battery.resolve(SCENARIOS, IDEAL.robot_model)


@pytest.fixture(scope="module")
def apart(scenarios) -> dict[tuple[str, str], pa.Table]:
    """Return the episodes of every policy on every scenario, each cell in a batch of its own."""
    with begun() as batches:
        found = simulated(scenarios, executor=sequential(1))
    assert {len(batch.seeds) for batch in batches} == {EPISODES}
    outcomes = {cell: rows.column("outcome").to_pylist() for cell, rows in found.items()}
    assert set(outcomes["collapse", "push:4"]) == {"fell"}
    assert "fell" not in outcomes["trot", "push:4"]
    return found


@pytest.mark.parametrize("max_rows", [7, 256])
def test_every_column_is_that_of_policies_alone(scenarios, apart, max_rows) -> None:
    with begun() as batches:
        together = simulated(scenarios, executor=sequential(1, max_rows))
    assert max(len(batch.seeds) for batch in batches) == (6 if max_rows == 7 else EPISODES * 8)
    assert_same(together, apart)


def test_chunks_of_any_size_and_two_workers_give_the_same_columns(scenarios, apart, monkeypatch) -> None:
    monkeypatch.setattr(workers, "MIN_PARALLEL_STEPS", 0)
    found = simulated(scenarios[:1], chunk_size=2, executor=workers.process_pool(2, max_rows=5))
    assert_same(found, {cell: rows for cell, rows in apart.items() if cell[1] == scenarios[0].name})


def stored(policies_by_name: dict[str, policies.Policy], executor, count: int = 2) -> tuple[list[str], BaseException]:
    """Return the names of the policies whose episodes are stored, and the exception that ends the run."""
    saved: list[str] = []

    class Store:
        def load(self, policy: str, scenario: Scenario) -> list[EpisodeChunk]:
            return []

        def save(self, chunk: EpisodeChunk) -> None:
            saved.append(chunk.cell.policy)

    compared = [LabelledPolicy(name, policy) for name, policy in policies_by_name.items()]
    how = RunSettings(1, lambda *_: None, steps=STEPS, executor=executor, store=Store())
    with pytest.raises((ValueError, ZeroDivisionError)) as raised:
        list(run_cells(compared, [SCENARIO_REGISTRY["flat"]], evaluation_seeds(0, count), how))
    return saved, raised.value


@pytest.mark.parametrize("pool", [False, True])
def test_an_exception_of_a_policy_is_raised_when_the_others_are_done(pool, monkeypatch) -> None:
    monkeypatch.setattr(workers, "MIN_PARALLEL_STEPS", 0)
    executor = workers.process_pool(2, max_rows=6) if pool else sequential(1, 256)
    members = {"stand": Stand(), "raising": Raising(), "trot": policies.make("trot"), "crouch": policies.make("crouch")}
    saved, error = stored(members, executor)
    assert isinstance(error, ZeroDivisionError)
    assert {"stand", "trot"} <= set(saved) <= {"stand", "trot", "crouch"}


@pytest.mark.parametrize(
    ("member", "message"),
    [
        (NotFinite(), "an action is finite joint targets in rad"),
        (Stand(control_period=0.02), "made for .* with a control period of 0.02 s, not for"),
    ],
)
def test_a_wrong_member_has_the_error_that_it_has_alone(member, message) -> None:
    for executor in (sequential(1), sequential(1, 256)):
        saved, error = stored({"stand": Stand(), "wrong": member, "other": Stand()}, executor)
        assert isinstance(error, ValueError)
        assert re.search(message, str(error))
    assert saved == ["stand", "other"]


def test_a_batch_for_which_memory_is_short_is_split(monkeypatch) -> None:
    make_env, counts = rollout.make_env, []

    def small(policy, scenario, count, **how):
        counts.append(count)
        if count > 2:
            raise MemoryError
        return make_env(policy, scenario, count, **how)

    monkeypatch.setattr(rollout, "make_env", small)
    flat = SCENARIO_REGISTRY["flat"]
    seeds = evaluation_seeds(0, 2)
    tasks = [Task(LabelledPolicy(str(i), Stand()), flat, np.arange(2), seeds, STEPS, IDEAL) for i in range(3)]
    result = simulate_group(tasks, 1, lambda _: None)
    assert counts == [6, 2, 2, 2]
    assert [chunk.cell.policy for chunk in result.chunks] == ["0", "1", "2"]


def grouped(*members: LabelledPolicy, max_rows: int = 256, scenario: str = "flat", hardware=IDEAL, chunks: int = 1):
    """Return the groups of tasks of four episodes, one task per policy and chunk."""
    scenario = SCENARIO_REGISTRY[scenario]
    numbers = np.split(np.arange(4), chunks)
    tasks = [Task(each, scenario, part, 7 + part, STEPS, hardware) for each in members for part in numbers]
    return group_tasks(tasks, max_rows)


def stands(count: int, **of_each) -> list[LabelledPolicy]:
    return [LabelledPolicy(str(index), Stand(**of_each)) for index in range(count)]


def test_groups_hold_no_more_rows_than_allowed_and_no_policy_twice() -> None:
    assert grouped(*stands(3), max_rows=12) == [(0, 1, 2)]
    assert grouped(*stands(3), max_rows=11) == [(0, 1), (2,)]
    assert grouped(*stands(3), max_rows=1) == [(0,), (1,), (2,)]
    assert grouped(*stands(2), chunks=2) == [(0, 2), (1, 3)]
    assert grouped(*stands(1), chunks=4) == [(0,), (1,), (2,), (3,)]


def test_a_group_has_several_scenarios_of_one_world_and_the_first_groups_have_one_each(scenarios) -> None:
    pushes, rough, real = scenarios
    members = stands(2)
    tasks = [
        Task(each, scenario, np.arange(4), 7 + np.arange(4), STEPS, IDEAL)
        for scenario in (pushes, rough, real)
        for each in members
    ]
    assert group_tasks(tasks, 256) == [(0, 1, 2, 3), (4, 5)]
    assert group_tasks(tasks, 12) == [(0, 1, 2), (3,), (4, 5)]
    assert group_tasks(tasks, 256, num_small=1) == [(0, 1), (2, 3), (4, 5)]


def test_a_policy_acts_once_for_its_robots_of_all_scenarios(scenarios) -> None:
    class Counted(Stand):
        """Policy that records the number of robots of each call."""

        def __init__(self) -> None:
            super().__init__()
            self.rows: list[int] = []

        def _act(self, observation):
            self.rows.append(len(observation))
            return super()._act(observation)

    counted = Counted()
    how = RunSettings(1, lambda *_: None, steps=STEPS, executor=sequential(1, 256))
    labelled = [LabelledPolicy("counted", counted), LabelledPolicy("other", Stand())]
    list(run_cells(labelled, scenarios[:2], evaluation_seeds(0, EPISODES), how))
    assert counted.rows == [2 * EPISODES] * STEPS


def test_policies_that_can_stop_before_their_reset_run_together(scenarios) -> None:
    class Stoppable(Stand):
        """Policy that has the signal of a safety layer from its construction on."""

        @property
        def stopped(self):
            return np.zeros(self.num_envs, np.bool_)

    how = RunSettings(1, lambda *_: None, steps=STEPS, executor=sequential(1, 256))
    labelled = [LabelledPolicy(name, Stoppable()) for name in ("first", "second")]
    cells = list(run_cells(labelled, scenarios[:2], evaluation_seeds(0, EPISODES), how))
    assert [cell.episodes for cell in cells] == [EPISODES] * 4


def test_policies_that_need_another_environment_run_apart(tmp_path) -> None:
    sighted = LabelledPolicy("sighted", policies.make("mpc_wbc_sighted"))
    slow = stands(1, control_period=0.02)
    assert grouped(*stands(1), sighted, *slow, *stands(1)) == [(0, 3), (1,), (2,)]
    file = tmp_path / "mine.py"
    file.write_text("def act(observation):\n    return [0.0, 0.5, -1.0] * 4\n", encoding="utf-8")
    external = policies.resolve(f"{file}:act")
    safe = LabelledPolicy("safe", Safe(external))
    assert grouped(*stands(1), LabelledPolicy("external", external), safe, *stands(1)) == [(0, 3), (1,), (2,)]
    external.close()


def test_a_simulator_without_gains_of_each_robot_runs_policies_of_equal_gains_together() -> None:
    mixed = [*stands(1), LabelledPolicy("soft", policies.make("trot", servo=(60.0, 2.0))), *stands(1)]
    assert grouped(*mixed) == [(0, 1, 2)]
    assert grouped(*mixed, hardware=replace(IDEAL, simulator="drake")) == [(0, 2), (1,)]


def test_each_policy_of_a_group_reports_its_progress() -> None:
    shares: dict[str, list[float]] = {}
    how = RunSettings(1, lambda policy, _, share: shares.setdefault(policy, []).append(share), steps=STEPS)
    list(run_cells(stands(2), [SCENARIO_REGISTRY["flat"]], evaluation_seeds(0, 2), how))
    expected = [number / STEPS for number in range(0, STEPS, rollout.REPORT_PERIOD)]
    assert shares == dict.fromkeys(("0", "1"), pytest.approx([*expected, 1.0]))


def test_a_measure_of_an_extension_sees_the_episodes_of_its_policy_alone(scenarios) -> None:
    """The signals after the last fall are zero, and signals that only other policies provide are absent."""
    seen: dict[int, list[tuple[float, bool, float]]] = {}
    names = {"collapse": Collapse(), "safe": Safe(policies.make("trot_reference", servo="own")), "stand": Stand()}
    for max_rows in (1, 256):
        with pytest.MonkeyPatch.context() as patch:

            def note(episodes, max_rows=max_rows):
                signals = float(episodes.height[-1].sum()), episodes.stopped is None, episodes.robot.gains.sum()
                seen.setdefault(max_rows, []).append((*signals, episodes.action.tobytes()))
                return {}

            patch.setattr(metrics, "compute_extra", note)
            how = RunSettings(1, lambda *_: None, steps=STEPS, executor=sequential(1, max_rows))
            labelled = [LabelledPolicy(name, policy) for name, policy in names.items()]
            list(run_cells(labelled, scenarios[:1], evaluation_seeds(0, 2), how))
    assert seen[1][0][0] == 0.0
    assert [each[1] for each in seen[1]] == [True, False, True]
    assert seen[256] == seen[1]
