"""What reaches the servos of n robots: their targets, late, or none at all."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array, Mask, Rows
from quad_env.robots.robot import Robot
from quad_env.scenarios.episode import Episode, control_steps
from quad_env.scenarios.scenario import Scenario


class ActionDelay:
    """The way of the targets from n policies to the servos; `clock` is each robot's control steps since its start."""

    def __init__(self, robot: Robot, scenario: Scenario, num_envs: int, dt: float) -> None:
        self._home = robot.home_pose
        late = 0 if scenario.latency is None else round(scenario.latency.action / dt)
        self._sent = np.zeros((late + 1, num_envs, robot.num_joints))
        """Targets of the last steps: that of clock c is at c modulo its length."""
        self._received = np.zeros((num_envs, robot.num_joints))
        dropouts = scenario.dropouts
        count = 0 if dropouts is None else dropouts.count
        self._lost_from = np.zeros((num_envs, count), np.int64)
        self._lost_for = 0 if dropouts is None else control_steps(dropouts.duration, dt)
        self._lost_joint = np.zeros((num_envs, count), np.int64)

    def begin(self, rows: Rows, episodes: Sequence[Episode]) -> None:
        """Start these episodes of those robots, their servos at home."""
        self._sent[:, rows] = self._received[rows] = self._home
        for row, episode in zip(rows, episodes, strict=True):
            if (plan := episode.dropouts) is not None:
                self._lost_from[row], self._lost_joint[row] = plan.first_step, plan.joint

    def received(self, targets: Array, clock: NDArray[np.int64], rows: Rows) -> Array:
        """Targets that the servos go by in the coming step, of all robots, (n, 12), rad; those of `rows` move on.

        `targets`, (n, 12), rad, are what the policies ask for now; `clock`, (k,), is that of `rows`.
        """
        slots = len(self._sent)
        self._sent[clock % slots, rows] = targets[rows]
        arriving = self._sent[(clock + 1) % slots, rows]
        if self._lost_for:
            self._received[rows] = np.where(self._lost(clock, rows), self._received[rows], arriving)
        else:
            self._received[rows] = arriving
        return self._received

    def _lost(self, clock: NDArray[np.int64], rows: Rows) -> Mask:
        """Which joints of those robots hear nothing in the coming step, (k, 12)."""
        since = clock[:, None] - self._lost_from[rows]
        lost = np.zeros((len(rows), self._received.shape[1]), np.bool_)
        robot, event = np.nonzero((since >= 0) & (since < self._lost_for))
        lost[robot, self._lost_joint[rows[robot], event]] = True
        return lost


def action_delay_of(robot: Robot, scenario: Scenario, num_envs: int, dt: float) -> ActionDelay | None:
    """The robots' action_delay, or None where targets reach the servos at once and always."""
    late = scenario.latency is not None and round(scenario.latency.action / dt) > 0
    lost = scenario.dropouts is not None and scenario.dropouts.count > 0
    return ActionDelay(robot, scenario, num_envs, dt) if late or lost else None
