"""Trials of a parameter search: simulates a policy with many candidate parameters, and computes their costs.

A candidate is a set of policy parameters. All candidates walk the same episodes on the same scenarios.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from evaluate.hardware import IDEAL, HardwareConfig
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import Measures, measure
from evaluate.measures.outcomes import OUTCOMES, RULES, SUCCESS_RULE
from evaluate.rollouts.rollout import STEPS, ScenarioEpisodes, run_scenarios
from policies.base import Floats, Policy
from policies.parameters import Parameters
from policies.policy_stack import PolicyStack
from quad_env.scenarios.scenario import HARDWARE, Scenario
from train.curriculum import Purpose, with_terrain_seed

SCENARIOS_PER_BATCH = 7
"""Number of scenarios that are simulated together when old and new parameters are compared.

A larger number is faster and needs more memory (RAM)."""
Seeds = NDArray[np.int64]


class SaturatingCost(NamedTuple):
    """Saturating cost of a metric of an episode.

    The cost is `maximum` * x / (1 + x) with x = max((metric - `threshold`) / `scale`, 0).
    """

    maximum: float
    """Upper bound of the cost of the metric, dimensionless."""
    threshold: float
    """Value of the metric at which its cost begins to rise from zero, in the unit of the metric."""
    scale: float
    """Distance from `threshold` at which the cost is half of `maximum`, in the unit of the metric.

    The scale is negative if smaller values of the metric cost more."""


OUTCOME_COSTS = dict(zip(OUTCOMES, (0.0, 1.0, 1.5, 2.0, 2.0, 2.0), strict=True))
"""Outcome of an episode, for example success or a fall -> cost in a parameter search.

The cost of an episode is this cost plus costs that vary continuously with a metric, see `DEVIATION_COST` and `GRADES`.
The sum of the continuous costs is at most the smallest cost of a failure."""
DEVIATION_COST = 0.1
"""Upper bound of the cost of the largest velocity error of an episode in a parameter search.

The cost is proportional to the largest error over the command intervals, see `MAX_DEVIATION`. A command interval is the
time during which the velocity command is constant."""
MAX_DEVIATION = 4.0
"""Velocity error of a command interval at which the cost of the error reaches `DEVIATION_COST`.

A command interval is the time during which the velocity command is constant. The error is a multiple of the tolerance
in the success rule of the evaluator."""
GRADES = {
    "velocity_error": SaturatingCost(0.05, 0.0, 0.3),
    "overspeed": SaturatingCost(0.05, 0.0, 0.05),
    "cost_of_transport": SaturatingCost(0.4, 0.0, 1.0),
    "flight": SaturatingCost(0.1, 0.0, 0.1),
    "step_rate": SaturatingCost(0.1, 2.0, 2.0),
    "touchdown_impulse": SaturatingCost(0.05, 0.0, 0.03),
    "trunk_height": SaturatingCost(0.15, 0.85, -0.1),
}
"""Name of a metric of an episode -> function from the metric to its cost in a parameter search.

The threshold and the scale of each function are in the unit of the metric. A metric that is NaN has the maximum cost,
because the robot fell immediately."""
COST_DESCRIPTION = (
    "Cost of an episode: "
    + ", ".join(f"{name} {cost:g}" for name, cost in OUTCOME_COSTS.items())
    + f", and on top of that up to {DEVIATION_COST:g} for the worst command interval, "
    f"{MAX_DEVIATION:g} times what is allowed, and for "
    + ", ".join(
        f"{name} up to {maximum:g} (x {threshold:+g} / {scale:g})"
        for name, (maximum, threshold, scale) in GRADES.items()
    )
    + ", in the share x / (1 + x) of it."
)
"""Sentence for reports of a parameter search that explains the cost of an episode."""


def episode_costs(measures: Measures) -> Floats:
    """Compute the cost of each of n episodes in a parameter search, (n,).

    The cost of an episode is a sum: cost of the outcome, cost of the largest velocity error, and costs of the metrics
    in `GRADES`.
    """
    total = np.array([OUTCOME_COSTS[outcome] for outcome in measures.outcome])
    deviation = RULES[SUCCESS_RULE].deviations(measures.commands, measures.mean_velocities)
    # The velocity error is NaN in a command interval that the robot did not complete; NaN gives the largest cost.
    total += DEVIATION_COST * np.clip(np.nan_to_num(deviation, nan=np.inf) / MAX_DEVIATION, 0.0, 1.0).max(axis=1)
    for name, (maximum, threshold, scale) in GRADES.items():
        beyond = np.maximum((getattr(measures, name) - threshold) / scale, 0.0)
        total += maximum * np.nan_to_num(beyond / (1.0 + beyond), nan=1.0)
    return total


def run_candidates(
    name: str,
    candidates: Sequence[Parameters],
    scenario_names: Sequence[str],
    seeds: Seeds,
    purpose: Purpose,
    steps: int = STEPS,
    threads: int = 1,
    hardware: HardwareConfig = IDEAL,
) -> list[Episodes]:
    """Simulate a policy with the parameters of each candidate on several scenarios.

    Args:
        name: Name of the policy.
        candidates: Parameters of each candidate.
        scenario_names: Names of the scenarios.
        seeds: Seeds of the episodes, the same for every candidate and scenario.
        purpose: Purpose of the episodes, "search" or "validation". Each purpose has its own random terrain.
        steps: Length of an episode, control steps.
        threads: Number of simulation threads.
        hardware: Hardware settings of the robots.

    Returns:
        Record of the episodes of each scenario, ordered by candidate, then by seed.
    """
    episodes_by_scenario = dict[str, Episodes]()
    for on_hardware_profile in (False, True):
        names = [scenario for scenario in scenario_names if scenario.endswith(HARDWARE) == on_hardware_profile]
        if not names:
            continue
        make_policy = partial(hardware.policy, name, on_hardware_profile=on_hardware_profile)
        members = [make_policy(parameters=candidate) for candidate in candidates]
        stack = PolicyStack(members, len(names))
        scenarios = [with_terrain_seed(scenario, purpose, robot=hardware.robot_model) for scenario in names]
        all_seeds = np.tile(seeds, len(candidates))
        records = run_each(stack, scenarios, all_seeds, nthread=threads, steps=steps, hardware=hardware)
        episodes_by_scenario |= dict(zip(names, records, strict=True))
    return [episodes_by_scenario[scenario] for scenario in scenario_names]


def run_each(
    policy: Policy,
    scenarios: Sequence[str | Scenario],
    seeds: Seeds,
    *,
    nthread: int = 1,
    steps: int = STEPS,
    hardware: HardwareConfig = IDEAL,
) -> list[Episodes]:
    """Simulate one episode per seed on each scenario, all episodes together.

    Args:
        policy: Policy that controls the robots of all scenarios.
        scenarios: Scenarios or their names, at least one.
        seeds: Seeds of the episodes, the same on every scenario.
        nthread: Number of simulation threads.
        steps: Length of an episode, control steps.
        hardware: Hardware settings of the robots.

    Returns:
        Record of the episodes of each scenario, in the order of `seeds`.
    """
    batches = [ScenarioEpisodes(scenario, seeds, hardware) for scenario in scenarios]
    return run_scenarios(policy, batches, nthread=nthread, steps=steps)


def compare_parameters(
    name: str,
    in_force: Parameters,
    outcome: Parameters,
    scenario_names: Sequence[str],
    seeds: Seeds,
    threads: int = 1,
    hardware: HardwareConfig = IDEAL,
) -> tuple[list[tuple[str, str, Measures]], Floats]:
    """Simulate a policy with old and new parameters on the same full-length validation episodes.

    Args:
        name: Name of the policy.
        in_force: Parameters before the search.
        outcome: Parameters after the search.
        scenario_names: Names of the scenarios.
        seeds: Seeds of the episodes.
        threads: Number of simulation threads.
        hardware: Hardware settings of the robots.

    Returns:
        walks: Two tuples per scenario: its name, the word `before` or `after`, and the metrics of the episodes.
        differences: Cost with the new parameters minus cost with the old ones, for each of s seeds, averaged over the
            scenarios, (s,).
    """
    walks: list[tuple[str, str, Measures]] = []
    differences = np.zeros(len(seeds))
    starts = range(0, len(scenario_names), SCENARIOS_PER_BATCH)
    groups = [scenario_names[first : first + SCENARIOS_PER_BATCH] for first in starts]
    for group in track(groups, description="comparison"):
        before, after = (
            run_candidates(name, [parameters], group, seeds, "validation", threads=threads, hardware=hardware)
            for parameters in (in_force, outcome)
        )
        for scenario_name, old, new in zip(group, map(measure, before), map(measure, after), strict=True):
            walks += [(scenario_name, "before", old), (scenario_name, "after", new)]
            differences += episode_costs(new) - episode_costs(old)
    return walks, differences / len(scenario_names)
