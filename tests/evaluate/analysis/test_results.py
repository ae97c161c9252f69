"""The files results.json and episodes.parquet keep the documented format."""

import json
import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pyarrow.parquet as pq
import pytest

import policies
import quad_env
from evaluate.analysis.results import analyse
from evaluate.cells import evaluation_seeds
from evaluate.rollouts.battery import resolve
from quad_env.robots.robot import Robot
from tests.quad_env.robots.made import Made

CELL_NUMBERS = (
    "fall_rate",
    "velocity_error",
    "velocity_error_upright",
    "yaw_rate_error",
    "mean_velocity_error",
    "cost_of_transport",
    "time_to_fall",
)
INTERVALS = ("fall_rate_ci", "velocity_error_ci", "yaw_rate_error_ci", "mean_velocity_error_ci")


def no_constant(name: str) -> float:
    raise AssertionError(f"{name} is not JSON")


@pytest.fixture(scope="session")
def rows(run):
    return pq.read_table(run.folder / "episodes.parquet").to_pylist()


def cell_rows(rows, policy, scenario):
    return [row for row in rows if (row["policy"], row["scenario"]) == (policy, scenario)]


def test_results_json_has_the_contracts_shape(run) -> None:
    results = json.loads((run.folder / "results.json").read_text(encoding="utf-8"), parse_constant=no_constant)
    assert results["schema"] == 1
    assert results["seed"] == 3
    assert results["episodes"] == 5
    assert results["complete"] is True
    assert set(results["policies"]) == {"document", "stand", "trot"}
    for policy in results["policies"].values():
        assert set(policy["scenarios"]) == {"flat", "push"}
        for cell in policy["scenarios"].values():
            assert cell["episodes"] == 5
            assert cell["fall_rate"] == cell["falls"] / 5
            assert all(cell[name] is None or math.isfinite(cell[name]) for name in CELL_NUMBERS)
            for name in INTERVALS:
                low, high = cell[name]
                assert low <= cell[name.removesuffix("_ci")] <= high


def test_neighbours_and_pairs_with_the_baseline_are_compared_in_every_metric(run) -> None:
    comparisons = run.results["comparisons"]
    keys = {(c["scenario"], c["a"], c["b"], c["metric"]) for c in comparisons}
    assert len(keys) == len(comparisons) == 2 * 3 * 5
    assert {(a, b) for _, a, b, _ in keys} == {("document", "trot"), ("stand", "trot"), ("stand", "document")}
    for c in comparisons:
        assert 0.0 < c["p_value"] <= 1.0
        a, b = (run.results["policies"][c[side]]["scenarios"][c["scenario"]][c["metric"]] for side in "ab")
        assert c["difference"] == pytest.approx(a - b)
        assert c["ci"][0] <= c["difference"] <= c["ci"][1]
        assert c["test"] == (
            "exact McNemar" if c["metric"] in ("success_rate", "fall_rate") else "paired sign-flip permutation"
        )


def test_all_is_measured_against_the_baseline_that_is_asked_for(made) -> None:
    results = analyse(made.cells, seed=0, episodes=40, complete=True, baseline="other")
    assert {each.b for each in results.comparisons} == {"other"}
    assert [each.policy for each in results.scores if each.difference == 0.0] == ["other"]
    (falls,) = (each for each in results.comparisons if (each.scenario, each.metric) == ("rough", "fall_rate"))
    assert (falls.a, falls.difference) == ("trot", -0.5)  # falls of 2 and 22 of 40 episodes


def test_summaries_are_those_of_the_robot_that_ran(made_up_cell, tmp_path) -> None:
    path = Made().write(tmp_path)
    robot, cells = Robot.from_mjcf(path), []
    more = {"energy": np.full(8, 100.0), "distance": np.full(8, 2.0)}
    more["commands"] = np.linspace(0.1, 0.8, 8)[:, None, None] * np.ones(3)
    more["mean_velocities"] = 0.5 * more["commands"]
    for scenario in resolve(("flat", "push"), robot):
        cell = made_up_cell("trot", np.zeros(8, bool), scenario=scenario)
        cells.append(replace(cell, measures=replace(cell.measures, **more)))
    provenance = {"hardware": {"robot": str(path)}, "versions": {}}
    found = analyse(cells, seed=0, episodes=8, complete=True, provenance=provenance)
    summary = found.summaries["flat", "trot"]
    assert summary.cost_of_transport == pytest.approx(100.0 / (robot.mass * 9.81 * 2.0))


def test_a_policy_that_always_falls_is_billed_the_caps(run) -> None:
    for cell in run.results["policies"]["document"]["scenarios"].values():
        assert cell["falls"] == 5
        assert cell["velocity_error"] == pytest.approx(2.0)
        assert cell["yaw_rate_error"] == pytest.approx(3.0)
        assert cell["mean_velocity_error"] == pytest.approx(2.0)


def test_one_row_an_episode_however_short_it_was_and_rows_add_up_to_the_summaries(run, rows) -> None:
    assert len(rows) == 3 * 2 * 5
    expected = evaluation_seeds(3, 5).tolist()
    for policy, entry in run.results["policies"].items():
        for scenario, cell in entry["scenarios"].items():
            mine = cell_rows(rows, policy, scenario)
            for name, many in (("falls", "fell"), ("diverged", "diverged")):
                assert cell[name] == sum(row[many] for row in mine)
            for name in ("velocity_error", "yaw_rate_error", "mean_velocity_error"):
                assert cell[name] == pytest.approx(np.mean([row[name] for row in mine]))
            assert [row["seed"] for row in mine] == expected
            assert [row["episode"] for row in mine] == [0, 1, 2, 3, 4]
            assert {row["severity"] for row in mine} == {quad_env.SCENARIOS[scenario].severity}


def test_a_fall_has_its_reason_and_time_and_nothing_else_has(rows) -> None:
    assert any(row["fell"] for row in rows)
    for row in rows:
        assert (row["fall_reason"] is not None) == row["fell"] == (row["fall_time"] is not None)
        assert row["fall_reason"] in (None, "trunk_contact", "tilt", "height", "diverged")
        assert not row["fell"] or 0.0 < row["fall_time"] <= 10.0


@pytest.mark.parametrize("policy", ["trot", "stand"])
def test_a_rows_seed_gives_its_episode_again_in_a_single_environment(rows, policy) -> None:
    row = cell_rows(rows, policy, "push")[3]
    env, walker = gym.make("SimpleQuad-v0", scenario="push"), policies.make(policy)
    walker.reset()
    observation, _ = env.reset(seed=row["seed"])
    errors, ended = [], False
    while not ended:
        observation, _, fell, cut, info = env.step(walker.act(observation))
        ended = fell or cut
        errors.append(min(2.0, np.linalg.norm(info["command"][:2] - info["heading_velocity"][:2])))
    assert (fell, len(errors)) == (row["fell"], round(100 * row["fall_time"]) if row["fell"] else 1000)
    errors[len(errors) - fell :] = [2.0] * (1000 - len(errors) + fell)
    assert np.mean(errors[100:]) == pytest.approx(row["velocity_error"], rel=1e-5)


def test_progress_goes_to_stderr_a_line_a_cell(run) -> None:
    assert [line.split("]")[0] for line in run.stderr.splitlines()] == [f"[{k}/6" for k in range(1, 7)]
