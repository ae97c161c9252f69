"""Schedule of the episodes of n robots: seeds, velocity commands, pushes and elapsed control steps."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array, EnvSelection, Mask
from quad_env.robots.robot import Robot
from quad_env.scenarios.episode import NEVER, EpisodeSample, PushPlan
from quad_env.scenarios.scenario import Scenario
from quad_env.seeding import assign_seeds, fresh_seeds


class EpisodeSchedule:
    """Schedule of the episodes of n robots: starts episodes and supplies commands and pushes of each step.

    Each seed defines a sequence of episodes. A robot that gets a seed runs the episodes of this sequence in order,
    independent of the other robots.

    Args:
        robot: Robot of all episodes.
        scenario: Scenario of all episodes; `set_scenarios` changes it.
        num_envs: Number of robots.
        dt: Control period, s.

    Attributes:
        pushes: Planned pushes on the trunk in the present episode of each robot.
        step_count: Control steps since the start of each robot's episode, (n,).
        command: Velocity command of the next control step, (n, 3): forward and lateral m/s, yaw rate rad/s.
    """

    def __init__(self, robot: Robot, scenario: Scenario, num_envs: int, dt: float) -> None:
        self._robot = robot
        self._scenarios = [scenario] * num_envs
        self._dt = dt
        self._seeds = fresh_seeds(num_envs)
        self._next_number = [0] * num_envs
        self._episodes = [EpisodeSample(robot, scenario, 0, 0, dt)] * num_envs
        plan = self._episodes[0].pushes
        steps = plan.steps if isinstance(plan.steps, int) else np.tile(plan.steps, (num_envs, 1))
        self.pushes = PushPlan(np.tile(plan.first_step, (num_envs, 1)), steps, np.tile(plan.force, (num_envs, 1, 1)))
        self.step_count = np.zeros(num_envs, np.int64)
        self.command = np.zeros((num_envs, 3))
        self._next_command_step = np.full(num_envs, NEVER)
        """Control step at which each robot gets a new command, (n,); `NEVER` for a fixed command."""
        self._manual_force: Array | None = None
        """Force on each trunk, set by the last call of `apply_push`, world frame, x and y, (n, 2), N.

        None if `apply_push` was never called.
        """
        self._manual_push_end = np.zeros(num_envs, np.int64)
        """Control step of each robot's episode at which the push from `apply_push` ends, (n,)."""

    def reseed(self, seed: int | Sequence[int] | None, mask: Mask) -> None:
        """Set the seeds of some robots; each of these robots then starts the first episode of its new seed.

        Args:
            seed: One seed, or a sequence with the seed of each robot, see `seeding.assign_seeds`; None changes nothing.
            mask: True for the robots that get a new seed, (n,).
        """
        if seed is None:
            return
        seeds = assign_seeds(seed, len(self._seeds))
        for i in np.flatnonzero(mask):
            if seeds[i] is not None:
                self._seeds[i] = seeds[i]
                self._next_number[i] = 0

    @property
    def severity(self) -> Array:
        """Severity of the scenario of each robot's next episode, (n,)."""
        return np.array([scenario.severity for scenario in self._scenarios])

    def set_scenarios(self, scenarios: Mapping[int, Scenario]) -> None:
        """Set the scenarios of the next episodes of some robots, index of the robot -> scenario.

        Only settings that `quad_env.scenarios.severity` moves may differ from the scenario of the constructor.
        """
        for i, scenario in scenarios.items():
            self._scenarios[i] = scenario

    def reset(self, env_ids: NDArray[np.intp], fixed_command: Array | None) -> list[EpisodeSample]:
        """Start the next episode of k robots.

        Args:
            env_ids: Indices of the robots, (k,).
            fixed_command: Velocity commands of all robots for the whole episode, (n, 3): forward and lateral m/s, yaw
                rate rad/s. If `fixed_command` is None, commands are drawn at random.

        Returns:
            Random draws of the new episodes of the k robots.
        """
        for i in env_ids:
            episode = EpisodeSample(self._robot, self._scenarios[i], self._seeds[i], self._next_number[i], self._dt)
            self._episodes[i] = episode
            self._next_number[i] += 1
            self.pushes.first_step[i] = episode.pushes.first_step
            self.pushes.force[i] = episode.pushes.force
            if not isinstance(self.pushes.steps, int):
                self.pushes.steps[i] = episode.pushes.steps
            self.command[i] = episode.next_command() if fixed_command is None else fixed_command[i]
            self._next_command_step[i] = episode.next_interval(self._dt) if fixed_command is None else NEVER
        self.step_count[env_ids] = 0
        self._manual_push_end[env_ids] = 0
        return [self._episodes[i] for i in env_ids]

    def count_step(self, env_ids: EnvSelection | None) -> None:
        """Add 1 to the elapsed control steps of the robots `env_ids`; None means the only robot of a batch of one."""
        if env_ids is None:
            self.step_count[0] += 1  # An addition to one item is ten times faster than to a slice.
        else:
            self.step_count[env_ids] += 1

    def resample_commands(self, env_ids: EnvSelection | None) -> None:
        """Draw a new velocity command for each of the robots `env_ids` with an expired command interval.

        `CommandRanges.interval` is the length of an interval, s. Robots with a fixed command keep this command. If
        `env_ids` is None, the batch has one robot.
        """
        if env_ids is None:
            if self.step_count.item(0) < self._next_command_step.item(0):
                return
            env_ids = slice(None)
        is_due = self.step_count[env_ids] >= self._next_command_step[env_ids]
        if np.count_nonzero(is_due):
            for i in np.arange(len(self.step_count))[env_ids][is_due]:
                self.command[i] = self._episodes[i].next_command(self.command[i])
                self._next_command_step[i] = self.step_count[i] + self._episodes[i].next_interval(self._dt)

    def fix_commands(self, commands: Array) -> None:
        """Set the velocity commands of all robots, (n, 3), for the rest of their present episodes.

        A command consists of forward and lateral velocity, heading frame, m/s, and yaw rate, rad/s.
        """
        self.command[:] = commands
        self._next_command_step[:] = NEVER

    def apply_push(self, forces: Array, steps: int) -> None:
        """Push the trunks from the next control step on, in addition to the planned pushes of the scenario.

        Args:
            forces: Force on each trunk, world frame, x and y, (n, 2), N.
            steps: Duration of the pushes, control steps.
        """
        self._manual_force = forces
        self._manual_push_end = self.step_count + steps

    def push_force(self) -> Array | None:
        """Return the pushing force on each trunk in the next control step, world frame, x and y, (n, 2), N.

        The force is the sum of the planned pushes and the push from `apply_push`. The result is None if the scenario
        has no pushes and `apply_push` was never called.
        """
        planned = self.pushes.force_at(self.step_count)
        if self._manual_force is None:
            return planned
        is_acting = self.step_count < self._manual_push_end
        manual = np.where(is_acting[:, None], self._manual_force, 0.0)
        return manual if planned is None else planned + manual
