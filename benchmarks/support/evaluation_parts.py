"""Processor time of an evaluation by parts, next to the bare physics of the same robots.

The bare physics starts each control step from the states of the evaluation, with the same joint targets. All its
robots have the model of the scenario, also where policies have servo gains of their own.
"""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

import numpy as np
from mujoco.batch import Batch

from benchmarks.support.measure import Floats, Stopwatch
from evaluate.cells import LabelledPolicy, PolicyScenarioResult, Task, load_labelled_policy
from evaluate.hardware import IDEAL
from evaluate.rollouts import run
from policies.base import Policy
from quad_env.columns import EnvSelection
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics.model import make_stepping_model
from quad_env.physics.simulation import ALL, Simulation
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.registry import scenario as find_scenario
from quad_env.scenarios.scenario import Scenario
from quad_env.seeding import episode_seeds

PARTS = ("physics", "environment", "policies", "recording", "measures")
"""Parts of an evaluation: MuJoCo; sensors, observations, rewards and falls without MuJoCo; actions of the policies;
signals of all control steps; measures and causes of failures."""


@dataclass(frozen=True)
class ControlStep:
    """Control step of the robots of an evaluation."""

    env_ids: Any
    """Indices of the stepped robots, (k,), or None for all robots."""
    qpos: Floats
    """Positions of all n robots before the step, MuJoCo `qpos`, (n, nq)."""
    qvel: Floats
    """Velocities of all n robots before the step, MuJoCo `qvel`, (n, nv)."""
    ctrl: Floats
    """Joint targets of all n robots in the last physics step of the control step, (n, 12), rad."""


class TimedEvaluation:
    """Evaluation of several policies on a scenario, with the processor time of its parts.

    Args:
        names: Names of the policies.
        scenario: Name of the scenario.
        on_hardware_profile: True for the realistic motors, sensors and estimator of the robot.
        episodes: Number of episodes of each policy.
        steps: Maximum number of control steps of an episode.
        robot: Name of the robot, or path of its file.
    """

    def __init__(
        self,
        names: Sequence[str],
        scenario: str,
        *,
        on_hardware_profile: bool,
        episodes: int,
        steps: int,
        robot: str = SIMPLE_QUAD.name,
    ) -> None:
        hardware = replace(IDEAL, robot=robot)
        self.scenario: Scenario = replace(find_scenario(scenario, hardware.robot_model), hardware=on_hardware_profile)
        """Scenario of all episodes."""
        policies = [load_labelled_policy(name, hardware, (self.scenario,)) for name in names]
        seeds = np.asarray(episode_seeds("search", 0, episodes))
        self._tasks = [_make_task(policy, self.scenario, seeds, steps, hardware) for policy in policies]
        self._clock = time.process_time
        self.calls: list[ControlStep] = []
        """Control steps of the last evaluation."""
        self.simulation: Simulation | None = None
        """Simulation of the last evaluation; None before the first one."""
        self.stopwatch = Stopwatch(self._clock)

    def run(self) -> dict[str, float]:
        """Evaluate the policies once; return the processor time of each of the `PARTS`, s.

        The time to record the control steps for the bare physics is in none of the parts.
        """
        seconds = self.stopwatch.seconds
        seconds.clear()
        self.calls.clear()
        with ExitStack() as stack:
            for owner, name, function in self._timed_functions():
                stack.enter_context(patch.object(owner, name, function))
            self.stopwatch.timed("whole", self.evaluate)()
        physics = seconds["physics"]
        environment = seconds["step"] + seconds["reset"] - physics - seconds["calls"]
        recording = seconds["whole"] - seconds["step"] - seconds["reset"] - seconds["policies"] - seconds["measures"]
        return {
            "physics": physics,
            "environment": environment,
            "policies": seconds["policies"],
            "recording": recording,
            "measures": seconds["measures"],
        }

    @property
    def robot_steps(self) -> int:
        """Number of control steps of the last evaluation, summed over all robots."""
        assert self.simulation is not None, "the evaluation was not run"
        num_envs = len(self.simulation.qpos)
        return sum(num_envs if call.env_ids is None else len(call.env_ids) for call in self.calls)

    def evaluate(self) -> list[PolicyScenarioResult]:
        """Evaluate the policies once, without timing of the parts, and return their results."""
        result = run.simulate_group(self._tasks, 1, lambda _: None)
        return [chunk.cell for _, chunk in result.by_task(tuple(range(len(self._tasks))))]

    def _timed_functions(self) -> list[tuple[Any, str, Any]]:
        """Return the timed functions of the parts: owner, name of the attribute, function that replaces it."""
        timed = self.stopwatch.timed
        true_step = Simulation.step
        record = timed("calls", self._record)

        def recorded_step(simulation: Simulation, action: Floats, push: Any, env_ids: Any = ALL, *others: Any) -> None:
            qpos, qvel = timed("calls", self._copy_state)(simulation)
            true_step(simulation, action, push, env_ids, *others)
            record(simulation, env_ids, qpos, qvel)

        physics = [
            (Batch, name, timed("physics", getattr(Batch, name)))
            for name in ("step", "forward", "reset", "rollout", "set_const")
        ]
        return [
            *physics,
            (Simulation, "step", recorded_step),
            (SimpleQuadVectorEnv, "step", timed("step", SimpleQuadVectorEnv.step)),
            (SimpleQuadVectorEnv, "reset", timed("reset", SimpleQuadVectorEnv.reset)),
            (Policy, "act", self._timed_act()),
            (run, "measure_cell", timed("measures", run.measure_cell)),
        ]

    def _timed_act(self) -> Any:
        """Return a timed `Policy.act`; calls of a policy inside another policy are in the time of the outer one."""
        true_act = Policy.act
        timed_act = self.stopwatch.timed("policies", true_act)
        active: list[Policy] = []

        def act(policy: Policy, *args: Any, **kwargs: Any) -> Any:
            if active:
                return true_act(policy, *args, **kwargs)
            active.append(policy)
            try:
                return timed_act(policy, *args, **kwargs)
            finally:
                active.clear()

        return act

    def _copy_state(self, simulation: Simulation) -> tuple[Floats, Floats]:
        """Return copies of the positions and velocities of the robots of a `simulation`."""
        self.simulation = simulation
        return simulation.qpos.copy(), simulation.qvel.copy()

    def _record(self, simulation: Simulation, env_ids: EnvSelection, qpos: Floats, qvel: Floats) -> None:
        """Append a control step of the robots `env_ids` to `calls`; `qpos` and `qvel` are their states before it."""
        ids = None if env_ids is ALL else env_ids
        self.calls.append(ControlStep(ids, qpos, qvel, simulation._ctrl.copy()))


def _make_task(policy: LabelledPolicy, scenario: Scenario, seeds: Any, steps: int, hardware: Any) -> Task:
    """Return the task of all episodes of a policy; `seeds` are the seeds of the episodes, (n,)."""
    return Task(policy, scenario, np.arange(len(seeds)), seeds, steps, hardware)


class BareControlSteps:
    """Physics of an evaluation without the environment: `Batch.step` alone, from the same states.

    Args:
        evaluation: Evaluation that has been run once.
    """

    def __init__(self, evaluation: TimedEvaluation) -> None:
        assert evaluation.simulation is not None, "the evaluation was not run"
        self._evaluation = evaluation
        simulation = evaluation.simulation
        self._substeps = simulation.substeps
        self._batch = Batch(make_stepping_model(simulation.model), len(simulation.qpos), 1)

    def run(self) -> float:
        """Repeat the control steps of the last evaluation, and return the processor time of all steps, s.

        The time to set the states is not included.
        """
        seconds = 0.0
        for call in self._evaluation.calls:
            self._batch.bind("qpos")[:] = call.qpos
            self._batch.bind("qvel")[:] = call.qvel
            self._batch.bind("ctrl")[:] = call.ctrl
            begin = time.process_time()
            self._batch.step(call.env_ids, self._substeps)
            seconds += time.process_time() - begin
        return seconds

    @property
    def qpos(self) -> Floats:
        """Positions of all n robots now, MuJoCo `qpos`, (n, nq)."""
        return np.array(self._batch.bind("qpos"))
