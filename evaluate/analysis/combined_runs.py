"""Combined ranking of the policies of two runs, on the scenarios and seeds that both runs have."""

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
"""Name of a policy in one run -> its display name in the combined results."""
ClaimKey = tuple[str, frozenset[str]]
"""Name of a scenario, and the display names of the two policies that are compared on it."""


@dataclass(frozen=True)
class CombinedRuns:
    """Results of two runs together, made by `combine_runs`."""

    ranking: Ranking
    """Ranking of the policies of both runs, on the scenarios and seeds that both runs have."""
    matches: tuple[Match, ...]
    """Matched pairs of policies on each common scenario, with corrected p-values."""
    correlation: RankCorrelation | None
    """Rank correlation of the matched policies between the runs; None for fewer than MIN_POLICIES."""


def combine_runs(
    matches: Sequence[Match], runs: tuple[StoredRun, StoredRun], labels: tuple[Labels, Labels]
) -> CombinedRuns:
    """Rank the policies of two runs together and correct all p-values at once.

    Args:
        matches: Matched pairs of policies on each common scenario.
        runs: Manifest and episode table of each run.
        labels: Name of a policy -> display name, for each run; equal display names count as one policy.

    Returns:
        The combined results.
    """
    cells_of_a = _shared_cells(runs[0], runs[1], labels[0])
    cells_of_b = _shared_cells(runs[1], runs[0], labels[1])
    cells = _merge_cells(cells_of_a, cells_of_b)
    hardware = not select_scored_cells(cells).cells_by_policy
    scored = select_scored_cells(cells, hardware=hardware)
    points = _pareto_points(runs[1], cells_of_b, scored, hardware=hardware)
    points |= _pareto_points(runs[0], cells_of_a, scored, hardware=hardware)
    places = sorted(points.values(), key=lambda point: -point.success)
    ranked = rank_policies(scored, places, hardware=hardware)
    claims = {_claim_key(match, labels): _success_comparison(match, labels) for match in matches}
    claims |= _adjacent_claims(ranked, scored)
    ranked, corrected = correct_p_values(ranked, list(claims.values()))
    p_values = {key: comparison.p_value_holm for key, comparison in zip(claims, corrected, strict=True)}
    corrected_matches = (replace(match, p_value_holm=p_values[_claim_key(match, labels)]) for match in matches)
    return CombinedRuns(ranked, tuple(corrected_matches), _correlation(matches, scored, labels))


def _shared_cells(run: StoredRun, other: StoredRun, labels: Labels) -> list[PolicyScenarioResult]:
    """Return the cells of `run`, reduced to the scenarios and seeds that `other` has as well.

    A cell holds the episodes of one policy on one scenario.
    """
    manifest, rows = run
    _, other_rows = other
    seeds = np.intersect1d(rows.column("seed").to_numpy(), other_rows.column("seed").to_numpy())
    shared_rows = rows.filter(pc.is_in(rows.column("seed"), pa.array(seeds))).sort_by("seed")
    scenarios = {*other_rows.column("scenario").to_pylist()}
    cells = []
    for scenario, policy in manifest.cells:
        if scenario.name not in scenarios or policy not in labels:
            continue
        cell_rows = rows_of(shared_rows, policy, scenario.name)
        if len(cell_rows) == len(seeds) > 0:
            cells.append(replace(cell_of(cell_rows, scenario), policy=labels[policy]))
    return cells


def _merge_cells(
    cells_of_a: Sequence[PolicyScenarioResult], cells_of_b: Sequence[PolicyScenarioResult]
) -> list[PolicyScenarioResult]:
    """Merge the cells of both runs; run A wins if both have a cell of one policy on one scenario."""
    merged = {(cell.scenario.name, cell.policy): cell for cell in (*cells_of_b, *cells_of_a)}
    return list(merged.values())


def _pareto_points(
    run: StoredRun, cells: Sequence[PolicyScenarioResult], scored: ScoredCells, *, hardware: bool
) -> dict[str, ParetoPoint]:
    """Return a dictionary: policy -> success and cost of transport in `run`, for the policies in `scored`."""
    manifest, _ = run
    scores = [score for score in compute_scores(cells, "", hardware=hardware) if score.policy in scored.cells_by_policy]
    return {point.policy: point for point in compute_pareto(cells, scores, manifest.hardware.robot_model).points}


def _claim_key(match: Match, labels: tuple[Labels, Labels]) -> ClaimKey:
    return match.scenario, frozenset((labels[0][match.a], labels[1][match.b]))


def _success_comparison(match: Match, labels: tuple[Labels, Labels]) -> Comparison:
    """Return the difference in success rate of a match: policy of run B minus policy of run A."""
    (difference,) = (contrast for contrast in match.contrasts if contrast.metric == SUCCESS_RATE)
    return Comparison(
        scenario=match.scenario,
        a=labels[1][match.b],
        b=labels[0][match.a],
        metric=difference.metric,
        difference=difference.difference,
        ci=difference.ci,
        p_value=difference.p_value,
        test=difference.test,
        p_value_holm=difference.p_value,
    )


def _adjacent_claims(ranked: Ranking, scored: ScoredCells) -> dict[ClaimKey, Comparison]:
    """Compare the success of each adjacent pair on every scenario: (scenario, pair) -> comparison."""
    claims = {}
    for pair in ranked.neighbours:
        better_cells = scored.cells_by_policy[pair.better]
        worse_cells = scored.cells_by_policy[pair.worse]
        for scenario in scored.scenarios:
            (comparison,) = compare_pair(better_cells[scenario], worse_cells[scenario], (SUCCESS_RATE,))
            claims[scenario, frozenset((pair.better, pair.worse))] = comparison
    return claims


def _correlation(
    matches: Sequence[Match], scored: ScoredCells, labels: tuple[Labels, Labels]
) -> RankCorrelation | None:
    """Compute the rank correlation of the scored, matched policies; None for fewer than MIN_POLICIES."""
    pairs = [
        (a, b)
        for a, b in dict.fromkeys((match.a, match.b) for match in matches)
        if {labels[0][a], labels[1][b]} <= {*scored.cells_by_policy}
    ]
    if len(pairs) < MIN_POLICIES:
        return None
    scores_in_a = np.array([scored.by_episode(labels[0][a]) for a, _ in pairs])
    scores_in_b = np.array([scored.by_episode(labels[1][b]) for _, b in pairs])
    return rank_correlation([a for a, _ in pairs], scores_in_a, scores_in_b)
