"""Rank correlation: do two runs, for example in two simulators, give their policies the same order?"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from evaluate.measures.averages import quotient
from evaluate.statistics.intervals import RESAMPLES, Floats, Interval, percentile_interval, resamples
from quad_env.cli.format import estimate, percent

MIN_POLICIES = 3
"""Minimum number of policies for which a rank correlation is computed."""


@dataclass(frozen=True)
class RankCorrelation:
    """Rank correlation between the scores of the same policies in two runs, A and B.

    A score is the mean success over the disturbance axes that both runs have. The field names are the keys in the JSON
    file.
    """

    policies: tuple[str, ...]
    """Names of the policies in run A."""
    scores: tuple[tuple[float, ...], tuple[float, ...]]
    """Score of each policy, 0 … 1: in run A, and in run B."""
    correlation: float
    """Kendall's tau-b of the two sets of scores: 1 for the same order, −1 for the opposite order."""
    ci: Interval
    """95 % bootstrap interval of `correlation`.

    The bootstrap resamples episodes, each with all policies and scenarios of both runs. The interval is widened to
    include `correlation`, because every resample may give a smaller value.
    """

    def lines(self) -> Iterator[str]:
        """Yield the printed lines: an answer if the ranking of run A holds in run B, and both rankings.

        The printed answer is `yes` if the interval is positive and includes 1, and `in part` if it is positive and
        below 1. The answer is `no` for a negative interval, and otherwise `not shown`.
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
    """Compute the rank correlation of k policies between two runs with n common episodes.

    Args:
        policies: Names of the policies.
        a: Score of each policy in each episode of run A, (k, n).
        b: Score of each policy in each episode of run B, (k, n).

    Returns:
        Correlation and its bootstrap interval.
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
    """Compute Kendall's tau-b between two scores of k policies (Biometrika 33, 1945).

    Args:
        a: First score of each policy, (…, k).
        b: Second score of each policy, (…, k).

    Returns:
        Correlation, −1 … 1, (…); NaN where all policies have the same score in `a` or in `b`.
    """
    first, second = np.triu_indices(a.shape[-1], 1)
    sign_a = np.sign(np.round(a[..., first] - a[..., second], 9))
    sign_b = np.sign(np.round(b[..., first] - b[..., second], 9))
    return quotient((sign_a * sign_b).sum(-1), np.sqrt((sign_a**2).sum(-1) * (sign_b**2).sum(-1)))
