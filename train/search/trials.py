"""Trials of a search: episodes of many candidates on many scenarios at once, and what an episode costs."""

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
"""Scenarios simulated at once in a comparison: the more, the faster, and the more memory their records take."""
Seeds = NDArray[np.int64]


class SaturatingCost(NamedTuple):
    """Cost of a measure: none up to one value, half of `most` where it is beyond by `scale`, and ever nearer to it."""

    maximum: float
    threshold: float
    scale: float


OUTCOME_COSTS = dict(zip(OUTCOMES, (0.0, 1.0, 1.5, 2.0, 2.0, 2.0), strict=True))
"""Cost of an episode's outcome; the graded costs on top add up to what a failure costs at least."""
DEVIATION_COST, MAX_DEVIATION = 0.1, 4.0
"""Graded cost of the worst command interval at most, and the deviation, per allowed deviation, at which it is that."""
GRADES = {
    "velocity_error": SaturatingCost(0.05, 0.0, 0.3),
    "overspeed": SaturatingCost(0.05, 0.0, 0.05),
    "cost_of_transport": SaturatingCost(0.4, 0.0, 1.0),
    "flight": SaturatingCost(0.1, 0.0, 0.1),
    "step_rate": SaturatingCost(0.1, 2.0, 2.0),
    "touchdown_impulse": SaturatingCost(0.05, 0.0, 0.03),
    "trunk_height": SaturatingCost(0.15, 0.85, -0.1),
}
"""Graded cost of each measure that has one, in its unit; of what does not exist, the most: the robot fell at once."""
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
"""The cost in words."""


def episode_costs(measures: Measures) -> Floats:
    """Cost of each episode, (episodes,): of its outcome, of how far it was from a better one, and of its effort."""
    total = np.array([OUTCOME_COSTS[each] for each in measures.outcome])
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
    """Records of episodes from those seeds on each scenario, on ground of that purpose, of the policy of that name with
    each candidate's parameters, candidate after candidate."""
    found = dict[str, Episodes]()
    for real in (False, True):
        if names := [each for each in scenario_names if each.endswith(HARDWARE) == real]:
            members = [hardware.policy(name, on_hardware_profile=real, parameters=each) for each in candidates]
            stack = PolicyStack(members, len(names))
            scenarios = [with_terrain_seed(each, purpose, robot=hardware.robot_model) for each in names]
            every_seed = np.tile(seeds, len(candidates))
            walks = run_each(stack, scenarios, every_seed, nthread=threads, steps=steps, hardware=hardware)
            found |= dict(zip(names, walks, strict=True))
    return [found[each] for each in scenario_names]


def run_each(
    policy: Policy,
    scenarios: Sequence[str | Scenario],
    seeds: Seeds,
    *,
    nthread: int = 1,
    steps: int = STEPS,
    hardware: HardwareConfig = IDEAL,
) -> list[Episodes]:
    """The records of one episode for each seed on each of the scenarios, all walked side by side.

    The policy acts for all at once, scenario after scenario: for one whose time hardly depends on how many robots it
    moves that is many times faster. What is the policy's own, such as its phase, is not in the records.
    """
    recorders = [EpisodeRecorder(None, seeds, steps) for _ in scenarios]
    with ExitStack() as stack:
        batch = partial(make_env, policy, count=len(seeds), steps=steps, nthread=nthread, hardware=hardware)
        envs = [batch(scenario) for scenario in scenarios]
        for env in envs:
            stack.enter_context(closing(env))
            policy.check_compatible(env.robot, env.dt)
        now = [reset_episodes(env, seeds, None) for env in envs]
        policy.reset(num_envs=len(envs) * len(seeds), seed=0)
        for recorder, step in zip(recorders, now, strict=True):
            recorder(step)
        active = list(range(len(envs)))
        while active:
            actions = np.split(policy.act(np.concatenate([step.observation for step in now])), len(envs))
            for number in active.copy():
                now[number], ended = advance(now[number], actions[number])
                recorders[number](now[number])
                if ended:  # its robots stay as they are
                    active.remove(number)
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
    """The policy of that name with both parameters on the same full episodes of those seeds, on ground of the
    validation: scenario, `before` for the parameters in force or `after`, and measures of each walk; cost of the
    outcome less that of those in force, mean over the scenarios, of each seed, (seeds,)."""
    walks: list[tuple[str, str, Measures]] = []
    differences = np.zeros(len(seeds))
    groups = [
        scenario_names[first : first + SCENARIOS_PER_BATCH]
        for first in range(0, len(scenario_names), SCENARIOS_PER_BATCH)
    ]
    for group in track(groups, description="comparison"):
        before, after = (
            map(measure, run_candidates(name, [each], group, seeds, "validation", threads=threads, hardware=hardware))
            for each in (in_force, outcome)
        )
        for exercise, old, new in zip(group, before, after, strict=True):
            walks += [(exercise, "before", old), (exercise, "after", new)]
            differences += episode_costs(new) - episode_costs(old)
    return walks, differences / len(scenario_names)
