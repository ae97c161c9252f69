"""Simulates robots with MuJoCo alone, for comparison of the speed with the environment.

The MuJoCo model, the initial states and the actions are equal to the ones in the environment.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import gymnasium as gym
import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

import policies
from quad_env import ENV_ID
from quad_env.physics.model import make_stepping_model
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

Floats = NDArray[np.float64]
Actions = NDArray[np.float32]
COMMAND = (0.5, 0.0, 0.3)
"""Velocity command of the robots in the benchmarks: forward, m/s, left, m/s, and yaw rate, rad/s."""
MAX_STARTS = 256
"""Largest number of different initial states in a batch of robots; a larger batch repeats the states."""


@dataclass(frozen=True)
class InitialStates:
    """MuJoCo model, and n initial states of a robot after resets of the environment; see `make_initial_states`."""

    model: mujoco.MjModel
    """MuJoCo model that the environment simulates."""
    seeds: tuple[int, ...]
    """Seed of the reset that gave each state, n items."""
    qpos: Floats
    """Generalized positions of each state, MuJoCo `qpos`, (n, nq); nq is MuJoCo's number of positions of a robot."""
    qvel: Floats
    """Generalized velocities of each state, MuJoCo `qvel`, (n, nv); nv is MuJoCo's number of velocities of a robot."""
    dt: float
    """Control period of the environment, s."""

    @property
    def substeps(self) -> int:
        """Number of physics steps in one control step."""
        return round(self.dt / float(self.model.opt.timestep))


def make_initial_states(scenario: str, num_envs: int, robot: str = SIMPLE_QUAD.name) -> InitialStates:
    """Record the states of the robot after resets of the environment with the seeds 0, 1, ….

    Args:
        scenario: Name of the scenario.
        num_envs: Number of states. If this number exceeds MAX_STARTS, the first MAX_STARTS states are repeated.
        robot: Name of the robot, or path of its model file.

    Returns:
        MuJoCo model and initial states.
    """
    env = gym.make(ENV_ID, scenario=scenario, robot=trot_robot(robot))
    distinct = min(num_envs, MAX_STARTS)
    snapshots = []
    for seed in range(distinct):
        env.reset(seed=seed)
        snapshots.append(env.unwrapped.data)  # type: ignore[attr-defined]
    model: mujoco.MjModel = env.unwrapped.model  # type: ignore[attr-defined]
    dt: float = env.unwrapped.dt  # type: ignore[attr-defined]
    env.close()
    rows = np.arange(num_envs) % distinct
    return InitialStates(
        make_stepping_model(model),
        tuple(rows.tolist()),
        np.array([data.qpos for data in snapshots])[rows],
        np.array([data.qvel for data in snapshots])[rows],
        dt,
    )


def trot_robot(robot: str) -> Robot:
    """Return a robot with the servo gains of the trot; `robot` is a name, or the path of a model file."""
    return policies.make("trot", robot=robot, servo="own").robot


def record_actions(
    steps: int, seed: int = 0, command: tuple[float, float, float] = COMMAND, robot: str = SIMPLE_QUAD.name
) -> Actions:
    """Record the actions of the trot controller in one episode on flat ground.

    Args:
        steps: Number of control steps.
        seed: Seed of the episode.
        command: Constant velocity command: forward, m/s, left, m/s, and yaw rate, rad/s.
        robot: Name of the robot, or path of its model file.

    Returns:
        Joint targets of each control step, (steps, 12), rad.
    """
    policy = policies.make("trot", robot=robot, servo="own")
    env = gym.make(ENV_ID, robot=policy.robot)
    policy.reset()
    observation, _ = env.reset(seed=seed, options={"command": command})
    actions: list[Actions] = []
    for _ in range(steps):
        actions.append(policy.act(observation))
        observation, *_ = env.step(actions[-1])
    env.close()
    return np.array(actions)


class BareLoop:
    """Simulation of one robot by a loop of `mj_step`, without the environment.

    Args:
        start: MuJoCo model and initial states; the robot starts from the first state.

    Attributes:
        data: MuJoCo state of the robot.
    """

    def __init__(self, start: InitialStates) -> None:
        self._start = start
        self.data = mujoco.MjData(start.model)
        self.restart()

    def restart(self) -> None:
        """Reset the robot to the first state of the initial states that the constructor received."""
        mujoco.mj_resetData(self._start.model, self.data)
        self.data.qpos, self.data.qvel = self._start.qpos[0], self._start.qvel[0]

    def run(self, actions: Actions) -> float:
        """Simulate one control step for each action, and return the mean duration of a control step.

        Args:
            actions: Joint targets of each control step, (steps, 12), rad.

        Returns:
            Mean wall time of a control step, s.
        """
        model = self._start.model
        data = self.data
        substeps = self._start.substeps
        begin = time.perf_counter()
        for action in actions:
            data.ctrl[:] = action
            for _ in range(substeps):
                mujoco.mj_step(model, data)
        return (time.perf_counter() - begin) / len(actions)


class BareBatch:
    """Simulation of n robots by `mujoco.batch.Batch`, without the environment.

    Args:
        start: MuJoCo model and initial states of the n robots.
        threads: Number of threads of the simulation.
    """

    def __init__(self, start: InitialStates, threads: int) -> None:
        self._start = start
        self._substeps = start.substeps
        self._batch = Batch(start.model, len(start.qpos), threads)
        self._controls = self._batch.bind("ctrl")
        self.restart()

    def restart(self) -> None:
        """Set all robots to the initial states that the constructor received."""
        self._batch.bind("qpos")[:] = self._start.qpos
        self._batch.bind("qvel")[:] = self._start.qvel

    @property
    def qpos(self) -> Floats:
        """Current positions of the robots, MuJoCo `qpos`, (n, nq); nq is MuJoCo's number of positions of a robot."""
        return np.array(self._batch.bind("qpos"))

    def run(self, actions: Actions, clock: Callable[[], float] = time.perf_counter) -> float:
        """Simulate one control step for each action, and return the mean duration of a control step.

        Args:
            actions: Joint targets of each control step and robot, (steps, n, 12), rad.
            clock: Function that returns the present time, s; by default wall time.

        Returns:
            Mean time of a control step, s per robot.
        """
        begin = clock()
        for action in actions:
            self._controls[:] = action
            self._batch.step(nstep=self._substeps)
        return (clock() - begin) / (len(actions) * len(self._controls))
