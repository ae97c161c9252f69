"""Two runs as one: the ranking of the policies of both by the episodes that both have."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from evaluate.analysis.comparison import SUCCESS_RATE, Comparison, compare_pair
from evaluate.analysis.matches import Match, StoredRun
from evaluate.analysis.pareto import ParetoPoint, compute_pareto
from evaluate.analysis.rank_correlation import MIN_POLICIES, RankCorrelation, rank_correlation
from evaluate.analysis.ranking import Ranking, correct_p_values, rank_policies
from evaluate.analysis.score import ScoredCells, compute_scores, select_scored_cells
from evaluate.cells import PolicyScenarioResult
from evaluate.records.episode_table import cell_of
from evaluate.records.store import rows_of

Labels = Mapping[str, str]
"""Policy of a run -> what it is called next to those of the other run."""


@dataclass(frozen=True)
class CombinedRuns:
    """What two runs show together."""

    ranking: Ranking
    """Of the policies of both, on the scenarios and the seeds of both."""
    matches: tuple[Match, ...]
    """With corrected p-values."""
    correlation: RankCorrelation | None
    """None of too few policies."""


def combine_runs(
    found: Sequence[Match], runs: tuple[StoredRun, StoredRun], labels: tuple[Labels, Labels]
) -> CombinedRuns:
    """The ranking across both runs, and one correction for all its claims and for the matches' differences of success.

    A policy of both runs that has one label is in it once.
    """
    own = [_cells(*runs, labels[0]), _cells(*runs[::-1], labels[1])]
    cells = [*{(cell.scenario.name, cell.policy): cell for of in own[::-1] for cell in of}.values()]
    real = not select_scored_cells(cells).cells_by_policy
    complete, points = select_scored_cells(cells, hardware=real), dict[str, ParetoPoint]()
    for (manifest, _), of in zip(runs[::-1], own[::-1], strict=True):
        scored = [each for each in compute_scores(of, "", hardware=real) if each.policy in complete.cells_by_policy]
        points |= {each.policy: each for each in compute_pareto(of, scored, manifest.hardware.robot_model).points}
    ranked = rank_policies(complete, sorted(points.values(), key=lambda each: -each.success), hardware=real)
    keys = [(match.scenario, frozenset((labels[0][match.a], labels[1][match.b]))) for match in found]
    claimed = {key: _of_match(match, labels) for key, match in zip(keys, found, strict=True)}
    for each in ranked.neighbours:
        for name in complete.scenarios:
            pair = complete.cells_by_policy[each.better][name], complete.cells_by_policy[each.worse][name]
            claimed[name, frozenset((each.better, each.worse))] = next(compare_pair(*pair, (SUCCESS_RATE,)))
    ranked, corrected = correct_p_values(ranked, [*claimed.values()])
    p_values = dict(zip(claimed, (each.p_value_holm for each in corrected), strict=True))
    matches = (replace(match, p_value_holm=p_values[key]) for key, match in zip(keys, found, strict=True))
    return CombinedRuns(ranked, tuple(matches), _correlation(found, complete, labels))


def _of_match(match: Match, labels: tuple[Labels, Labels]) -> Comparison:
    (of,) = (each for each in match.contrasts if each.metric == SUCCESS_RATE)
    names = labels[1][match.b], labels[0][match.a]
    return Comparison(match.scenario, *names, of.metric, of.difference, of.ci, of.p_value, of.test, of.p_value)


def _correlation(
    found: Sequence[Match], complete: ScoredCells, labels: tuple[Labels, Labels]
) -> RankCorrelation | None:
    pairs = [
        (a, b)
        for a, b in dict.fromkeys((m.a, m.b) for m in found)
        if {labels[0][a], labels[1][b]} <= {*complete.cells_by_policy}
    ]
    if len(pairs) < MIN_POLICIES:
        return None
    values = ([complete.by_episode(of[pair[k]]) for pair in pairs] for k, of in enumerate(labels))
    return rank_correlation([a for a, _ in pairs], *map(np.array, values))


def _cells(run: StoredRun, other: StoredRun, labels: Labels) -> list[PolicyScenarioResult]:
    """Cells of a run on the scenarios and with the seeds that the other has too."""
    (manifest, rows), (_, others) = run, other
    seeds = np.intersect1d(rows.column("seed").to_numpy(), others.column("seed").to_numpy())
    kept = rows.filter(pc.is_in(rows.column("seed"), pa.array(seeds))).sort_by("seed")
    there = {*others.column("scenario").to_pylist()}
    wanted = [(each, policy) for each, policy in manifest.cells if each.name in there and policy in labels]
    tables = ((each, policy, rows_of(kept, policy, each.name)) for each, policy in wanted)
    complete = ((each, policy, of) for each, policy, of in tables if len(of) == len(seeds) > 0)
    return [replace(cell_of(of, each), policy=labels[policy]) for each, policy, of in complete]
