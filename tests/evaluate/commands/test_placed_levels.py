"""Levels placed one after the other: each policy its own, the same after an interrupt as in one go."""

import json

import numpy as np
import pytest

from evaluate.__main__ import main
from evaluate.analysis.breaking_points import NEAREST, breaking_points, grid, wanted
from evaluate.records.store import read_run
from evaluate.rollouts import experiment
from quad_env.scenarios.axes import AXES, axes_of
from tests.quad_env.robots.alike import alike

PUSH = AXES["push"]
EPISODES = 40
BREAKS_AT = {"stand": 57.0, "trot": 120.0}


@pytest.fixture
def simulated(monkeypatch, made_up_cell) -> list[tuple[str, float]]:
    """Instead of simulating: episodes that fall at a strength of their own; policy and severity of each cell."""
    seen: list[tuple[str, float]] = []

    def simulate(task, nthread, progress):
        label, severity = task.policy.label, task.scenario.severity
        seen.append((label, severity))
        luck = np.array([np.random.default_rng(int(seed)).logistic(0.0, 0.1) for seed in task.seeds])
        cell = made_up_cell(label, severity > BREAKS_AT[label] * np.exp(luck), scenario=task.scenario)
        return experiment.Chunk(task.numbers, replace_seeds(cell, task.seeds))

    monkeypatch.setattr(experiment, "simulate", simulate)
    monkeypatch.setattr("evaluate.commands.execution.process_pool", lambda *_: None)
    monkeypatch.setattr(
        "evaluate.commands.outputs.write_report",
        lambda _, path, **_options: path.write_text("report", encoding="utf-8"),
    )
    return seen


def replace_seeds(cell, seeds):
    import dataclasses

    filled = {
        "fall_time": np.where(cell.measures.fell, 5.0, np.nan),
        "duty_factor": np.full((len(seeds), 4), np.nan),
        "push_impulse": np.empty((len(seeds), 0, 2)),
        **dict.fromkeys(("push_time", "push_phase", "push_fell", "push_recovery"), np.empty((len(seeds), 0))),
    }
    return dataclasses.replace(cell, seeds=seeds, measures=dataclasses.replace(cell.measures, **filled))


def words(out, *more: str) -> list[str]:
    policies = ["--policies", *BREAKS_AT, "--episodes", str(EPISODES)]
    return ["axes", "push", "--sequential", *policies, "--out", str(out), *more]


def test_every_severity_between_two_levels_may_be_run_down_to_5_percent() -> None:
    severities = grid(PUSH)
    assert set(PUSH.levels) <= set(severities)
    assert list(severities) == sorted(severities)
    ratios = np.array(severities[1:]) / severities[:-1]
    assert ratios.max() < 1.01 * NEAREST  # three digits
    assert list(grid(AXES["slippery"])) == sorted(grid(AXES["slippery"]), reverse=True)


def test_each_policy_runs_levels_where_it_breaks(simulated, tmp_path, capsys) -> None:
    assert main(words(tmp_path)) == 0
    run = read_run(tmp_path)
    assert run.complete
    assert len(set(simulated)) == len(run.cells)
    own = {policy: {at for label, at in simulated if label == policy} - set(PUSH.levels) for policy in BREAKS_AT}
    assert all(50.0 < at < 65.0 for at in own["stand"])
    assert all(100.0 < at < 140.0 for at in own["trot"])
    assert min(map(len, own.values())) >= 3
    for point in breaking_points(run.cells)[0]:
        low, high = point.ci
        assert low <= BREAKS_AT[point.policy] <= high
        assert high / low < 1.25
    printed = capsys.readouterr().out.replace("\u00a0", " ")
    assert "half of the episodes no longer" in printed
    options = json.loads((tmp_path / "manifest.json").read_text(encoding="utf-8"))["options"]
    assert {"push:1", "push:8"} < set(options["scenarios"])
    assert options["policies"][0].startswith("stand@push:1,")


def test_a_stopped_run_goes_on_to_the_same_files(simulated, tmp_path, monkeypatch, capsys) -> None:
    assert main(words(tmp_path / "whole")) == 0
    whole = list(simulated)
    simulated.clear()
    simulate = experiment.simulate

    def stopped(task, nthread, progress):
        if len(simulated) == len(whole) - 3:
            raise KeyboardInterrupt
        return simulate(task, nthread, progress)

    with monkeypatch.context() as patch:
        patch.setattr(experiment, "simulate", stopped)
        assert main(words(tmp_path / "stopped")) == 130
    assert "python -m evaluate axes push --sequential" in capsys.readouterr().err
    assert main(words(tmp_path / "stopped", "--resume")) == 0
    assert simulated == whole
    names = ("results.json", "episodes.parquet")
    for name in names:
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "stopped" / name).read_bytes()
    assert main(words(tmp_path / "stopped", "--resume")) == 0
    assert simulated == whole
    assert "nothing is left to simulate" in capsys.readouterr().err


def test_a_budget_ends_it(simulated, tmp_path) -> None:
    assert main(words(tmp_path, "--budget", str(10 * EPISODES))) == 0
    assert [len({at for label, at in simulated if label == policy}) for policy in BREAKS_AT] == [10, 10]


def test_nothing_is_wanted_of_a_policy_that_never_breaks(made_up_cell) -> None:
    cells = [made_up_cell("trot", np.zeros(20, bool), scenario=PUSH.level(k + 1)) for k in range(len(PUSH.levels))]
    assert wanted(cells, grid(PUSH), most=99) == []


def test_another_robots_levels_are_its_own(simulated, tmp_path, monkeypatch) -> None:
    robot = alike(tmp_path)
    small = axes_of(robot)["push"].levels
    monkeypatch.setitem(BREAKS_AT, "stand", 57.0 * small[0] / PUSH.levels[0])
    monkeypatch.setitem(BREAKS_AT, "trot", 120.0 * small[0] / PUSH.levels[0])
    assert main(words(tmp_path / "out", "--budget", "480", "--robot", str(robot.source))) == 0
    severities = {severity for _, severity in simulated}
    assert set(small) < severities
    assert max(severities) == small[-1]
    assert read_run(tmp_path / "out").manifest.hardware.robot == str(robot.source)
