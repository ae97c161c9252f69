"""Rank correlation of two evaluations: do both of them rank the policies in the same order?

The two evaluations run the same policies, for example with different simulators.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from evaluate.measures.averages import quotient
from evaluate.statistics.intervals import RESAMPLES, Floats, Interval, percentile_interval, resamples
from quad_env.cli.format import estimate, percent

MIN_POLICIES = 3
"""Minimum number of compared policies for which the rank correlation of two evaluations is computed."""


@dataclass(frozen=True)
class RankCorrelation:
    """Rank correlation between the scores of the same policies in two evaluations (runs A and B).

    A score is the mean success over the kinds of disturbance that both runs have. The field names are the keys in the
    JSON file that the command `compare` writes.
    """

    policies: tuple[str, ...]
    """Names of the compared policies in run A."""
    scores: tuple[tuple[float, ...], tuple[float, ...]]
    """Score of each policy in run A, and score of each policy in run B, 0 … 1, in the order of `policies`."""
    correlation: float
    """Kendall's tau-b between the scores in run A and in run B, −1 … 1.

    It is 1 if both runs rank the policies in the same order, and −1 if they rank them in the opposite order.
    """
    ci: Interval
    """95 % bootstrap interval of `correlation`, −1 … 1.

    The bootstrap resamples episode seeds. A seed is drawn together with its episodes of all policies and scenarios of
    both runs. The interval is widened to include `correlation`, because every resample may give a smaller value.
    """

    def lines(self) -> Iterator[str]:
        """Yield lines of text to print: does the ranking of run A also hold in run B?

        The first line has the answer, and two further lines have the rankings of both runs. The answer is `yes` if the
        interval of the correlation is positive and includes 1. It is `in part` if the interval is positive and below 1,
        and `no` if the interval is negative. Otherwise it is `not shown`.
        """
        low, high = self.ci
        positive = "in part" if high < 1.0 - 1e-9 else "yes"
        answer = positive if low > 0.0 else "no" if high < 0.0 else "not shown"
        figure = estimate(self.correlation, self.ci, 2).with_interval
        yield f"does the ranking survive? {answer}: Kendall's tau of {len(self.policies)} policies' scores {figure}"
        for run, scores in zip("AB", self.scores, strict=True):
            ranked = sorted(zip(self.policies, scores, strict=True), key=lambda entry: -entry[1])
            yield f"ranking of {run}: {', '.join(f'{policy} {percent(score)}' for policy, score in ranked)}"


def rank_correlation(policies: Sequence[str], a: Floats, b: Floats) -> RankCorrelation:
    """Compute the rank correlation of k policies between two evaluations (runs A and B).

    The runs have n seeds in common.

    Args:
        policies: Names of the policies in run A, (k,).
        a: Score of each policy for each seed in run A, (k, n), 0 … 1.
        b: Score of each policy for each seed in run B, (k, n), 0 … 1.

    Returns:
        Kendall's tau-b with its bootstrap interval, and the scores.
    """
    weights = [counts / counts.shape[1] for counts in resamples(a.shape[1], RESAMPLES, 0)]
    resampled_a = np.concatenate([block @ a.T for block in weights])
    resampled_b = np.concatenate([block @ b.T for block in weights])
    resampled = kendall_tau(resampled_a, resampled_b)
    known = resampled[~np.isnan(resampled)]
    mean_a = a.mean(axis=-1)
    mean_b = b.mean(axis=-1)
    correlation = float(kendall_tau(mean_a, mean_b))
    low, high = percentile_interval(known) if len(known) else (np.nan, np.nan)
    return RankCorrelation(
        policies=tuple(policies),
        scores=(tuple(mean_a.tolist()), tuple(mean_b.tolist())),
        correlation=correlation,
        ci=(float(np.fmin(low, correlation)), float(np.fmax(high, correlation))) if len(known) else (np.nan, np.nan),
    )


def kendall_tau(a: Floats, b: Floats) -> Floats:
    """Compute Kendall's rank correlation tau-b between two sets of scores (Biometrika 33, 1945).

    Args:
        a: Score of each of k policies in the first set, (…, k).
        b: Score of each of the same k policies in the second set, (…, k).

    Returns:
        Correlation, −1 … 1, (…). It is NaN if all policies have the same score in `a` or in `b`.
    """
    first, second = np.triu_indices(a.shape[-1], 1)
    sign_a = np.sign(np.round(a[..., first] - a[..., second], 9))
    sign_b = np.sign(np.round(b[..., first] - b[..., second], 9))
    return quotient((sign_a * sign_b).sum(-1), np.sqrt((sign_a**2).sum(-1) * (sign_b**2).sum(-1)))
