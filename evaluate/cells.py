"""Data classes of an evaluation: policies with labels, tasks to simulate, and measured episodes.

A cell is a policy-scenario pair with its measured episodes. A chunk is a subset of these episodes that are simulated
together. A task is the input of the simulation of one chunk.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.hardware import HardwareConfig
from evaluate.measures.metrics import MEASURE_NAMES, Measures
from evaluate.measures.outcomes import OFF_COMMAND, SUCCEEDED, SuccessRule
from policies.base import Policy
from policies.external import ExternalPolicy
from quad_env.scenarios.registry import Scenario
from quad_env.seeding import episode_seeds


@dataclass(frozen=True)
class LabelledPolicy:
    """A policy with the label that names it in every result of the evaluation."""

    label: str
    """Name or path of the policy, as the user gave it on the command line."""
    policy: Policy
    """Policy object that runs on the scenarios without the hardware profile.

    It also runs on the scenarios with the hardware profile if `hardware_policy` is None.
    """
    only_on: tuple[str, ...] = ()
    """Names of the scenarios that the policy is restricted to; empty if the policy runs on all scenarios."""
    hardware_policy: Policy | None = None
    """Second object of the same policy, made for the scenarios with the hardware profile of the robot.

    The hardware profile consists of models of the robot's real motors and sensors. The value is None if the object
    `policy` runs on all scenarios.
    """

    def runs_on(self, scenario: Scenario) -> bool:
        """Return True if the evaluation runs this policy on the `scenario`, as `only_on` specifies."""
        return not self.only_on or scenario.name in self.only_on

    def policy_for(self, scenario: Scenario) -> Policy:
        """Return the policy object that runs on a `scenario`.

        It is `hardware_policy` if this object exists and the scenario has the hardware profile (models of the robot's
        real motors and sensors). Otherwise it is `policy`.
        """
        return self.hardware_policy if scenario.hardware and self.hardware_policy is not None else self.policy

    @property
    def variants(self) -> tuple[Policy, ...]:
        """The one or two policy objects with this label: `policy`, and `hardware_policy` if it is not None."""
        return (self.policy,) if self.hardware_policy is None else (self.policy, self.hardware_policy)


def load_labelled_policy(
    label: str,
    hardware: HardwareConfig,
    scenarios: Sequence[Scenario],
    trust: bool = False,
    only_on: Sequence[str] = (),
) -> LabelledPolicy:
    """Load a policy for an evaluation, and a second object of it for the hardware profile if necessary.

    The hardware profile consists of models of the motors, sensors and delays of the real robot. The second object is
    loaded if the policy runs both on scenarios with the hardware profile and on scenarios without it.

    Args:
        label: Name or path of the policy.
        hardware: Robot, motors and sensors with which the scenarios without the hardware profile are simulated.
        scenarios: All scenarios of the evaluation, with or without the hardware profile.
        trust: True to load policy files that can run hidden code while they are loaded.
        only_on: Names of the scenarios that the policy runs on; empty for all scenarios.

    Returns:
        The policy with its label. An external policy (from a user's file, run in a subprocess) is loaded only once,
        because its servo gains do not depend on the hardware profile.
    """
    profiles = {scenario.hardware for scenario in scenarios if not only_on or scenario.name in only_on}
    policy = hardware.policy(label, trust, on_hardware_profile=profiles == {True})
    hardware_policy = None
    if len(profiles) > 1 and not isinstance(policy, ExternalPolicy):
        hardware_policy = hardware.policy(label, trust, on_hardware_profile=True)
    return LabelledPolicy(label, policy, tuple(only_on), hardware_policy)


@dataclass(frozen=True)
class PolicyScenarioResult:
    """Result of one policy on one scenario: the measures and outcomes of n episodes.

    All policies run a scenario with the same seeds, so that policies can be compared episode by episode.
    """

    policy: str
    """Label of the policy: the name or path that the user gave on the command line."""
    scenario: Scenario
    """Scenario of all episodes of this result."""
    seeds: NDArray[np.int64]
    """Seed with which the environment was reset at the start of each episode, (n,)."""
    fall_reason: NDArray[np.object_]
    """Reason for the robot's fall in each of n episodes, as text, (n,).

    It is the name of the condition that ended the episode, for example `trunk_contact`. It is `diverged` if the
    simulation became numerically unstable, and None if the robot did not fall.
    """
    measures: Measures
    """Measures of the n episodes, for example outcome and velocity error, each an array (n, …)."""
    failure: NDArray[np.object_]
    """Error message of the policy in each of n episodes, (n,); None if the policy did not fail.

    A policy fails if it raises an exception, exceeds its time limit, or returns an action that is not finite.
    """

    @property
    def episodes(self) -> int:
        """Number n of episodes in this result."""
        return len(self.seeds)


@dataclass(frozen=True)
class EpisodeChunk:
    """Subset of the episodes of one policy on one scenario that were simulated together.

    The subset (chunk) and its measures are stored in one file. An interrupted evaluation can therefore be resumed: only
    the missing subsets are simulated.
    """

    episode_indices: NDArray[np.int64]
    """Index of each of these n episodes among all episodes of the policy on the scenario, (n,)."""
    cell: PolicyScenarioResult
    """Measures and outcomes of the n episodes in this subset, in the order of `episode_indices`."""


@dataclass(frozen=True)
class Task:
    """Inputs of the simulation of n episodes of one policy on one scenario, which are simulated together.

    Tasks are independent of each other, so they can run in parallel processes.
    """

    policy: LabelledPolicy
    """Policy that controls the robot."""
    scenario: Scenario
    """Scenario of all episodes: the terrain, disturbances and commands."""
    episode_indices: NDArray[np.int64]
    """Index of each of the n episodes to simulate among all episodes of the policy on the scenario, (n,)."""
    seeds: NDArray[np.int64]
    """Seed with which the environment is reset for each of the n episodes, (n,)."""
    steps: int
    """Number of control steps after which an episode ends at the latest (its time limit)."""
    hardware: HardwareConfig
    """Hardware of the simulated robots: robot, servo gains, motors, sensors, estimator and simulator."""


def join(chunks: Sequence[EpisodeChunk]) -> PolicyScenarioResult:
    """Join subsets of the episodes of one policy on one scenario to one result, sorted by episode index.

    Args:
        chunks: Subsets of the episodes, in any order. No two of them have an episode in common.

    Returns:
        The result with the episodes of all subsets.
    """
    order = np.argsort(np.concatenate([chunk.episode_indices for chunk in chunks]))
    cells = [chunk.cell for chunk in chunks]
    measures = {name: np.concatenate([getattr(cell.measures, name) for cell in cells])[order] for name in MEASURE_NAMES}
    extra = _join_extra(cells, order)
    return dataclasses.replace(
        cells[0],
        seeds=np.concatenate([cell.seeds for cell in cells])[order],
        fall_reason=np.concatenate([cell.fall_reason for cell in cells])[order],
        measures=Measures(**measures, extra=extra),
        failure=np.concatenate([cell.failure for cell in cells])[order],
    )


def _join_extra(cells: Sequence[PolicyScenarioResult], order: NDArray[np.intp]) -> dict[str, NDArray[np.float64]]:
    """Join the measures that users have registered in extensions, over all subsets of episodes.

    Args:
        cells: Result of each subset of the episodes of one policy on one scenario.
        order: Permutation that sorts the n concatenated episodes by their index, (n,).

    Returns:
        Name of the measure -> value in each episode, (n,). It is NaN in the episodes of a subset that lacks the
        measure.
    """
    names = dict.fromkeys(name for cell in cells for name in cell.measures.extra)
    joined = {}
    for name in names:
        parts = [cell.measures.extra.get(name, np.full(cell.episodes, np.nan)) for cell in cells]
        joined[name] = np.concatenate(parts)[order]
    return joined


def apply_success_rule(cell: PolicyScenarioResult, rule: SuccessRule) -> PolicyScenarioResult:
    """Return a copy of a result in which another success rule decides which episodes succeed.

    A success rule gives the largest velocity errors of a successful episode. An episode that succeeded before and fails
    by the new rule gets the outcome `off_command`.

    Args:
        cell: Result of one policy on one scenario, with outcomes by any success rule.
        rule: Success rule to apply.

    Returns:
        A copy of `cell` with the new outcome of each episode; all other measures are unchanged.
    """
    measures = cell.measures
    has_policy_failure = np.array([reason is not None for reason in cell.failure], np.bool_)
    errors = np.stack([measures.velocity_error, measures.yaw_rate_error], axis=-1)
    is_on_command = rule.on_command(measures.commands, measures.mean_velocities, errors)
    outcome = np.where(measures.succeeded, OFF_COMMAND, measures.outcome)
    outcome[is_on_command & ~measures.fell & ~has_policy_failure] = SUCCEEDED
    return dataclasses.replace(cell, measures=dataclasses.replace(measures, outcome=outcome))


def evaluation_seeds(seed: int, count: int) -> NDArray[np.int64]:
    """Return the seeds with which an evaluation resets the environment in its first `count` episodes.

    Training, validation and searches for parameters never use these seeds.

    Args:
        seed: Evaluation seed that the user chose with --seed.
        count: Number of episodes.

    Returns:
        Seed of each episode, (count,). A larger `count` gives the same seeds first, and then further ones.
    """
    return episode_seeds("evaluation", seed, count)
