"""Several policies combined into one policy: each controls a part of the robots of a batch."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats, Policy
from quad_env.robots.robot import Robot
from quad_env.sensing.height_scan import table_with

FALLEN_GRAVITY = -0.2
"""z component of the unit gravity vector in the base frame above which a robot counts as fallen.

The value is -1 for an upright robot. The limit corresponds to a tilt of 78°."""


class PolicyStack(Policy):
    """Several policies, the members, combined into one: each controls an equal number of robots of the batch.

    A row of the observation belongs to one robot. The rows form equal blocks, for example one block per scenario. Each
    block is divided into equal ranges of adjacent rows, one range for each member, in the order of the members. The
    parameter search and the diagnosis of network policies use this class, because one large batch simulates faster than
    several small ones.

    Args:
        members: Policies with the same joints, control period and height scan.
        blocks: Number of equal blocks of rows.
        replace_nonfinite: True: replace NaN and infinite joint targets by finite numbers. The robots of a network with
            numeric overflow then fall.
        idle_when_fallen: True: do not call a member while all its robots have fallen. Their joint targets are then the
            home pose.
        robot: Robot of the combined policy; the robot of the first member by default. Pass a robot if the members use
            different servo gains.
    """

    name = "stack"

    def __init__(
        self,
        members: Sequence[Policy],
        blocks: int = 1,
        replace_nonfinite: bool = False,
        *,
        idle_when_fallen: bool = False,
        robot: Robot | None = None,
    ) -> None:
        first = members[0]
        super().__init__(robot=first.robot if robot is None else robot, control_period=first.control_period)
        self.height_scan = first.height_scan
        self.observations = first.observations
        self._members = members
        self._blocks = blocks
        self._replace_nonfinite_targets = replace_nonfinite
        self._idle_when_fallen = idle_when_fallen
        self._gravity_z = table_with(self.robot, self.height_scan).slices["projected_gravity"].stop - 1

    def _allocate(self, num_envs: int) -> None:
        for member in self._members:
            member.reset(num_envs // len(self._members))

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        rows = np.arange(len(observation)).reshape(self._blocks, len(self._members), -1)
        actions = np.empty((len(observation), self.robot.num_joints), np.float32)
        for index, member in enumerate(self._members):
            share = rows[:, index].ravel()
            actions[share] = self._member_action(member, observation[share])
        return np.nan_to_num(actions) if self._replace_nonfinite_targets else actions

    def _member_action(self, member: Policy, observation: NDArray[np.float32]) -> Actions | Floats:
        """Return the joint targets of a member for its k robots, (k, 12), rad.

        If the member is not called because all its robots have fallen, the result is the home pose, (12,), rad.
        """
        if self._idle_when_fallen and (observation[:, self._gravity_z] > FALLEN_GRAVITY).all():
            return self.robot.home_pose
        return member.act(observation)
