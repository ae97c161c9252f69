"""`python -m benchmarks.evaluation`: an evaluation against bare physics of the same robots and the policies' own time.

The evaluation simulates several policies in one batch, and measures their episodes. Its processor time is divided into
parts, and is compared with `Batch.step` alone plus the time of the policies, in the ideal world and with the hardware
profile. All run on one thread.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.support.bars import RequirementCheck, check_requirement
from benchmarks.support.command import BenchmarkResult, MeasurementOptions, format_quartiles, make_command, make_table
from benchmarks.support.evaluation_parts import PARTS, BareControlSteps, TimedEvaluation
from benchmarks.support.measure import Floats, compute_quartiles, interleave
from quad_env import MAX_EPISODE_STEPS, SCENARIOS
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.launcher import launch
from quad_env.robots.simple_quad import SIMPLE_QUAD

BARE_PHYSICS = "bare physics"
"""Name of the bare physics among the measured durations."""
MIN_STEPS = 150
"""Smallest number of control steps of an episode; the measures begin after 1 s."""
PROFILES = {"ideal": False, "hardware": True}
"""Name of a world -> True if the robots have realistic motors, sensors and state estimator."""


@dataclass(frozen=True)
class EvaluationBenchmarkOptions(MeasurementOptions):
    """Options of the timing of an evaluation; a round is one evaluation of each scenario in each world."""

    robot: str = SIMPLE_QUAD.name
    """Name of the robot, or path of its MJCF, URDF or TOML file."""
    policies: tuple[str, ...] = ("stand", "trot", "trot_integral")
    """Names of the policies; all run in one batch of robots."""
    scenarios: tuple[str, ...] = ("flat", "rough", "push")
    """Names of the scenarios."""
    episodes: int = 64
    """Number of episodes of each policy on each scenario."""
    steps: int = 200
    """Number of control steps of an episode."""
    rounds: int = 5
    """Number of measurement rounds; results are medians over the rounds, with quartiles in brackets."""


def measure(options: EvaluationBenchmarkOptions) -> BenchmarkResult:
    """Time evaluations and bare physics of the same robots, which take turns.

    Args:
        options: Options of the command.

    Returns:
        Speed ratios and parts of the time in each world. The result also has the checks of the requirements
        `evaluation` and `evaluation hardware`.

    Raises:
        UsageError: A scenario is unknown.
    """
    if options.quick:
        options = replace(options, rounds=1, policies=("stand", "trot"), scenarios=("flat",))
        options = replace(options, episodes=2, steps=MIN_STEPS)
    check_numbers(options, {"episodes": (1, 10_000), "steps": (MIN_STEPS, MAX_EPISODE_STEPS)})
    if unknown := set(options.scenarios) - set(SCENARIOS):
        raise UsageError(f"--scenarios: unknown {', '.join(sorted(unknown))}; valid: {', '.join(SCENARIOS)}")
    worlds = {world: _time_world(options, profile) for world, profile in PROFILES.items()}
    figures = {world: _figures(seconds) for world, seconds in worlds.items()}
    checks: tuple[RequirementCheck, ...] = (
        check_requirement("evaluation", figures["ideal"]["ratio"].median),
        check_requirement("evaluation hardware", figures["hardware"]["ratio"].median),
    )
    return BenchmarkResult(figures, (_table(worlds, figures, options),), checks)


def _time_world(options: EvaluationBenchmarkOptions, on_hardware_profile: bool) -> dict[str, Floats]:
    """Time the evaluations of all scenarios in one world.

    Args:
        options: Options of the command.
        on_hardware_profile: True for the realistic motors, sensors and estimator of the robot.

    Returns:
        Name of one of the `PARTS`, or `BARE_PHYSICS` -> processor time per control step of a robot in each round,
        (rounds,), s.
    """
    rounds: dict[str, list[Floats]] = {name: [] for name in (*PARTS, BARE_PHYSICS)}
    robot_steps = 0
    for scenario in options.scenarios:
        evaluation = TimedEvaluation(
            options.policies,
            scenario,
            on_hardware_profile=on_hardware_profile,
            episodes=options.episodes,
            steps=options.steps,
            robot=options.robot,
        )
        seconds = _time_scenario(evaluation, options.rounds)
        robot_steps += evaluation.robot_steps
        for name, values in seconds.items():
            rounds[name].append(values)
    return {name: np.sum(values, axis=0) / robot_steps for name, values in rounds.items()}


def _time_scenario(evaluation: TimedEvaluation, rounds: int) -> dict[str, Floats]:
    """Time an evaluation by parts, and its bare physics, in turns.

    Args:
        evaluation: Evaluation of one scenario.
        rounds: Number of times that each of the two runs is timed.

    Returns:
        Name of one of the `PARTS`, or `BARE_PHYSICS` -> processor time in each round, (rounds,), s.
    """
    evaluation.run()
    bare = BareControlSteps(evaluation)
    parts: list[dict[str, float]] = []

    def evaluate() -> float:
        parts.append(evaluation.run())
        return sum(parts[-1].values())

    seconds = interleave({"evaluation": evaluate, BARE_PHYSICS: bare.run}, rounds, evaluation.scenario.name)
    timed = parts[-rounds:]
    return {part: np.array([each[part] for each in timed]) for part in PARTS} | {BARE_PHYSICS: seconds[BARE_PHYSICS]}


def _figures(seconds: Mapping[str, Floats]) -> dict[str, Any]:
    """Compute the results of one world from the durations of `_time_world`.

    Args:
        seconds: Name of one of the `PARTS`, or `BARE_PHYSICS` -> processor time of a control step of a robot in each
            round, (rounds,), s.

    Returns:
        Quartiles: `ratio`, speed of the evaluation divided by the speed of bare physics and policies; `us`, total
        processor time per control step of a robot, µs.
    """
    total = np.sum([seconds[part] for part in PARTS], axis=0)
    return {
        "ratio": compute_quartiles((seconds[BARE_PHYSICS] + seconds["policies"]) / total),
        "us": compute_quartiles(1e6 * total),
    }


def _table(
    worlds: Mapping[str, Mapping[str, Floats]], figures: Mapping[str, Any], options: EvaluationBenchmarkOptions
) -> Table:
    """Create the table of the parts of an evaluation in all worlds; see `measure`."""
    robots = len(options.policies) * options.episodes
    rows = make_table(f"Evaluation of {robots} robots in a batch, µs a control step of a robot", "part", *worlds)
    for part in (*PARTS, BARE_PHYSICS):
        rows.add_row(part, *(format_quartiles(compute_quartiles(1e6 * each[part]), 1) for each in worlds.values()))
    rows.add_row("total", *(format_quartiles(each["us"], 1) for each in figures.values()))
    rows.add_row("(bare physics + policies) / total", *(format_quartiles(each["ratio"]) for each in figures.values()))
    return rows


main = make_command(EvaluationBenchmarkOptions, measure, "benchmarks.evaluation", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
