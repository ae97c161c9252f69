"""Speed of the physics of a training with each of its options, for `python -m benchmarks.training`.

All settings simulate the same robots from the same states with the same joint targets, for learner samples of 20 ms.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from benchmarks.support.bare import (
    Actions,
    BareBatch,
    InitialStates,
    make_initial_states,
    record_actions,
    trot_robot,
)
from benchmarks.support.measure import Floats, interleave
from quad_env.config import PhysicsOptions
from quad_env.physics.model import compile_model, make_stepping_model
from quad_env.robots.robot import Robot
from quad_env.scenarios.registry import scenario
from train.config import CONTROL_PERIOD, RECIPES, SOLVER_ITERATIONS, TIMESTEP, TrainConfig

SAMPLE_TIME = TrainConfig().ppo.hold * CONTROL_PERIOD
"""Simulated time of a learner sample of the default training, s."""


@dataclass(frozen=True)
class TrainingPhysics:
    """Options of the physics in a training."""

    options: PhysicsOptions = field(default_factory=PhysicsOptions)
    """Contacts, friction cone and joint friction: `--physics.*`."""
    timestep: float | None = TIMESTEP
    """Physics time step, s; None for the value of the robot model."""
    iterations: int | None = SOLVER_ITERATIONS
    """Largest number of solver iterations per physics step; None for the value of the robot model."""


DEFAULT = "default of a training"
"""Name of the setting with which all other ones are compared."""
PHYSICS_SETTINGS: Mapping[str, TrainingPhysics] = {
    DEFAULT: TrainingPhysics(),
    "--physics.contacts feet-trunk": TrainingPhysics(PhysicsOptions(contacts="feet-trunk")),
    "--physics.contacts feet": TrainingPhysics(PhysicsOptions(contacts="feet")),
    "--physics.cone pyramidal": TrainingPhysics(PhysicsOptions(cone="pyramidal")),
    "--physics.joint-friction none": TrainingPhysics(PhysicsOptions(joint_friction="none")),
    "--timestep 0.002": TrainingPhysics(timestep=0.002),
    "time step of 0.004 s": TrainingPhysics(timestep=0.004),
    "--solver-iterations 1": TrainingPhysics(iterations=1),
    "--solver-iterations 2": TrainingPhysics(iterations=2),
    "--solver-iterations 10": TrainingPhysics(iterations=10),
    "--solver-iterations None": TrainingPhysics(iterations=None),
    "--recipe joystick": TrainingPhysics(RECIPES["joystick"].physics),
    "full model of an evaluation": TrainingPhysics(timestep=None, iterations=None),
}
"""Command-line options, or a description, -> setting. A training has no time step of 0.004 s, because it acts every
0.01 s."""


def make_states(setting: TrainingPhysics, robot: Robot, start: InitialStates) -> InitialStates:
    """Return initial states with the model of a setting, and with a learner sample as the control period.

    Args:
        setting: Options of the physics.
        robot: Robot of the initial states.
        start: Initial states of the robots.

    Returns:
        The same states with another model.
    """
    model = compile_model(
        robot,
        scenario("flat", robot),
        timestep=setting.timestep,
        solver_iterations=setting.iterations,
        options=setting.options,
        visuals=False,
    )
    return InitialStates(make_stepping_model(model), start.seeds, start.qpos, start.qvel, SAMPLE_TIME)


def time_settings(robot_name: str, envs: int, samples: int, rounds: int) -> dict[str, Floats]:
    """Time the physics of all settings, which take turns on one thread.

    In each round, the robots of every setting start from the same states in the home pose, and then walk by the
    recorded joint targets of the trot.

    Args:
        robot_name: Name of the robot, or path of its model file.
        envs: Number of robots.
        samples: Number of learner samples of each robot in a round.
        rounds: Number of timed rounds.

    Returns:
        Name of a setting in `PHYSICS_SETTINGS` -> processor time of a learner sample of a robot in each round,
        (rounds,), s.
    """
    start = make_initial_states("flat", envs, robot_name)
    robot = trot_robot(robot_name)
    hold = round(SAMPLE_TIME / start.dt)
    targets = record_actions(samples * hold, robot=robot_name)[::hold]
    actions = np.repeat(targets[:, None], envs, axis=1)
    batches = {name: BareBatch(make_states(setting, robot, start), 1) for name, setting in PHYSICS_SETTINGS.items()}
    timed = {name: partial(_time_walk, batch, actions) for name, batch in batches.items()}
    return interleave(timed, rounds, f"physics of {robot_name}")


def _time_walk(batch: BareBatch, actions: Actions) -> float:
    """Simulate `actions`, (samples, n, 12), from the initial states; return the processor time of a sample, s."""
    batch.restart()
    return batch.run(actions, time.process_time)
