"""All results of an evaluation run, and the file results.json that stores them."""

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
from evaluate.analysis.summary import Summary, summarise
from evaluate.cells import PolicyScenarioResult
from evaluate.hardware import HardwareConfig
from evaluate.records.provenance import versions
from quad_env.files.writing import write_atomically
from quad_env.robots.robot import Robot

SCHEMA = 1
"""Version of the format of results.json."""


@dataclass(frozen=True)
class PolicyErrors:
    """Number of episodes in which a policy failed to return an action, made by `Results.policy_errors`.

    An episode counts if the policy raised an exception, exceeded its time limit, or returned an action that is not
    finite.
    """

    policy: str
    """Name of the policy."""
    failed: int
    """Number of episodes in which the policy failed to return an action."""
    episodes: int
    """Number of all episodes of the policy in the run."""
    first: str
    """Error of the first of these episodes as one line of text, for example `raised ValueError: …`."""


@dataclass(frozen=True)
class Results:
    """All results of a run, made by `analyse`: the content of tables, results.json and the HTML report."""

    seed: int
    """Evaluation seed of the run, from which the seeds of all episodes are derived."""
    episodes: int
    """Number of episodes of each policy on each scenario."""
    complete: bool
    """False if the run was interrupted.

    Some pairs of policy and scenario then have no result; every other pair has all of its episodes.
    """
    cells: tuple[PolicyScenarioResult, ...]
    """Measured episodes, one result for each pair of policy and scenario, in the order of the run."""
    baseline: str
    """Name of the policy that the others are compared with."""
    ranking: Ranking
    """Ranking of the policies by their score on scenarios without the hardware profile.

    If the run has only scenarios with the hardware profile, their score is used.
    """
    summaries: dict[tuple[str, str], Summary]
    """(scenario name, policy name) -> rates and means over the episodes, in the order of the run."""
    comparisons: tuple[Comparison, ...]
    """Comparisons of each policy with the baseline and of adjacent policies, with corrected p-values."""
    breaking_points: tuple[AxisBreakingPoint, ...]
    """Breaking points of the policies on every disturbance axis with at least three severities."""
    scores: tuple[Score, ...]
    """Scores on scenarios without the hardware profile, the highest first."""
    hardware_scores: tuple[Score, ...]
    """Scores on scenarios with the hardware profile (models of the real robot's parts), the highest first."""
    pareto: Pareto
    """Success against cost of transport on scenarios without the hardware profile."""
    hardware_pareto: Pareto
    """Success against cost of transport on scenarios with the hardware profile."""
    versions: Mapping[str, str | None]
    """Name of a package, or the key `success_rule` -> version with which the run was made."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Other facts about the origin of the results: name -> JSON value.

    Examples are the processor, the number of threads, and hashes of policies and code.
    """

    @property
    def hardware(self) -> HardwareConfig:
        """Hardware models of the robots in the run; ideal hardware if the provenance does not name any."""
        return _hardware(self.provenance)

    @property
    def policy_errors(self) -> list[PolicyErrors]:
        """Count of failed actions for each policy that had any, in the order of the run."""
        errors = []
        for policy in self.policies:
            reasons = np.concatenate([cell.failure for cell in self.cells if cell.policy == policy])
            failures = [reason for reason in reasons if reason is not None]
            if failures:
                errors.append(PolicyErrors(policy, len(failures), len(reasons), " ".join(failures[0].split())))
        return errors

    @property
    def policies(self) -> tuple[str, ...]:
        """Names of the policies, in the order of the run."""
        return tuple(dict.fromkeys(cell.policy for cell in self.cells))

    @property
    def scenarios(self) -> tuple[str, ...]:
        """Names of the scenarios, in the order of the run."""
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
    """Compute all results of a run from its measured episodes.

    Args:
        cells: Measured episodes, one result for each pair of policy and scenario.
        seed: Evaluation seed of the run.
        episodes: Number of episodes of each policy on each scenario.
        complete: True if the run was not interrupted.
        provenance: Origin of the results, as in the manifest; None for the package versions of this installation.
        baseline: Name of the policy that the others are compared with; None for `default_baseline`.

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
    ranked, comparisons = correct_p_values(ranked, comparisons, origin.get("limit", 0))
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
        versions=run_versions,
        provenance=origin,
    )


def _scores_and_front(
    cells: Sequence[PolicyScenarioResult], baseline: str, robot: Robot, *, hardware: bool
) -> tuple[tuple[Score, ...], Pareto]:
    """Compute the scores and the Pareto front of the policies in one group of scenarios.

    Args:
        cells: Measured episodes, one result for each pair of policy and scenario.
        baseline: Name of the policy that the others are compared with.
        robot: Robot of the run, for its weight.
        hardware: True for scenarios with the hardware profile, False for scenarios without it.

    Returns:
        Scores, the highest first, and the Pareto front.
    """
    scores = compute_scores(cells, baseline, hardware=hardware)
    return tuple(scores), compute_pareto([cell for cell in cells if cell.scenario.hardware == hardware], scores, robot)


def _hardware(provenance: Mapping[str, Any]) -> HardwareConfig:
    """Return the hardware models that a run's provenance names; ideal hardware if it names none."""
    return HardwareConfig(**provenance.get("hardware", {}))


def results_to_json(results: Results) -> dict[str, Any]:
    """Convert the results to the JSON content of results.json; numbers that are not finite become null."""
    policies: dict[str, Any] = {policy: {"scenarios": {}} for policy in results.policies}
    for (scenario, policy), summary in results.summaries.items():
        policies[policy]["scenarios"][scenario] = asdict(summary)
    plain = {name: getattr(results, name) for name in ("seed", "episodes", "complete", "baseline")}
    contents = {"schema": SCHEMA, **plain, "versions": dict(results.versions)}
    contents["provenance"] = {name: value for name, value in results.provenance.items() if name not in plain}
    for name in ("ranking", "policy_errors", "scores", "hardware_scores", "pareto", "hardware_pareto"):
        value = getattr(results, name)
        contents[name] = [asdict(entry) for entry in value] if isinstance(value, list | tuple) else asdict(value)
    contents["policies"] = policies
    for name in ("comparisons", "breaking_points"):
        contents[name] = [asdict(entry) for entry in getattr(results, name)]
    return dict(nan_to_null(contents))


def write_json(results: Results, path: Path) -> None:
    """Write the `results` to the file `path` in the format of results.json."""
    write_atomically(path, (json.dumps(results_to_json(results), indent=2, allow_nan=False) + "\n").encode())


def nan_to_null(value: Any) -> Any:
    """Replace every number that is not finite by None, in nested dictionaries, lists and tuples."""
    if isinstance(value, dict):
        return {key: nan_to_null(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [nan_to_null(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def null_to_nan(value: Any) -> Any:
    """Replace every None by NaN, in nested dictionaries and lists; the inverse of `nan_to_null`."""
    if isinstance(value, dict):
        return {key: null_to_nan(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [null_to_nan(entry) for entry in value]
    return math.nan if value is None else value
