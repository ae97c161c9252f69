"""What a comparison found, and its `results.json`."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from evaluate.analysis.breaking_points import AxisBreakingPoint, breaking_points
from evaluate.analysis.comparison import Comparison, compare, default_baseline
from evaluate.analysis.pareto import Pareto, pareto
from evaluate.analysis.ranking import Ranking, correct_p_values, ranking
from evaluate.analysis.score import Score, scores, select_scored_cells
from evaluate.analysis.summary import Summary, summarise
from evaluate.cells import PolicyScenarioResult
from evaluate.hardware import HardwareConfig
from evaluate.records.provenance import versions
from quad_env.files.writing import write_atomically

SCHEMA = 1


@dataclass(frozen=True)
class PolicyErrors:
    """Episodes that a policy failed, by an exception, no answer in time or none that is finite."""

    policy: str
    failed: int
    episodes: int
    """Of the run."""
    first: str
    """What the policy did in the first of them, such as `raised ValueError: …`, in one line."""


@dataclass(frozen=True)
class Results:
    """Everything that the table, the files and the report show."""

    seed: int
    episodes: int
    """Number in each cell."""
    complete: bool
    """False if the run was interrupted: cells are missing then, but none is half done."""
    cells: tuple[PolicyScenarioResult, ...]
    baseline: str
    """The policy that the others are measured against."""
    ranking: Ranking
    """By the scores without the hardware profile, if there are any."""
    summaries: dict[tuple[str, str], Summary]
    """By (scenario, policy), in the order of the run."""
    comparisons: tuple[Comparison, ...]
    breaking_points: tuple[AxisBreakingPoint, ...]
    scores: tuple[Score, ...]
    """The highest first."""
    hardware_scores: tuple[Score, ...]
    """The same with the robot's hardware profile."""
    pareto: Pareto
    """Success against cost of transport."""
    hardware_pareto: Pareto
    versions: Mapping[str, str | None]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """What else the figures were made with, as JSON values: processor, threads, hashes of policies and code."""

    @property
    def hardware(self) -> HardwareConfig:
        """Hardware of the robots; ideal where it is not known."""
        return _hardware(self.provenance)

    @property
    def policy_errors(self) -> list[PolicyErrors]:
        """Every policy that failed in an episode."""
        found = []
        for policy in self.policies:
            reasons = np.concatenate([cell.failure for cell in self.cells if cell.policy == policy])
            if known := [reason for reason in reasons if reason is not None]:
                found.append(PolicyErrors(policy, len(known), len(reasons), " ".join(known[0].split())))
        return found

    @property
    def policies(self) -> tuple[str, ...]:
        """Policies in the order of the run."""
        return tuple(dict.fromkeys(cell.policy for cell in self.cells))

    @property
    def scenarios(self) -> tuple[str, ...]:
        """Scenarios in the order of the run."""
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
    """Summaries, comparisons and breaking points of the cells; without a provenance they were made here and now."""
    made_with = dict(provenance or {"versions": versions()})
    against = baseline or default_baseline([cell.policy for cell in cells])
    robot = _hardware(made_with).robot_model
    made_by = made_with.pop("versions")
    ideal, real = (tuple(scores(cells, against, hardware=hardware)) for hardware in (False, True))
    fronts = [
        pareto([cell for cell in cells if cell.scenario.hardware == each[0]], each[1], robot)
        for each in ((False, ideal), (True, real))
    ]
    profile = not ideal
    ranked = ranking(select_scored_cells(cells, hardware=profile), fronts[profile].points, hardware=profile)
    pairs = {frozenset((each.better, each.worse)) for each in ranked.neighbours}
    ranked, comparisons = correct_p_values(ranked, compare(cells, against, pairs), made_with.get("limit", 0))
    return Results(
        seed=seed,
        episodes=episodes,
        complete=complete,
        cells=tuple(cells),
        baseline=against,
        ranking=ranked,
        summaries={(cell.scenario.name, cell.policy): summarise(cell, robot) for cell in cells},
        comparisons=tuple(comparisons),
        breaking_points=tuple(breaking_points(cells)),
        scores=ideal,
        hardware_scores=real,
        pareto=fronts[0],
        hardware_pareto=fronts[1],
        versions=made_by,
        provenance=made_with,
    )


def _hardware(provenance: Mapping[str, Any]) -> HardwareConfig:
    return HardwareConfig(**provenance.get("hardware", {}))


def as_json(results: Results) -> dict[str, Any]:
    """The contents of results.json; figures that do not exist are null."""
    policies: dict[str, Any] = {policy: {"scenarios": {}} for policy in results.policies}
    for (scenario, policy), summary in results.summaries.items():
        policies[policy]["scenarios"][scenario] = asdict(summary)
    plain = {name: getattr(results, name) for name in ("seed", "episodes", "complete", "baseline")}
    contents = {"schema": SCHEMA, **plain, "versions": dict(results.versions)}
    contents["provenance"] = {name: value for name, value in results.provenance.items() if name not in plain}
    for name in ("ranking", "policy_errors", "scores", "hardware_scores", "pareto", "hardware_pareto"):
        found = getattr(results, name)
        contents[name] = [asdict(each) for each in found] if isinstance(found, list | tuple) else asdict(found)
    contents["policies"] = policies
    for name in ("comparisons", "breaking_points"):
        contents[name] = [asdict(each) for each in getattr(results, name)]
    return dict(without_nan(contents))


def write_json(results: Results, path: Path) -> None:
    """Write results.json."""
    write_atomically(path, (json.dumps(as_json(results), indent=2, allow_nan=False) + "\n").encode())


def without_nan(value: Any) -> Any:
    """JSON values with null for a number that does not exist."""
    if isinstance(value, dict):
        return {key: without_nan(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def with_nan(value: Any) -> Any:
    """The same with NaN again for null."""
    if isinstance(value, dict):
        return {key: with_nan(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [with_nan(entry) for entry in value]
    return math.nan if value is None else value
