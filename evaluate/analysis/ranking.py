"""Whether the ranking of policies by success is the same in two runs, such as those of two simulators."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from evaluate.analysis.comparison import SIGNIFICANT
from evaluate.measures.averages import quotient
from evaluate.measures.outcomes import SUCCEEDED
from evaluate.records.store import rows_of
from evaluate.statistics.intervals import RESAMPLES, Floats, Interval, percentile_interval, resamples
from evaluate.statistics.significance import holm, sign_flip_test
from quad_env.cli.format import interval, number, p_value, percent, points

LEAST_POLICIES = 3
"""Policies below which there is nothing to rank."""


@dataclass(frozen=True)
class Reversal:
    """Two policies of which one is significantly better in A and the other in B. The fields are keys of the file."""

    scenario: str
    """Or `score`."""
    better_in_a: str
    better_in_b: str
    differences: tuple[float, float]
    """Success of the former minus that of the latter, in A and in B."""
    p_value_holm: float
    """The larger one of A and B, sign-flip permutation, corrected over all pairs on all scenarios and in score."""


@dataclass(frozen=True)
class Ranking:
    """Policies by their mean success over the axes of the scenarios in both runs. The fields are keys of the file."""

    policies: tuple[str, ...]
    scores: tuple[tuple[float, ...], tuple[float, ...]]
    """In A and in B."""
    correlation: float
    """Kendall's tau-b of the scores: 1 for the same order, −1 for the opposite one."""
    ci: Interval
    """95 %, bootstrap over the episodes, each with all policies and scenarios; those of the same seeds stay paired."""
    reversals: tuple[Reversal, ...]

    def lines(self) -> Iterator[str]:
        """The answer, both rankings and what is reversed."""
        low, high = self.ci
        survives = "yes" if low > 0.0 else "no" if high < 0.0 else "not shown"
        survives = "in part" if survives == "yes" and self.reversals else survives
        figure = f"{number(self.correlation, 2)} [{interval(self.ci, 2)}]"
        yield f"does the ranking survive? {survives}: Kendall's tau of {len(self.policies)} policies' scores {figure}"
        for run, scores in zip("AB", self.scores, strict=True):
            order = sorted(zip(self.policies, scores, strict=True), key=lambda each: -each[1])
            yield f"ranking of {run}: {', '.join(f'{policy} {percent(score)}' for policy, score in order)}"
        for each in self.reversals:
            a, b = map(points, each.differences)
            pair = f"{each.better_in_a} minus {each.better_in_b} is {a} points in A and {b} in B"
            yield f"reversed on {each.scenario}: {pair}, {p_value(each.p_value_holm)}"


def ranking(pairs: Sequence[tuple[str, str]], axes: Mapping[str, str], *runs: pa.Table) -> Ranking:
    """Of policies of A and B, from scenario -> axis and the rows of both runs, of which common seeds alone count."""
    seeds = [np.unique(rows.column("seed").to_numpy()) for rows in runs]
    common = np.intersect1d(seeds[0], seeds[1])
    kept = [common, common] if len(common) else seeds
    of_axis = list(axes.values())
    shares = np.array([1.0 / of_axis.count(axis) for axis in of_axis]) / len(set(of_axis))
    named = zip(*pairs, strict=True)
    a, b = (_successes(*each, axes, shares) for each in zip(runs, kept, named, strict=True))
    resampled = rank_correlation(_resampled(a[0], 0), _resampled(b[0], 0 if len(common) else 1))
    known, scores = resampled[~np.isnan(resampled)], (a[0].mean(axis=-1), b[0].mean(axis=-1))
    policies = [policy for policy, _ in pairs]
    return Ranking(
        policies=tuple(policies),
        scores=(tuple(scores[0].tolist()), tuple(scores[1].tolist())),
        correlation=float(rank_correlation(*scores)),
        ci=percentile_interval(known) if len(known) else (np.nan, np.nan),
        reversals=tuple(_reversals(policies, ("score", *axes), a, b)),
    )


def rank_correlation(a: Floats, b: Floats) -> Floats:
    """Kendall's tau-b of scores (…, k) of k policies; NaN where all are tied in a or in b (Biometrika 33, 1945)."""
    first, second = np.triu_indices(a.shape[-1], 1)
    in_a, in_b = (np.sign(np.round(each[..., first] - each[..., second], 9)) for each in (a, b))
    return quotient((in_a * in_b).sum(-1), np.sqrt((in_a**2).sum(-1) * (in_b**2).sum(-1)))


def _successes(
    rows: pa.Table, seeds: NDArray[np.int64], policies: Sequence[str], axes: Mapping[str, str], shares: Floats
) -> Floats:
    """Success, 1 or 0, by (1 + scenario, policy, seed); first the score, every axis and each of its scenarios alike."""
    kept = rows.filter(pc.is_in(rows.column("seed"), pa.array(seeds))).sort_by("seed")
    found = [[rows_of(kept, policy, name).column("outcome").to_pylist() for policy in policies] for name in axes]
    succeeded = (np.array(found) == SUCCEEDED).astype(np.float64)
    return np.concatenate([np.tensordot(shares, succeeded, 1)[None], succeeded])


def _resampled(scores: Floats, seed: int) -> Floats:
    """Mean scores, (m, k), of resamples of the episodes of (k, n)."""
    episodes = scores.shape[1]
    return np.concatenate([counts @ scores.T / episodes for counts in resamples(episodes, RESAMPLES, seed)])


def _reversals(policies: Sequence[str], scenarios: Sequence[str], a: Floats, b: Floats) -> list[Reversal]:
    found = []
    for (place, scenario), (i, j) in product(enumerate(scenarios), permutations(range(len(policies)), 2)):
        both = a[place, i] - a[place, j], b[place, i] - b[place, j]
        differences = float(both[0].mean()), float(both[1].mean())
        if differences[0] > 0.0 > differences[1]:
            found.append(Reversal(scenario, policies[i], policies[j], differences, max(map(sign_flip_test, both))))
    others = len(scenarios) * len(policies) * (len(policies) - 1) // 2 - len(found)
    corrected = holm([*(each.p_value_holm for each in found), *[1.0] * others])
    changed = (replace(each, p_value_holm=p) for each, p in zip(found, corrected, strict=False))
    return [each for each in changed if each.p_value_holm < SIGNIFICANT]
