"""Traces: what is read is what was recorded, and going on after a fall changes nothing that came before."""

from dataclasses import fields, replace

import numpy as np
import pytest

import policies
import quad_env
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import measure
from evaluate.records import trace
from evaluate.rollouts import rollout
from evaluate.rollouts.experiment import LabelledPolicy, Settings, evaluation_seeds, run_cell
from evaluate.rollouts.hardware import Hardware
from quad_env.cli.command_line import UsageError
from quad_env.robots.simple_quad import SIMPLE_QUAD
from research.studies import fall_rules
from tests.evaluate.measures.uneventful import uneventful
from tests.quad_env.robots.alike import alike

STEPS = 250
HARD = replace(quad_env.SCENARIOS["push"], pushes=quad_env.Pushes(count=2, impulse=70.0, window=(0.5, 1.9)))


def run(policy: str, after_falls: bool) -> Episodes:
    return rollout.run(policies.make(policy), HARD, evaluation_seeds(0, 12), steps=STEPS, after_falls=after_falls)


@pytest.fixture(scope="module")
def traced() -> Episodes:
    return run("residual", True)


def assert_same(one: object, other: object) -> None:
    for field in (field for field in fields(one) if field.name not in ("scenario", "failure_step")):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)


def test_going_on_after_a_fall_changes_no_measure(traced) -> None:
    stopped = run("residual", False)
    fell = traced.fall_step < STEPS
    assert 0 < fell.sum() < 12, "some must fall and some not for this to show anything"
    assert not np.array_equal(traced.position, stopped.position)
    np.testing.assert_array_equal(traced.fall_step, stopped.fall_step)
    assert traced.fall_reason.tolist() == stopped.fall_reason.tolist()
    assert_same(measure(traced), measure(stopped))


def test_a_full_trace_gives_back_every_bit(traced, tmp_path) -> None:
    header = trace.Header("residual", "hard", 7, "full")
    trace.write(traced, header, tmp_path / "trace.parquet")
    read, episodes = trace.read(tmp_path / "trace.parquet")
    assert read == header
    assert_same(episodes, traced)
    for field in fields(traced):
        if isinstance(value := getattr(traced, field.name), np.ndarray) and field.name != "failure_step":
            assert getattr(episodes, field.name).dtype == value.dtype, field.name
    assert_same(measure(episodes), measure(traced))


def test_a_trace_knows_whose_it_is(traced, tmp_path) -> None:
    """Rules of falls ask for the robot's own height."""
    robot = alike(tmp_path, longer=0.2)
    hardware = Hardware(robot=str(robot.source))
    small = rollout.run(
        hardware.policy("stand"), "flat", evaluation_seeds(0, 2), steps=20, after_falls=True, hardware=hardware
    )
    for kind in ("compact", "full"):
        trace.write(small, trace.Header("stand", "flat", 0, kind), tmp_path / "trace.parquet")
        _, read = trace.read(tmp_path / "trace.parquet", kind)
        assert read.robot == robot
        assert not fall_rules.RULES["height-only"].holds(read).any()
        assert fall_rules.RULES["height-only"].holds(replace(read, robot=SIMPLE_QUAD)).all()  # 0.11 m is low for it
    robot.source.unlink()
    with pytest.raises(UsageError, match=r"trace\.parquet: .*alike\.xml is no file"):
        trace.read(tmp_path / "trace.parquet")
    trace.write(traced, trace.Header("residual", "hard", 0, "full"), tmp_path / "ours.parquet")
    assert trace.read(tmp_path / "ours.parquet")[1].robot is SIMPLE_QUAD


def test_a_compact_trace_is_a_tenth_of_a_full_one_and_keeps_what_rules_look_at(traced, tmp_path) -> None:
    for kind in ("full", "compact"):
        trace.write(traced, trace.Header("residual", "hard", 0, kind), tmp_path / kind)
    assert (tmp_path / "compact").stat().st_size < 0.12 * (tmp_path / "full").stat().st_size
    _, episodes = trace.read(tmp_path / "compact", "compact")
    for name in trace.COMPACT:
        np.testing.assert_array_equal(getattr(episodes, name), getattr(traced, name))
    for rule in fall_rules.RULES.values():
        np.testing.assert_array_equal(fall_rules.fall_step(rule, episodes), fall_rules.fall_step(rule, traced))
    with pytest.raises(ValueError, match="compact"):
        trace.read(tmp_path / "compact")


def test_a_policy_without_a_clock_and_a_scenario_without_pushes_can_be_traced(tmp_path) -> None:
    episodes = rollout.run(policies.make("stand"), "flat", evaluation_seeds(0, 2), steps=20, after_falls=True)
    trace.write(episodes, trace.Header("stand", "flat", 0, "full"), tmp_path / "trace")
    assert_same(trace.read(tmp_path / "trace")[1], episodes)


def test_what_is_no_trace_and_episodes_that_stopped_at_their_falls_are_refused(run, tmp_path) -> None:
    with pytest.raises(ValueError, match="after_falls"):
        trace.write(uneventful(SIMPLE_QUAD, 10), trace.Header("stand", "flat", 0, "full"), tmp_path / "trace")
    with pytest.raises(ValueError, match="no trace"):
        trace.read(run.folder / "episodes.parquet")


def test_a_cell_is_traced_part_by_part_under_names_that_no_two_cells_share(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(
        "evaluate.rollouts.rollout.run", lambda *args, **kwargs: short(*args, **{**kwargs, "steps": 120})
    )
    labelled = [LabelledPolicy(label, policies.make("stand")) for label in ("runs/a", "runs%2Fa")]
    write, seeds = trace.writer(tmp_path, "compact"), evaluation_seeds(0, 3)
    for policy in labelled:
        run_cell(policy, quad_env.SCENARIOS["flat"], seeds, Settings(1, lambda *_: None, chunk_size=2, trace=write))
    read = [trace.read(path, "compact") for path in sorted(tmp_path.iterdir())]
    assert sorted((header.policy, header.first, len(episodes.seeds)) for header, episodes in read) == [
        (label, first, count) for label in ("runs%2Fa", "runs/a") for first, count in ((0, 2), (2, 1))
    ]


short = rollout.run
