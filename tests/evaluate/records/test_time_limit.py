"""A run with a time limit ends at it after whole rounds, and its episodes are those of a run of as many."""

import json
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from evaluate.analysis.stored_run import analyse_run
from evaluate.commands.interim_analysis import EarlyRanking, after_round
from evaluate.commands.options import DEFAULT_BATTERY, EvaluateOptions, command, options_from_json
from evaluate.commands.plan import check
from evaluate.records import manifest
from evaluate.records.store import read_run
from evaluate.report.page import list_warnings
from evaluate.rollouts.time_limit import FIRST_ROUND, ROUND_OVERHEAD, RoundPlanner
from tests.evaluate.timed_run import EPISODE_TIME, SimulatedClock, episodes_by_cell, evaluate, run_for
from tests.seams import replace_simulation

RUN = ("--policies", "stand", "crouch", "--scenarios", "flat", "push:3", "--seed", "2")
CELLS = 4
MINUTES = 0.4
"""Time for 24 episodes, min: two of each cell in the first round, and a second round of four."""


@pytest.fixture(scope="module")
def timed(tmp_path_factory) -> tuple[Path, SimulatedClock, str]:
    """Return the folder of a run that its time limit ended, its clock, and its text."""
    folder = tmp_path_factory.mktemp("timed")
    clock, said = run_for(MINUTES, folder, *RUN)
    return folder, clock, said


def test_it_ends_at_its_limit_after_whole_rounds_with_equal_episodes_of_every_policy(timed) -> None:
    folder, clock, said = timed
    assert set(episodes_by_cell(folder).values()) == {6}
    assert len(episodes_by_cell(folder)) == CELLS
    assert clock.now == 6 * CELLS * EPISODE_TIME <= 60.0 * MINUTES
    assert "6 of at most 48 episodes, 0 of 1 neighbours distinguished" in said
    stored = manifest.read(folder)
    assert (stored.episodes, stored.limit, stored.minutes, stored.out_of_time) == (6, 48, MINUTES, True)
    assert stored.ended == "the time limit of 0.4 min was reached"


def test_the_ranking_so_far_comes_before_the_other_scenarios(tmp_path, monkeypatch) -> None:
    clock = SimulatedClock()
    clock.install(monkeypatch)
    code, said = evaluate(*RUN, "--minutes", MINUTES, "--threads", 1, "--out", tmp_path)
    assert code == 0, said
    lines = said.splitlines()
    first = next(index for index, line in enumerate(lines) if line.startswith("so far, 2 episodes on 1 scenario: "))
    assert not any("push:3" in line for line in lines[:first])


def test_its_episodes_are_those_of_a_run_of_as_many(timed, tmp_path) -> None:
    assert evaluate(*RUN, "--episodes", 6, "--threads", 1, "--out", tmp_path)[0] == 0
    mine, other = (pq.read_table(folder / "episodes.parquet") for folder in (timed[0], tmp_path))
    assert mine.equals(other)


def test_its_results_say_what_ended_it_and_how_to_have_the_same_episodes(timed) -> None:
    found = json.loads((timed[0] / "results.json").read_text(encoding="utf-8"))
    assert (found["complete"], found["episodes"], found["provenance"]["out_of_time"]) == (True, 6, True)
    (line,) = list_warnings(analyse_run(read_run(timed[0])))
    assert "This run ended after 6 of at most 48 episodes: the time limit of 0.4 min was reached" in line
    assert "--episodes 6 in place of --minutes simulates the same episodes" in line


def test_a_finished_one_is_finished(timed, tmp_path) -> None:
    shutil.copytree(timed[0], tmp_path, dirs_exist_ok=True)
    code, said = evaluate("--resume", "--out", tmp_path)
    assert (code, "nothing is left" in said) == (0, True)


def test_an_interrupted_one_goes_on_with_a_new_time_limit_in_whole_rounds(timed, tmp_path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        clock = SimulatedClock()
        clock.install(patch)
        from evaluate.rollouts import rollout

        simulate = rollout.run_scenarios

        def interrupted(policy, batches, **settings):
            if clock.now >= FIRST_ROUND * CELLS * EPISODE_TIME:
                raise KeyboardInterrupt
            return simulate(policy, batches, **settings)

        replace_simulation(patch, interrupted)
        code, said = evaluate(*RUN, "--minutes", MINUTES, "--threads", 1, "--out", tmp_path)
    assert code == 130, said
    run = read_run(tmp_path)
    assert (run.complete, run.manifest.episodes, len(run.cells)) == (False, FIRST_ROUND, CELLS)
    with pytest.MonkeyPatch.context() as patch:
        SimulatedClock().install(patch)
        code, said = evaluate("--resume", "--threads", 1, "--out", tmp_path)
    assert code == 0, said
    assert len(set(episodes_by_cell(tmp_path).values())) == 1
    assert read_run(tmp_path).manifest.episodes > FIRST_ROUND


def test_a_policy_is_added_with_as_many_episodes(timed, tmp_path) -> None:
    folder = shutil.copytree(timed[0], tmp_path / "run")
    code, said = evaluate("--add", "walk", "--threads", 1, "--out", folder)
    assert code == 0, said
    assert "24 episodes are kept, 12 are simulated" in said
    assert set(episodes_by_cell(folder).values()) == {6}
    assert {policy for policy, _ in episodes_by_cell(folder)} == {"stand", "crouch", "walk"}


def test_more_episodes_need_a_new_run(timed, tmp_path) -> None:
    folder = shutil.copytree(timed[0], tmp_path / "run")
    code, said = evaluate("--episodes", 50, "--out", folder)
    assert code == 2
    assert f"--episodes: {folder} is a run with a time limit, which has 6, got 50; valid: a new run" in said


def test_a_round_starts_only_if_it_ends_within_the_limit() -> None:
    clock = SimulatedClock()
    planner = RoundPlanner(1.0, clock)
    clock.now = 20.0
    planner.finish_round(2)
    fits = planner.episodes_that_fit()
    episode_time = 20.0 / (2 + ROUND_OVERHEAD)
    assert (fits + ROUND_OVERHEAD) * episode_time <= 40.0 < (fits + 2 + ROUND_OVERHEAD) * episode_time
    clock.now = 59.0
    assert planner.episodes_that_fit() == 0


def test_a_policy_alone_runs_until_the_time_is_over(tmp_path) -> None:
    _, said = run_for(MINUTES, tmp_path, "--policies", "stand", "--scenarios", "flat")
    assert set(episodes_by_cell(tmp_path).values()) == {manifest.read(tmp_path).episodes}
    assert "episodes of each policy on each scenario" in said


def test_the_run_without_options_is_the_quick_battery_for_three_minutes(tmp_path) -> None:
    plain = EvaluateOptions()
    assert (plain.battery, plain.time_limit, plain.max_episodes) == (DEFAULT_BATTERY, 3.0, 48)
    assert command(plain.run_options()) == command(EvaluateOptions().run_options()) == "python -m evaluate"
    assert EvaluateOptions(quick=True).time_limit == plain.time_limit
    assert check(EvaluateOptions(out=tmp_path)).manifest.minutes == 3.0


@pytest.mark.parametrize(
    ("options", "words", "minutes", "episodes"),
    [
        (EvaluateOptions(full=True), "--full", 0.0, 24),
        (EvaluateOptions(full=True, episodes=12), "--full --episodes 12", 0.0, 12),
        (EvaluateOptions(episodes=7), "--episodes 7", 0.0, 7),
        (EvaluateOptions(scenarios=("push",)), "--scenarios push", 0.0, 20),
        (EvaluateOptions(scenarios=("push",), minutes=1.0), "--scenarios push --episodes 48 --minutes 1.0", 1.0, 48),
        (EvaluateOptions(part="1/2"), "--part 1/2", 0.0, 20),
    ],
)
def test_other_options_have_a_fixed_number_of_episodes_unless_they_name_minutes(
    options, words, minutes, episodes
) -> None:
    assert (options.time_limit, options.max_episodes) == (minutes, episodes)
    stored = options.run_options()
    assert command(stored) == f"python -m evaluate {words}"
    assert EvaluateOptions(**options_from_json(stored)).run_options() == stored


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("--minutes 0", "--minutes must be from 0.1 to 10080, not 0.0"),
        ("--minutes 1 --part 1/2", "--part and --minutes: each part needs a fixed number of episodes"),
        ("--quick --full", "--quick and --full both name the scenarios"),
        ("--full --scenarios push", "--full and --scenarios both name the scenarios"),
    ],
)
def test_contradictions_are_one_line(tmp_path, no_simulation, words, complaint) -> None:
    code, said = evaluate(*words.split(), "--out", tmp_path)
    assert (code, said.count("\n"), complaint in said) == (2, 1, True), said


def test_lines_of_the_early_ranking_have_whole_scenarios_and_a_pause(timed) -> None:
    run = read_run(timed[0])
    clock = SimulatedClock()
    plan = check(EvaluateOptions(("stand", "crouch"), scenarios=("flat", "push:3"), out=timed[0].parent / "other"))
    early = EarlyRanking(plan.policies, clock)
    assert [bool(early.add(cell)) for cell in run.cells] == [False, True, False, False]
    clock.now = 100.0
    assert "on 2 scenarios" in early.add(run.cells[-1])


def test_the_last_round_tests_neighbours_and_a_round_before_does_not(timed) -> None:
    cells = read_run(timed[0]).cells
    line, ended = after_round(cells, 48, MINUTES, out_of_time=False)
    assert (line.startswith("so far, 6 episodes on 2 scenarios: "), ended) == (True, "")
    line, ended = after_round(cells, 48, MINUTES, out_of_time=True)
    assert ("neighbours" in line, ended) == (True, "the time limit of 0.4 min was reached")
