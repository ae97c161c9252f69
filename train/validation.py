"""Validation of a policy during training: an evaluation on seeds that training and final evaluation never use."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from evaluate.hardware import HardwareConfig
from evaluate.measures.metrics import summarise
from evaluate.rollouts.rollout import run
from policies.base import Policy
from quad_env.cli.format import whole_percent
from quad_env.seeding import episode_seeds
from train.config import ValidationConfig
from train.curriculum import with_terrain_seed

Results = Mapping[str, Mapping[str, float]]
"""Type of the results of a validation: scenario name -> metric name -> mean of the metric over the episodes."""
VALIDATION_SEED = 0
"""Seed of the validation episodes. The seed is the same in every run, so that runs can be compared."""
YAW_WEIGHT = 0.5
"""Weight of the yaw-rate error in the score of a validation, relative to the velocity error, m/s per rad/s."""


def validate(
    policy: Policy,
    config: ValidationConfig,
    nthread: int,
    hardware: HardwareConfig,
    hardware_profile: Policy | None = None,
) -> dict[str, dict[str, float]]:
    """Evaluate a policy on the validation episodes of each scenario.

    Args:
        policy: Policy to evaluate.
        config: Validation settings: names of the scenarios and number of episodes per scenario.
        nthread: Number of simulation threads.
        hardware: Robot, servo gains, motor model, sensors and estimator.
        hardware_profile: Variant of the policy for scenarios with the robot's hardware profile, which are the motors,
            delays and sensors of the real robot. None: `policy` controls the robots on these scenarios too.

    Returns:
        Name of the scenario -> name of the metric -> mean over the episodes.
    """
    seeds = episode_seeds("validation", VALIDATION_SEED, config.episodes)
    run_scenario = partial(run, seeds=seeds, nthread=nthread, hardware=hardware)
    results = dict[str, dict[str, float]]()
    for name in config.scenarios:
        scenario = with_terrain_seed(name, "validation", robot=hardware.robot_model)
        profile_policy = hardware_profile if hardware_profile and scenario.hardware else policy
        results[name] = summarise(run_scenario(profile_policy, scenario))
    return results


def validation_record(steps: int, results: Results) -> dict[str, Any]:
    """Return a validation as it is stored in the list of the validations of a run.

    Args:
        steps: Number of learner steps, or of labels in a distillation, at the validation.
        results: Scenario name -> metric name -> mean over the episodes.

    Returns:
        Dictionary with the keys "steps", "success", "score", "cost_of_transport" and "scenarios".
    """
    return {
        "steps": steps,
        "success": mean_success_rate(results),
        "score": mean_score(results),
        "cost_of_transport": total_cost_of_transport(results),
        "scenarios": results,
    }


def best_validation(validations: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
    """Return the best of the `validations` of a run by `ranking_key`, the earliest if several are equal."""
    return min(validations, key=lambda validation: ranking_key(validation["scenarios"]))


def describe_validation(validation: Mapping[str, Any]) -> str:
    """Describe a `validation` in one line: success on all scenarios and on each, and cost of transport."""
    results: Results = validation["scenarios"]
    rates = ", ".join(f"{name} {whole_percent(means['success_rate'])}" for name, means in results.items())
    success = whole_percent(validation["success"])
    return f"{success} succeed ({rates}), cost of transport {validation['cost_of_transport']:.2f}"


def ranking_key(results: Results) -> tuple[float, float]:
    """Return the sort key of a validation result: fraction of failed episodes, then mean score; smaller is better."""
    return 1.0 - mean_success_rate(results), mean_score(results)


def mean_success_rate(results: Results) -> float:
    """Return the fraction of successful episodes in a validation, from 0 to 1, averaged over the scenarios."""
    return sum(means["success_rate"] for means in results.values()) / len(results)


def total_cost_of_transport(results: Results) -> float:
    """Return the cost of transport over all scenarios of a validation: total energy / total (weight * distance).

    The cost is dimensionless, and NaN if no robot moved.
    """
    energy = sum(means["energy"] for means in results.values())
    moved_weight = sum(
        means["energy"] / cost for means in results.values() if (cost := means["cost_of_transport"]) > 0.0
    )
    return energy / moved_weight if moved_weight else float("nan")


def mean_score(results: Results) -> float:
    """Return the tracking score of a validation, averaged over the scenarios, m/s; smaller is better.

    The score of a scenario is the velocity error (m/s) + `YAW_WEIGHT` * the yaw-rate error (rad/s). After a fall, every
    remaining step of the episode has the largest possible error.
    """
    errors = [means["velocity_error"] + YAW_WEIGHT * means["yaw_rate_error"] for means in results.values()]
    return sum(errors) / len(errors)
