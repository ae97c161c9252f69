"""Success of policies on the truth and with each estimator, in the same episodes.

Success is that of the evaluator; a difference is that of shares paired by episode, with its 95 % score interval.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluate.analysis.comparison import SUCCESS_RATE, by_episode, paired_difference
from evaluate.rollouts.experiment import LabelledPolicy, Settings, run_cell
from evaluate.rollouts.hardware import IDEAL, Hardware
from policies.base import Floats
from quad_env.scenarios.scenario import Scenario
from quad_env.sensing.estimators import ESTIMATORS
from research.studies.ground import points_more, share_of


class Successes(NamedTuple):
    """Of one policy on one scenario, (n,) each, 1 or 0."""

    truth: Floats
    estimates: dict[str, Floats]
    """Name of each estimator -> successes of the same episodes."""


def successes(policy: str, scenario: Scenario, seeds: NDArray[np.int64], sensors: str, nthread: int) -> Successes:
    """Successes of the policy of that name or path with those sensors; PolicyError if there is none."""

    def of(hardware: Hardware) -> Floats:
        labelled = LabelledPolicy(policy, hardware.policy(policy))
        settings = Settings(nthread, lambda *_: None, hardware=hardware)
        return by_episode(run_cell(labelled, scenario, seeds, settings), SUCCESS_RATE)

    return Successes(of(IDEAL), {name: of(Hardware(sensors=sensors, estimator=name)) for name in ESTIMATORS})


def table(
    policies: Sequence[str], scenarios: Sequence[Scenario], seeds: NDArray[np.int64], sensors: str, nthread: int
) -> Iterator[str]:
    """Lines of a Markdown table: a row a scenario and policy."""
    by = [heading for name in ESTIMATORS for heading in (f"on {name}", "points more")]
    headings = ["scenario", "policy", "on truth", *by]
    yield f"| {' | '.join(headings)} |"
    yield "|---" * len(headings) + "|"
    for scenario in scenarios:
        for policy in policies:
            found = successes(policy, scenario, seeds, sensors, nthread)
            cells = [scenario.name, f"`{policy}`", share_of(found.truth)]
            for each in found.estimates.values():
                difference, ends, _, _ = paired_difference(SUCCESS_RATE, each, found.truth)
                cells += [share_of(each), points_more(difference, ends)]
            yield f"| {' | '.join(cells)} |"
