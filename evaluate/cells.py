"""Data classes of a comparison of policies: labelled policies, tasks, chunks and cells.

A cell is the result of one policy on one scenario: all of its measured episodes. A chunk is a subset of these episodes
that are simulated together.
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
    """A policy with the label that names it in every result: the name or path that the user gave."""

    label: str
    policy: Policy
    """Policy that runs on every scenario.

    If `hardware_policy` exists, it runs instead on the scenarios with the hardware profile.
    """
    only_on: tuple[str, ...] = ()
    """Names of the scenarios that the policy is restricted to; empty if it runs on all scenarios."""
    hardware_policy: Policy | None = None
    """The same policy, made for the robot's hardware profile (models of the real motors and sensors).

    It is None if `policy` runs on all scenarios.
    """

    def runs_on(self, scenario: Scenario) -> bool:
        """Return True if the policy runs on the scenario."""
        return not self.only_on or scenario.name in self.only_on

    def policy_for(self, scenario: Scenario) -> Policy:
        """Return the policy for a scenario: `hardware_policy` if it exists and the scenario needs it."""
        return self.hardware_policy if scenario.hardware and self.hardware_policy is not None else self.policy

    @property
    def variants(self) -> tuple[Policy, ...]:
        """The policy objects with this label: `policy`, and `hardware_policy` if it exists."""
        return (self.policy,) if self.hardware_policy is None else (self.policy, self.hardware_policy)


def load_labelled_policy(
    label: str,
    hardware: HardwareConfig,
    scenarios: Sequence[Scenario],
    trust: bool = False,
    only_on: Sequence[str] = (),
) -> LabelledPolicy:
    """Load a policy, and load it again for the hardware profile if its scenarios need both versions.

    The hardware profile of a robot models the motors, sensors and delays of the real robot.

    Args:
        label: Name or path of the policy.
        hardware: Hardware of the robots in scenarios that do not use the hardware profile.
        scenarios: Scenarios of the run, with or without the hardware profile.
        trust: True to load files that can contain hidden code.
        only_on: Names of the scenarios that the policy runs on; empty for all scenarios.

    Returns:
        The labelled policy. An external policy is loaded only once, because it has its own process and servo gains.
    """
    profiles = {scenario.hardware for scenario in scenarios if not only_on or scenario.name in only_on}
    policy = hardware.policy(label, trust, on_hardware_profile=profiles == {True})
    hardware_policy = None
    if len(profiles) > 1 and not isinstance(policy, ExternalPolicy):
        hardware_policy = hardware.policy(label, trust, on_hardware_profile=True)
    return LabelledPolicy(label, policy, tuple(only_on), hardware_policy)


@dataclass(frozen=True)
class PolicyScenarioResult:
    """Result of one policy on one scenario (a cell of the results): all measured episodes.

    All policies run a scenario with the same seeds, so that policies can be compared episode by episode.
    """

    policy: str
    """Label of the policy: the name or path that the user gave."""
    scenario: Scenario
    seeds: NDArray[np.int64]
    """Seeds of the episodes, (n,)."""
    fall_reason: NDArray[np.object_]
    """Reason for the fall in each episode, (n,).

    It is the name of the fall rule, `diverged` if the simulation became unstable, or None if the robot did not fall.
    """
    measures: Measures
    failure: NDArray[np.object_]
    """Error with which the policy failed in each episode, (n,); None if the policy did not fail."""

    @property
    def episodes(self) -> int:
        """Number of episodes, n."""
        return len(self.seeds)


@dataclass(frozen=True)
class EpisodeChunk:
    """Result of some episodes of one policy on one scenario that were simulated together.

    It is stored as one file, so that an interrupted run continues after the last stored chunk.
    """

    episode_indices: NDArray[np.int64]
    """Indices of these episodes among all episodes of the policy on the scenario, (n,)."""
    cell: PolicyScenarioResult
    """Result of the policy on the scenario that contains only these episodes."""


@dataclass(frozen=True)
class Task:
    """Episodes of one policy on one scenario to simulate together, with all inputs of the simulation."""

    policy: LabelledPolicy
    scenario: Scenario
    episode_indices: NDArray[np.int64]
    """Indices of these episodes among all episodes of the policy on the scenario, (n,)."""
    seeds: NDArray[np.int64]
    """Seeds of the episodes, (n,)."""
    steps: int
    """Maximum number of control steps of an episode."""
    hardware: HardwareConfig


def join(chunks: Sequence[EpisodeChunk]) -> PolicyScenarioResult:
    """Join subsets of the episodes of one policy on one scenario; `chunks` may come in any order."""
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
    """Join the measures that extensions define, over all subsets of episodes of one policy and scenario.

    Args:
        cells: Results of the subsets.
        order: Permutation that sorts the concatenated episodes by index, (n,).

    Returns:
        Name of the measure -> value of each episode, (n,); NaN in the episodes of a subset that lacks the measure.
    """
    names = dict.fromkeys(name for cell in cells for name in cell.measures.extra)
    joined = {}
    for name in names:
        parts = [cell.measures.extra.get(name, np.full(cell.episodes, np.nan)) for cell in cells]
        joined[name] = np.concatenate(parts)[order]
    return joined


def apply_success_rule(cell: PolicyScenarioResult, rule: SuccessRule) -> PolicyScenarioResult:
    """Return a copy of a result with the outcomes of its episodes by another success rule.

    An episode that succeeded before and fails by the new rule gets the outcome `off_command`.

    Args:
        cell: Result of one policy on one scenario, with outcomes by any success rule.
        rule: Success rule to apply.

    Returns:
        The result with new outcomes.
    """
    measures = cell.measures
    has_policy_failure = np.array([reason is not None for reason in cell.failure], np.bool_)
    errors = np.stack([measures.velocity_error, measures.yaw_rate_error], axis=-1)
    is_on_command = rule.on_command(measures.commands, measures.mean_velocities, errors)
    outcome = np.where(measures.succeeded, OFF_COMMAND, measures.outcome)
    outcome[is_on_command & ~measures.fell & ~has_policy_failure] = SUCCEEDED
    return dataclasses.replace(cell, measures=dataclasses.replace(measures, outcome=outcome))


def evaluation_seeds(seed: int, count: int) -> NDArray[np.int64]:
    """Return the seeds of the first `count` evaluation episodes for the run's `seed`, (count,).

    Training and validation never use these seeds.

    Args:
        seed: Evaluation seed of the run.
        count: Number of episodes.

    Returns:
        Seeds of the episodes, (count,).
    """
    return episode_seeds("evaluation", seed, count)
