"""What the present episodes of n robots ask of them, and how far each has come: seeds, commands, pushes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quad_env.columns import Array, EnvSelection, Mask
from quad_env.robots.robot import Robot
from quad_env.scenarios.episode import EpisodeSample, PushPlan
from quad_env.scenarios.scenario import Scenario
from quad_env.seeding import fresh_seeds, seeds_of


class EpisodeSchedule:
    """Episode k after a seed is that seed's k-th, whatever the other robots do."""

    def __init__(self, robot: Robot, scenario: Scenario, num_envs: int, dt: float) -> None:
        self._robot, self._scenario, self._dt = robot, scenario, dt
        self._interval = scenario.commands.steps(dt)
        self._seeds, self._next = fresh_seeds(num_envs), [0] * num_envs
        self._episodes = [EpisodeSample(robot, scenario, 0, 0, dt)] * num_envs
        plan = self._episodes[0].pushes
        self.pushes = PushPlan(
            np.tile(plan.first_step, (num_envs, 1)), plan.steps, np.tile(plan.force, (num_envs, 1, 1))
        )
        """Pushes of every robot's present episode."""
        self.step_count = np.zeros(num_envs, np.int64)
        """Control steps since each robot's start, (n,)."""
        self.command = np.zeros((num_envs, 3))
        """To follow in the coming step, (n, 3)."""
        self._held = np.zeros(num_envs, bool)
        self._shove: Array | None = None
        self._shove_end = np.zeros(num_envs, np.int64)

    def reseed(self, seed: int | Sequence[int] | None, mask: Mask) -> None:
        """The next episodes of the masked robots are the first of these seeds, see `seeding.seeds_of`."""
        if seed is None:
            return
        seeds = seeds_of(seed, len(self._seeds))
        for i in np.flatnonzero(mask):
            if seeds[i] is not None:
                self._seeds[i], self._next[i] = seeds[i], 0

    def reset(self, env_ids: NDArray[np.intp], held: Array | None) -> list[EpisodeSample]:
        """The next episodes of those robots; `held` are the commands of all, (n, 3), or None to draw."""
        for i in env_ids:
            episode = EpisodeSample(self._robot, self._scenario, self._seeds[i], self._next[i], self._dt)
            self._episodes[i] = episode
            self._next[i] += 1
            self.pushes.first_step[i], self.pushes.force[i] = episode.pushes.first_step, episode.pushes.force
            self.command[i] = episode.next_command() if held is None else held[i]
        self.step_count[env_ids], self._held[env_ids], self._shove_end[env_ids] = 0, held is not None, 0
        return [self._episodes[i] for i in env_ids]

    def resample_commands(self, env_ids: EnvSelection) -> None:
        """New commands for those robots that have followed one for its time."""
        due = self.step_count[env_ids] % self._interval == 0
        if np.count_nonzero(due):
            for i in np.arange(len(self.step_count))[env_ids][due & ~self._held[env_ids]]:
                self.command[i] = self._episodes[i].next_command()

    def fix_commands(self, commands: Array) -> None:
        """Every robot follows its command, (n, 3), to the end of its episode; no more are drawn."""
        self.command[:], self._held[:] = commands, True

    def apply_push(self, forces: Array, steps: int) -> None:
        """Push the trunks with these forces, world frame, (n, 2), N, for some control steps, added to their pushes."""
        self._shove, self._shove_end = forces, self.step_count + steps

    def push_force(self) -> Array | None:
        """Pushing force on every trunk in the coming step, world frame, (n, 2), N; None before the first push."""
        planned = self.pushes.force_at(self.step_count)
        if self._shove is None:
            return planned
        apply_push = np.where((self.step_count < self._shove_end)[:, None], self._shove, 0.0)
        return apply_push if planned is None else planned + apply_push
