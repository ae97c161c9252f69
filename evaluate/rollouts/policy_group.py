"""Rollout of several policies on several scenarios together, in which each policy controls its own rows.

The robots of a scenario are one batch, and a policy acts on its robots of all scenarios in one call. Both are faster
than several small batches. The episodes of each policy are bit-identical to the episodes of a rollout of this policy
alone on this scenario.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluate.hardware import IDEAL, HardwareConfig, ServosByRow
from evaluate.measures.episodes import Episodes
from evaluate.rollouts import rollout
from policies.base import Floats, Policy
from quad_env.cli.launcher import is_out_of_memory
from quad_env.envs.arguments import check_joint_targets
from quad_env.robots.robot import Robot
from quad_env.scenarios.scenario import Scenario


class GroupEntry(NamedTuple):
    """Episodes of one policy on one scenario that a group simulates."""

    policy: Policy
    """Policy that controls the robots. Several entries may have the same object."""
    scenario: Scenario
    """Scenario of the episodes."""
    seeds: NDArray[np.int64]
    """Seeds of the n episodes, (n,)."""


@dataclass
class GroupMember:
    """Policy of a group, with its rows and the state of its episodes."""

    policy: Policy
    rows: NDArray[np.int64]
    """Indices of the k rows (robots of all scenarios) that the policy controls, (k,)."""
    error: Exception | None = None
    """Exception that the policy has raised; None if it has raised none."""
    has_fallen: bool = False
    """True if all robots of the policy have fallen, or have a diverged simulation."""

    @property
    def is_active(self) -> bool:
        """True if the policy is called in the next control step."""
        return self.error is None and not self.has_fallen

    @contextmanager
    def record_error(self) -> Iterator[None]:
        """Return a context that records an exception of the policy; a lack of memory is raised."""
        try:
            yield
        except Exception as error:
            if is_out_of_memory(error):
                raise
            self.error = error


class PolicyGroup(Policy):
    """Several policies (members) that run as one policy; each member controls its own robots.

    The robots of a member that raises an exception get the home pose as joint targets, and the other members go on. A
    member is not called any more when all of its robots have fallen.

    Args:
        policies: Members, with the same robot except for the servo gains, and with the same control period, height scan
            and observation terms.
        rows: Indices of the k rows (robots) of each member, (k,).
        robot: Robot of the group. Its servo gains have no effect.
    """

    name = "group"

    def __init__(self, policies: Sequence[Policy], rows: Sequence[NDArray[np.int64]], robot: Robot) -> None:
        first = policies[0]
        super().__init__(robot=robot, control_period=first.control_period)
        self.height_scan = first.height_scan
        self.observations = first.observations
        self.members = [GroupMember(policy, own_rows) for policy, own_rows in zip(policies, rows, strict=True)]

    @property
    def stopped(self) -> NDArray[np.bool_] | None:
        """True for robots that the safety layer of their policy stops, (n,); None if no member has a safety layer."""
        masks = [getattr(member.policy, "stopped", None) for member in self.members]
        if all(mask is None for mask in masks):
            return None
        stopped = np.zeros(self.num_envs, np.bool_)
        for member, mask in zip(self.members, masks, strict=True):
            stopped[member.rows] = False if mask is None else mask
        return stopped

    def check_compatible(self, robot: Robot, control_period: float) -> None:
        """Check that each member fits an environment, in which it has its own servo gains.

        The error of a member is recorded, not raised.

        Args:
            robot: Robot of the environment.
            control_period: Control period of the environment, s.
        """
        for member in self.members:
            with member.record_error():
                member.policy.check_compatible(robot.with_servo(*member.policy.robot.gains), control_period)

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Reset each member for its robots, each at the start of an episode.

        Args:
            num_envs: Number of robots of all members.
            seed: Seed for policies that draw random numbers.
        """
        super().reset(num_envs, seed)
        for member in self.members:
            with member.record_error():
                member.policy.reset(num_envs=len(member.rows), seed=seed)

    def observe(self, has_fallen: NDArray[np.bool_]) -> bool:
        """Record which members have no more robots to control.

        Args:
            has_fallen: True for robots that have fallen, or that have a diverged simulation, (n,).

        Returns:
            True if no member has any robots to control.
        """
        for member in self.members:
            member.has_fallen = bool(has_fallen[member.rows].all())
        return not any(member.is_active for member in self.members)

    def _act(self, observation: NDArray[np.float32]) -> Floats:  # type: ignore[override]
        robot = self.robot
        # The targets have double precision, because a user's policy may compute them in double precision.
        targets = np.tile(robot.home_pose, (len(observation), 1))
        for member in self.members:
            if member.is_active:
                rows = member.rows
                with member.record_error():
                    actions = member.policy.act(observation[rows])
                    targets[rows] = check_joint_targets(
                        actions, targets[rows].shape, robot.joint_lower, robot.joint_upper
                    )
        return targets

    def _replace_nonfinite(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        return rows


class _ScenarioBatch:
    """Rows of all policies on one scenario.

    Args:
        entries: Index of an entry -> policy with scenario and seeds, in the order of the robots. All have the same
            scenario.
        first_row: Index of the first robot among the robots of all scenarios.
        hardware: Names of robot, servo gains, motor model, sensor model, state estimator and simulator.
    """

    def __init__(self, entries: Mapping[int, GroupEntry], first_row: int, hardware: HardwareConfig) -> None:
        counts = [len(entry.seeds) for entry in entries.values()]
        ends = np.cumsum(counts).tolist()
        self.rows = slice(first_row, first_row + ends[-1])
        """Range of the robots among the robots of all scenarios."""
        self.entry_rows = {
            index: slice(end - count, end) for index, count, end in zip(entries, counts, ends, strict=True)
        }
        """Index of an entry -> range of its robots in this batch."""
        gains = np.repeat(np.array([entry.policy.robot.gains for entry in entries.values()]), counts, axis=0)
        self.servos = ServosByRow(**vars(hardware), gains=gains.transpose(1, 0, 2))
        seeds = np.concatenate([entry.seeds for entry in entries.values()])
        self.episodes = rollout.ScenarioEpisodes(next(iter(entries.values())).scenario, seeds, self.servos)
        """Scenario and seeds of all robots."""


def run_group(
    entries: Sequence[GroupEntry],
    *,
    nthread: int = 1,
    steps: int,
    progress: rollout.Progress = lambda _: None,
    hardware: HardwareConfig = IDEAL,
) -> list[Episodes | Exception]:
    """Run episodes of several policies on several scenarios together, and record the signals of all control steps.

    Args:
        entries: Policies with scenarios and seeds. No policy object occurs twice on one scenario. The policies need the
            same environment except for the servo gains.
        nthread: Number of threads with which the robots are simulated.
        steps: Maximum number of control steps of an episode.
        progress: Function that receives the finished fraction, 0 … 1.
        hardware: Names of robot, servo gains, motor model, sensor model, state estimator and simulator.

    Returns:
        For each entry its recorded episodes, or the exception that its policy has raised.
    """
    batches = _make_batches(entries, hardware)
    group = _make_group(entries, batches)
    recorded = rollout.run_scenarios(
        group,
        [batch.episodes for batch in batches],
        nthread=nthread,
        steps=steps,
        progress=progress,
        observe_falls=group.observe,
    )
    members = {id(member.policy): member for member in group.members}
    results: dict[int, Episodes | Exception] = {}
    for batch, episodes in zip(batches, recorded, strict=True):
        for index, rows in batch.entry_rows.items():
            results[index] = _result(members[id(entries[index].policy)], rows, episodes)
    return [results[index] for index in range(len(entries))]


def _make_batches(entries: Sequence[GroupEntry], hardware: HardwareConfig) -> list[_ScenarioBatch]:
    """Return a batch for each scenario of the `entries`, in the order of their first entries."""
    by_scenario: dict[int, dict[int, GroupEntry]] = {}
    for index, entry in enumerate(entries):
        by_scenario.setdefault(id(entry.scenario), {})[index] = entry
    batches: list[_ScenarioBatch] = []
    for entries_by_index in by_scenario.values():
        first_row = batches[-1].rows.stop if batches else 0
        batches.append(_ScenarioBatch(entries_by_index, first_row, hardware))
    return batches


def _make_group(entries: Sequence[GroupEntry], batches: Sequence[_ScenarioBatch]) -> PolicyGroup:
    """Return the policies of all `entries` as one policy for the robots of all `batches`."""
    policies: dict[int, Policy] = {}
    rows: dict[int, list[NDArray[np.int64]]] = {}
    for batch in batches:
        for index, own_rows in batch.entry_rows.items():
            policy = entries[index].policy
            policies[id(policy)] = policy
            first_row = batch.rows.start
            rows.setdefault(id(policy), []).append(np.arange(first_row + own_rows.start, first_row + own_rows.stop))
    robot = batches[0].servos.mean_robot()
    return PolicyGroup(list(policies.values()), [np.concatenate(rows[key]) for key in policies], robot)


def _result(member: GroupMember, rows: slice, episodes: Episodes) -> Episodes | Exception:
    """Return the episodes in the `rows` of a `member` on a scenario, or the exception that it has raised."""
    if member.error is not None:
        return member.error
    selected = episodes.select(rows, episodes.robot.with_servo(*member.policy.robot.gains))
    has_signal = getattr(member.policy, "stopped", None) is not None
    return selected if has_signal else selected.without_policy_signals()
