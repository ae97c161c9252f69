"""Several policies combined into one policy; each policy controls some robots of a batch."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats, Policy
from quad_env.robots.robot import Robot
from quad_env.sensing.height_scan import table_with

FALLEN_GRAVITY = -0.2
"""z component of the unit gravity vector in the base frame above which a robot counts as fallen.

The component is -1 for an upright robot. The limit corresponds to a tilt of the trunk of 78°."""


class PolicyStack(Policy):
    """Several policies (members) combined into one policy; each member controls equally many robots.

    A row of the observation belongs to one robot. The rows form blocks of equal size, for example one block per
    scenario. In each block, the first rows belong to the first member, the next rows to the second member, and so on.
    All members have the same number of rows.

    The parameter search and the diagnosis of network policies use this class, because one large batch is simulated
    faster than several small batches.

    Args:
        members: Policies with the same joints, control period and height scan.
        blocks: Number of blocks of rows, which have equal size.
        replace_nonfinite: True: replace NaN and infinite joint targets by finite numbers. The robots of a network with
            a numeric overflow then fall, and the simulation goes on.
        idle_when_fallen: True: do not call a member if all its robots have fallen. The joint targets of these robots
            are then the home pose.
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

        `observation`, (k, m), is the observation of these robots, with m numbers per robot. If all k robots have fallen
        and the option `idle_when_fallen` is True, the result is the home pose, (12,), rad.
        """
        if self._idle_when_fallen and (observation[:, self._gravity_z] > FALLEN_GRAVITY).all():
            return self.robot.home_pose
        return member.act(observation)
