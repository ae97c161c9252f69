"""Combined ranking of the policies of two evaluations (runs A and B), on common scenarios and seeds."""

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
"""Name of a policy in one run -> display name of the policy in the combined results of two runs."""
ClaimKey = tuple[str, frozenset[str]]
"""Key of a comparison of two policies: scenario name, and display names of the two policies."""


@dataclass(frozen=True)
class CombinedRuns:
    """Results of two evaluations (runs A and B) that are analysed together, made by `combine_runs`."""

    ranking: Ranking
    """Ranking of the policies of both runs, on the scenarios and episode seeds that both runs have."""
    matches: tuple[Match, ...]
    """Comparisons of policies of run A with policies of run B, one for each pair and each common scenario.

    The pairs are the policies that both runs have, or one pair that the user chooses. The p-values are corrected for
    the number of all tests.
    """
    correlation: RankCorrelation | None
    """Rank correlation of the scores in runs A and B: do both runs rank the policies in the same order?

    The value is None if fewer than MIN_POLICIES policies are compared.
    """


def combine_runs(
    matches: Sequence[Match], runs: tuple[StoredRun, StoredRun], labels: tuple[Labels, Labels]
) -> CombinedRuns:
    """Rank the policies of two evaluations (runs A and B) together, and correct all p-values.

    Args:
        matches: Comparisons of policies of run A with policies of run B, one for each pair and each common scenario.
        runs: Run A and run B, each as manifest and episode table.
        labels: Name of a policy -> display name, for run A and for run B. Policies with equal display names count as
            one policy.

    Returns:
        Ranking, comparisons with corrected p-values, and rank correlation between the two runs.
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
    """Return the results of one run, reduced to the scenarios and seeds that another run has as well.

    Args:
        run: Manifest and episode table of the run to reduce.
        other: Manifest and episode table of the other run.
        labels: Name of a policy of `run` -> display name; all other policies are left out.

    Returns:
        Results with the display names of the policies, one for each policy-scenario pair that has all common seeds.
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
    """Merge the results of runs A and B into one list.

    Args:
        cells_of_a: Results of run A, one for each policy-scenario pair, with display names.
        cells_of_b: Results of run B, one for each policy-scenario pair, with display names.

    Returns:
        One result for each policy-scenario pair. If both runs have a result for a pair, the result of run A is kept.
    """
    merged = {(cell.scenario.name, cell.policy): cell for cell in (*cells_of_b, *cells_of_a)}
    return list(merged.values())


def _pareto_points(
    run: StoredRun, cells: Sequence[PolicyScenarioResult], scored: ScoredCells, *, hardware: bool
) -> dict[str, ParetoPoint]:
    """Compute success and cost of transport of policies from the results of one run.

    Args:
        run: Manifest and episode table of the run.
        cells: Results of the run, one for each policy-scenario pair.
        scored: Results of both runs that enter the score. Policies that have no result in `scored` are left out.
        hardware: True to use the scenarios with the hardware profile (models of the real robot's motors and sensors),
            False to use the scenarios without it.

    Returns:
        Name of the policy -> success and cost of transport.
    """
    manifest, _ = run
    scores = [score for score in compute_scores(cells, "", hardware=hardware) if score.policy in scored.cells_by_policy]
    return {point.policy: point for point in compute_pareto(cells, scores, manifest.hardware.robot_model).points}


def _claim_key(match: Match, labels: tuple[Labels, Labels]) -> ClaimKey:
    """Return the key of a comparison: its scenario, and the display names of the two compared policies.

    Args:
        match: Comparison of a policy of run A with a policy of run B on one scenario.
        labels: Name of a policy -> display name, for run A and for run B.

    Returns:
        Scenario name and set of two display names.
    """
    return match.scenario, frozenset((labels[0][match.a], labels[1][match.b]))


def _success_comparison(match: Match, labels: tuple[Labels, Labels]) -> Comparison:
    """Convert the difference in success rate between two runs to a comparison with display names.

    Args:
        match: Comparison of a policy of run A with a policy of run B on one scenario.
        labels: Name of a policy -> display name, for run A and for run B.

    Returns:
        Success rate of the policy of run B minus success rate of the policy of run A, with interval and p-value.
    """
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
    """Compare the success rates of each pair of neighbours in the ranking, on every scenario of the score.

    Args:
        ranked: Combined ranking of the policies of both runs.
        scored: Results of both runs from which the ranking was computed.

    Returns:
        (scenario name, two policy names) -> comparison of the success rates of the two policies on the scenario.
    """
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
    """Compute the rank correlation of the scores in runs A and B: is the order of the policies the same?

    Only compared policies that have a score in both runs count.

    Args:
        matches: Comparisons of policies of run A with policies of run B, one for each pair and each common scenario.
        scored: Results of both runs that enter the score.
        labels: Name of a policy -> display name, for run A and for run B.

    Returns:
        Rank correlation with its interval; None for fewer than MIN_POLICIES policies.
    """
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
