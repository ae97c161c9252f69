"""Rollout of several policies in one batch of robots, in which each policy controls its own rows.

One large batch is simulated faster than several small batches. The episodes of each policy are bit-identical to the
episodes of a rollout of this policy alone.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluate.hardware import IDEAL, HardwareConfig, ServosByRow
from evaluate.measures.episodes import Episodes
from evaluate.rollouts import rollout
from evaluate.rollouts.observers import Step
from policies.base import Floats, Policy
from quad_env.cli.launcher import is_out_of_memory
from quad_env.envs.arguments import check_joint_targets
from quad_env.robots.robot import Robot
from quad_env.scenarios.scenario import Scenario


@dataclass
class GroupMember:
    """Policy of a group, with the range of its rows and the state of its episodes."""

    policy: Policy
    rows: slice
    """Range of the rows (robots) that the policy controls."""
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
    """Several policies (members) that run as one policy; each member controls its own range of robots.

    The robots of a member that raises an exception get the home pose as joint targets, and the other members go on. A
    member is not called any more when all of its robots have fallen.

    Args:
        policies: Members, with the same robot except for the servo gains, and with the same control period, height scan
            and observation terms.
        counts: Number of robots of each member, in the order of the rows.
        robot: Robot of the group. Its servo gains have no effect.
    """

    name = "group"

    def __init__(self, policies: Sequence[Policy], counts: Sequence[int], robot: Robot) -> None:
        first = policies[0]
        super().__init__(robot=robot, control_period=first.control_period)
        self.height_scan = first.height_scan
        self.observations = first.observations
        ends = np.cumsum(counts).tolist()
        self.members = [
            GroupMember(policy, slice(end - count, end))
            for policy, count, end in zip(policies, counts, ends, strict=True)
        ]

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
                member.policy.reset(num_envs=member.rows.stop - member.rows.start, seed=seed)

    def observe(self, step: Step) -> bool:
        """Record which members have no more robots to control; return True if no member has any.

        The method is an observer of the rollout.
        """
        has_fallen = (step.infos["fall"] > 0) | step.infos["diverged"]
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


def run_group(
    policies: Sequence[Policy],
    scenario: Scenario,
    seeds: Sequence[NDArray[np.int64]],
    *,
    nthread: int = 1,
    steps: int,
    progress: rollout.Progress = lambda _: None,
    hardware: HardwareConfig = IDEAL,
) -> list[Episodes | Exception]:
    """Run episodes of several policies in one batch of robots, and record the signals of all control steps.

    Args:
        policies: Different policy objects, which need the same environment except for the servo gains.
        scenario: Scenario of all episodes.
        seeds: Seeds of the episodes of each policy.
        nthread: Number of threads with which the robots are simulated.
        steps: Maximum number of control steps of an episode.
        progress: Function that receives the finished fraction, 0 … 1.
        hardware: Names of robot, servo gains, motor model, sensor model, state estimator and simulator.

    Returns:
        For each policy its recorded episodes, or the exception that it has raised.
    """
    counts = [len(each) for each in seeds]
    gains = np.repeat(np.array([policy.robot.gains for policy in policies]), counts, axis=0).transpose(1, 0, 2)
    servos = ServosByRow(**vars(hardware), gains=gains)
    group = PolicyGroup(policies, counts, servos.mean_robot())
    episodes = rollout.run(
        group,
        scenario,
        np.concatenate(seeds),
        nthread=nthread,
        steps=steps,
        progress=progress,
        hardware=servos,
        observers=(group.observe,),
    )
    return [_result(member, episodes) for member in group.members]


def _result(member: GroupMember, episodes: Episodes) -> Episodes | Exception:
    """Return the episodes of a `member` among the `episodes` of its group, or the exception that it has raised."""
    if member.error is not None:
        return member.error
    selected = episodes.select(member.rows, episodes.robot.with_servo(*member.policy.robot.gains))
    has_signal = getattr(member.policy, "stopped", None) is not None
    return selected if has_signal else selected.without_policy_signals()
