"""All results of an evaluation, and their conversion to the file results.json."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from evaluate.analysis.breaking_points import AxisBreakingPoint, breaking_points
from evaluate.analysis.comparison import Comparison, compare, default_baseline
from evaluate.analysis.pareto import Pareto, compute_pareto
from evaluate.analysis.ranking import Ranking, correct_p_values, rank_policies
from evaluate.analysis.score import Score, compute_scores, select_scored_cells
from evaluate.analysis.seed_groups import SeedGroup, summarise_groups
from evaluate.analysis.summary import Summary, summarise
from evaluate.cells import PolicyScenarioResult
from evaluate.hardware import HardwareConfig
from evaluate.records.provenance import versions
from quad_env.files.writing import write_atomically
from quad_env.robots.robot import Robot

SCHEMA = 1
"""Version of the format of the file results.json, which is stored under the key `schema`."""


@dataclass(frozen=True)
class PolicyErrors:
    """Number of episodes in which one policy failed to return an action, with an example of its errors.

    A policy fails if it raises an exception, exceeds its time limit, or returns an action that is not finite. The field
    names are the keys in results.json.
    """

    policy: str
    """Name of the policy that failed to return an action."""
    failed: int
    """Number of episodes in which the policy failed to return a finite action in time."""
    episodes: int
    """Number of all episodes of the policy in the evaluation."""
    first: str
    """Error message of the policy in the first failed episode, as one line: `raised ValueError: …`."""


@dataclass(frozen=True)
class Results:
    """All results of an evaluation, made by `analyse`, for tables, results.json and the HTML report."""

    seed: int
    """Evaluation seed that the user chose, from which the seeds of all episodes are derived."""
    episodes: int
    """Number of episodes of each policy on each scenario."""
    complete: bool
    """True if every policy ran all of its episodes; False if the evaluation was interrupted.

    After an interruption, some policy-scenario pairs have no result. Every other pair has all of its episodes.
    """
    cells: tuple[PolicyScenarioResult, ...]
    """Measured episodes, one result for each policy-scenario pair, in the order of the evaluation."""
    baseline: str
    """Name of the policy that all other policies are compared with."""
    ranking: Ranking
    """Ranking of the policies by their score on the scenarios without the hardware profile.

    The hardware profile consists of models of the real robot's motors and sensors. If all scenarios have the hardware
    profile, the ranking uses their score.
    """
    summaries: dict[tuple[str, str], Summary]
    """(scenario name, policy name) -> rates and means over the episodes, in the order of the evaluation."""
    comparisons: tuple[Comparison, ...]
    """Comparisons of two policies on single scenarios, with corrected p-values.

    Each policy is compared with the baseline and with its neighbours in the ranking.
    """
    breaking_points: tuple[AxisBreakingPoint, ...]
    """Breaking points: the severity of each disturbance at which half of the episodes of a policy fail.

    They are computed for every kind of disturbance that was tested at three or more severities.
    """
    scores: tuple[Score, ...]
    """Scores (mean success) of the policies on scenarios without the hardware profile, the highest first.

    The hardware profile consists of models of the real robot's motors and sensors.
    """
    hardware_scores: tuple[Score, ...]
    """Scores (mean success) of the policies on the scenarios with the hardware profile, the highest first.

    The hardware profile consists of models of the real robot's motors and sensors.
    """
    pareto: Pareto
    """Success against cost of transport of the policies, on the scenarios without the hardware profile.

    The hardware profile consists of models of the real robot's motors and sensors.
    """
    hardware_pareto: Pareto
    """Success against cost of transport of the policies, on the scenarios with the hardware profile.

    The hardware profile consists of models of the real robot's motors and sensors.
    """
    groups: tuple[SeedGroup, ...]
    """Groups of policies that one algorithm has trained with several seeds, in the order of the evaluation."""
    versions: Mapping[str, str | None]
    """Name of a package, rule or library -> version with which the episodes were simulated.

    The version is None if it is not known.
    """
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Further facts about the origin of the results, as in manifest.json: name -> JSON value.

    Examples are the processor, the number of threads, and hashes of policies and code.
    """

    @property
    def hardware(self) -> HardwareConfig:
        """Names of robot, motors, sensors and simulator in the evaluation; the default if not recorded."""
        return _hardware(self.provenance)

    @property
    def policy_errors(self) -> list[PolicyErrors]:
        """Number of failed episodes and first error of each policy that failed to return an action.

        The policies are in the order of the evaluation.
        """
        errors = []
        for policy in self.policies:
            reasons = np.concatenate([cell.failure for cell in self.cells if cell.policy == policy])
            failures = [reason for reason in reasons if reason is not None]
            if failures:
                errors.append(PolicyErrors(policy, len(failures), len(reasons), " ".join(failures[0].split())))
        return errors

    @property
    def policies(self) -> tuple[str, ...]:
        """Names of all evaluated policies, in the order of the evaluation."""
        return tuple(dict.fromkeys(cell.policy for cell in self.cells))

    @property
    def scenarios(self) -> tuple[str, ...]:
        """Names of all scenarios with results, in the order of the evaluation."""
        return tuple(dict.fromkeys(cell.scenario.name for cell in self.cells))


def analyse(
    cells: Sequence[PolicyScenarioResult],
    *,
    seed: int,
    episodes: int,
    complete: bool,
    provenance: Mapping[str, Any] | None = None,
    baseline: str | None = None,
) -> Results:
    """Compute all results of an evaluation from its measured episodes.

    Args:
        cells: Measured episodes, one result for each policy-scenario pair.
        seed: Evaluation seed that the user chose.
        episodes: Number of episodes of each policy on each scenario.
        complete: True if the evaluation was not interrupted.
        provenance: Facts about the origin of the results, as in manifest.json: name -> JSON value. None for only the
            package versions of this installation.
        baseline: Name of the policy that all other policies are compared with; None for `default_baseline`.

    Returns:
        Summaries, comparisons, scores, ranking, Pareto fronts and breaking points.
    """
    origin = dict(provenance or {"versions": versions()})
    baseline = baseline or default_baseline([cell.policy for cell in cells])
    robot = _hardware(origin).robot_model
    run_versions = origin.pop("versions")
    scores, front = _scores_and_front(cells, baseline, robot, hardware=False)
    hardware_scores, hardware_front = _scores_and_front(cells, baseline, robot, hardware=True)
    places = front.points if scores else hardware_front.points
    ranked = rank_policies(select_scored_cells(cells, hardware=not scores), places, hardware=not scores)
    adjacent_pairs = {frozenset((pair.better, pair.worse)) for pair in ranked.neighbours}
    comparisons = compare(cells, baseline, adjacent_pairs)
    ranked, comparisons = correct_p_values(ranked, comparisons, origin.get("limit", 0), out_of_time=_is_stopped(origin))
    return Results(
        seed=seed,
        episodes=episodes,
        complete=complete,
        cells=tuple(cells),
        baseline=baseline,
        ranking=ranked,
        summaries={(cell.scenario.name, cell.policy): summarise(cell, robot) for cell in cells},
        comparisons=tuple(comparisons),
        breaking_points=tuple(breaking_points(cells)),
        scores=scores,
        hardware_scores=hardware_scores,
        pareto=front,
        hardware_pareto=hardware_front,
        groups=summarise_groups(cells, origin.get("groups", {}), robot),
        versions=run_versions,
        provenance=origin,
    )


def _is_stopped(provenance: Mapping[str, Any]) -> bool:
    """Return True if the time limit of an evaluation ended it, or if an evaluation with a time limit was interrupted.

    `provenance` is the origin of the results, as in manifest.json: name -> JSON value.
    """
    is_interrupted = provenance.get("minutes", 0.0) > 0.0 and not provenance.get("ended")
    return bool(provenance.get("out_of_time", False) or is_interrupted)


def _scores_and_front(
    cells: Sequence[PolicyScenarioResult], baseline: str, robot: Robot, *, hardware: bool
) -> tuple[tuple[Score, ...], Pareto]:
    """Compute scores and Pareto front on scenarios with the hardware profile, or on scenarios without it.

    The hardware profile consists of models of the real robot's motors and sensors.

    Args:
        cells: Measured episodes, one result for each policy-scenario pair.
        baseline: Name of the policy that all other policies are compared with.
        robot: Robot of the evaluation; its weight enters the cost of transport.
        hardware: True for the scenarios with the hardware profile, False for the scenarios without it.

    Returns:
        Scores of the policies, the highest first, and the Pareto front of success against cost of transport.
    """
    scores = compute_scores(cells, baseline, hardware=hardware)
    return tuple(scores), compute_pareto([cell for cell in cells if cell.scenario.hardware == hardware], scores, robot)


def _hardware(provenance: Mapping[str, Any]) -> HardwareConfig:
    """Return the hardware of the robots in an evaluation: names of robot, motors, sensors and simulator.

    Args:
        provenance: Facts about the origin of the results, as in manifest.json: name -> JSON value.

    Returns:
        The hardware; the default hardware if `provenance` has no key `hardware`.
    """
    return HardwareConfig(**provenance.get("hardware", {}))


def results_to_json(results: Results) -> dict[str, Any]:
    """Convert the `results` of an evaluation to the content of results.json: key -> JSON value.

    Numbers that are not finite become None, which is null in JSON.
    """
    policies: dict[str, Any] = {policy: {"scenarios": {}} for policy in results.policies}
    for (scenario, policy), summary in results.summaries.items():
        policies[policy]["scenarios"][scenario] = asdict(summary)
    plain = {name: getattr(results, name) for name in ("seed", "episodes", "complete", "baseline")}
    contents = {"schema": SCHEMA, **plain, "versions": dict(results.versions)}
    contents["provenance"] = {name: value for name, value in results.provenance.items() if name not in plain}
    for name in ("ranking", "policy_errors", "scores", "hardware_scores", "pareto", "hardware_pareto", "groups"):
        value = getattr(results, name)
        contents[name] = [asdict(entry) for entry in value] if isinstance(value, list | tuple) else asdict(value)
    contents["policies"] = policies
    for name in ("comparisons", "breaking_points"):
        contents[name] = [asdict(entry) for entry in getattr(results, name)]
    return dict(nan_to_null(contents))


def write_json(results: Results, path: Path) -> None:
    """Write the `results` of an evaluation to the file `path`, in the format of results.json."""
    write_atomically(path, (json.dumps(results_to_json(results), indent=2, allow_nan=False) + "\n").encode())


def nan_to_null(value: Any) -> Any:
    """Replace every number in `value` that is not finite by None.

    The reason is that JSON has neither NaN nor infinity. The value may contain nested dictionaries, lists and tuples. A
    tuple becomes a list.
    """
    if isinstance(value, dict):
        return {key: nan_to_null(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [nan_to_null(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def null_to_nan(value: Any) -> Any:
    """Replace every None in `value` by NaN, in nested dictionaries and lists, as read from results.json."""
    if isinstance(value, dict):
        return {key: null_to_nan(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [null_to_nan(entry) for entry in value]
    return math.nan if value is None else value
