"""Trials of a search: episodes of many candidates on many scenarios in one batch, and the cost of an episode."""

from collections.abc import Sequence
from contextlib import ExitStack, closing
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from evaluate.hardware import IDEAL, HardwareConfig
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import Measures, measure
from evaluate.measures.outcomes import OUTCOMES, RULES, SUCCESS_RULE
from evaluate.rollouts.rollout import STEPS, EpisodeRecorder, advance, make_env, reset_episodes
from policies.base import Floats, Policy
from policies.parameters import Parameters
from policies.policy_stack import PolicyStack
from quad_env.scenarios.scenario import HARDWARE, Scenario
from train.curriculum import Purpose, with_terrain_seed

SCENARIOS_PER_BATCH = 7
"""Number of scenarios that a comparison simulates together: more are faster, and their records need more memory."""
Seeds = NDArray[np.int64]


class SaturatingCost(NamedTuple):
    """Cost of a measure: `maximum` x / (1 + x), where x = (measure - threshold) / scale, and zero below x = 0."""

    maximum: float
    """Upper bound of the cost."""
    threshold: float
    """Value up to which the cost is zero, in the unit of the measure."""
    scale: float
    """Distance from the threshold at which the cost is half the maximum; negative if smaller values cost more."""


OUTCOME_COSTS = dict(zip(OUTCOMES, (0.0, 1.0, 1.5, 2.0, 2.0, 2.0), strict=True))
"""Cost of an episode's outcome. All graded costs together add up to at most the smallest cost of a failure."""
DEVIATION_COST = 0.1
"""Upper bound of the graded cost of the worst command interval."""
MAX_DEVIATION = 4.0
"""Deviation of the worst command interval, per allowed deviation, at which its cost is DEVIATION_COST."""
GRADES = {
    "velocity_error": SaturatingCost(0.05, 0.0, 0.3),
    "overspeed": SaturatingCost(0.05, 0.0, 0.05),
    "cost_of_transport": SaturatingCost(0.4, 0.0, 1.0),
    "flight": SaturatingCost(0.1, 0.0, 0.1),
    "step_rate": SaturatingCost(0.1, 2.0, 2.0),
    "touchdown_impulse": SaturatingCost(0.05, 0.0, 0.03),
    "trunk_height": SaturatingCost(0.15, 0.85, -0.1),
}
"""Graded cost of each measure that has one, in its unit. A measure that is NaN costs the maximum: the robot fell at
once."""
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
"""Description of the cost, for reports."""


def episode_costs(measures: Measures) -> Floats:
    """Compute the cost of each episode, (episodes,): its outcome, its distance from a better one, and its effort."""
    total = np.array([OUTCOME_COSTS[outcome] for outcome in measures.outcome])
    deviation = RULES[SUCCESS_RULE].deviations(measures.commands, measures.mean_velocities)
    # An interval that was not completed has the largest cost.
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
    """Run a policy with the parameters of each candidate.

    Args:
        name: Name of the policy.
        candidates: Parameters of each candidate.
        scenario_names: Scenarios.
        seeds: Seeds of the episodes of every candidate on every scenario.
        purpose: Purpose that selects the random ground.
        steps: Length of an episode, control steps.
        threads: Threads of the simulation.
        hardware: Hardware of the robots.

    Returns:
        Records of the episodes on each scenario, candidate after candidate.
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
    """Run one episode per seed on each scenario, all of them together.

    The policy acts for all robots in one call, scenario after scenario. This is many times faster if the time of the
    policy hardly depends on the number of robots. The policy's own signals, for example its phase, are not recorded.

    Args:
        policy: Policy of all robots.
        scenarios: Scenarios.
        seeds: Seeds of the episodes on every scenario.
        nthread: Threads of the simulation.
        steps: Length of an episode, control steps.
        hardware: Hardware of the robots.

    Returns:
        Records of the episodes on each scenario.
    """
    recorders = [EpisodeRecorder(None, seeds, steps) for _ in scenarios]
    make_scenario_env = partial(make_env, policy, count=len(seeds), steps=steps, nthread=nthread, hardware=hardware)
    with ExitStack() as stack:
        envs = [make_scenario_env(scenario) for scenario in scenarios]
        for env in envs:
            stack.enter_context(closing(env))
            policy.check_compatible(env.robot, env.dt)
        current = [reset_episodes(env, seeds, None) for env in envs]
        policy.reset(num_envs=len(envs) * len(seeds), seed=0)
        for recorder, step in zip(recorders, current, strict=True):
            recorder(step)
        active = list(range(len(envs)))
        while active:
            actions = np.split(policy.act(np.concatenate([step.observation for step in current])), len(envs))
            for index in active.copy():
                current[index], ended = advance(current[index], actions[index])
                recorders[index](current[index])
                if ended:  # its robots stay as they are
                    active.remove(index)
    return [recorder.episodes() for recorder in recorders]


def compare_parameters(
    name: str,
    in_force: Parameters,
    outcome: Parameters,
    scenario_names: Sequence[str],
    seeds: Seeds,
    threads: int = 1,
    hardware: HardwareConfig = IDEAL,
) -> tuple[list[tuple[str, str, Measures]], Floats]:
    """Run a policy with old and new parameters on the same full episodes, on the ground of the validation.

    Args:
        name: Name of the policy.
        in_force: Parameters before.
        outcome: Parameters after.
        scenario_names: Scenarios.
        seeds: Seeds of the episodes.
        threads: Threads of the simulation.
        hardware: Hardware of the robots.

    Returns:
        walks: Scenario, `before` or `after`, and measures of the episodes.
        differences: Cost after minus cost before, mean over the scenarios, of each seed, (seeds,).
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
