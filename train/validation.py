"""Evaluation of a policy during training, by the code of `evaluate`, on seeds of its own."""

from collections.abc import Mapping
from functools import partial

from evaluate.hardware import HardwareConfig
from evaluate.measures.metrics import summarise
from evaluate.rollouts.rollout import run
from policies.base import Policy
from quad_env.seeding import episode_seeds
from train.config import ValidationConfig
from train.curriculum import with_terrain_seed

Results = Mapping[str, Mapping[str, float]]
"""Mean metrics of each scenario, scenario -> name -> value."""
VALIDATION_SEED = 0
"""The same episodes in every run, so that runs compare."""
YAW_WEIGHT = 0.5
"""m/s of velocity error that a rad/s of yaw-rate error counts as."""


def validate(
    policy: Policy,
    config: ValidationConfig,
    nthread: int,
    hardware: HardwareConfig,
    hardware_profile: Policy | None = None,
) -> dict[str, dict[str, float]]:
    """Mean metrics of each scenario on robots with that hardware, scenario -> name -> value.

    `real`: the same policy as it is made for scenarios on the hardware profile, where that differs.
    """
    seeds = episode_seeds("validation", VALIDATION_SEED, config.episodes)
    walk = partial(run, seeds=seeds, nthread=nthread, hardware=hardware)
    scenarios = {name: with_terrain_seed(name, "validation", robot=hardware.robot_model) for name in config.scenarios}
    return {
        name: summarise(walk(hardware_profile if hardware_profile and each.hardware else policy, each))
        for name, each in scenarios.items()
    }


def ranking_key(results: Results) -> tuple[float, float]:
    """Order of policies, the smallest is best: share of failed episodes, and where these are equal the score."""
    return 1.0 - mean_success_rate(results), mean_score(results)


def mean_success_rate(results: Results) -> float:
    """Share of the episodes that succeed, mean over scenarios."""
    return sum(means["success_rate"] for means in results.values()) / len(results)


def total_cost_of_transport(results: Results) -> float:
    """Cost of transport over all scenarios, a quotient of sums; NaN where nothing was carried anywhere."""
    energy = sum(means["energy"] for means in results.values())
    carried = sum(means["energy"] / cost for means in results.values() if (cost := means["cost_of_transport"]) > 0.0)
    return energy / carried if carried else float("nan")


def mean_score(results: Results) -> float:
    """Velocity error plus half the yaw-rate error, m/s, mean over scenarios; each step after a fall has the largest."""
    errors = [means["velocity_error"] + YAW_WEIGHT * means["yaw_rate_error"] for means in results.values()]
    return sum(errors) / len(errors)
