"""MuJoCo Warp and MuJoCo agree on equal states: observations, rewards and ends of episodes.

The first run compiles for a minute. Both use Newton's method here, since Warp lacks SimpleQuad's own solver, PGS, which
stops with some error.
"""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

pytest.importorskip("mujoco_warp")

import policies
import quad_env
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics import simulation
from quad_env.physics.warp_batch import WarpBatch
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.task.observations import observation_table
from tests.planted_faults.harness import Faults, Plant, checks_of, fault_tests

ROBOTS = 4
FIRST = 10
"""Control steps that are not compared, since a foot that just touches the ground may do so in one precision only."""
SCALE = observation_table(SIMPLE_QUAD).scale
"""Scale of observations to unit size, as for learners."""
CONFIG = quad_env.TaskConfig(timestep=0.005, reward_weights=quad_env.RewardWeights(mechanical_power=-0.01))
SUPPORTED = (
    *("flat", "push=50", "slope=20", "stairs=0.1", "soft=0.02", "slippery=0.2", "payload=10", "weak_motors=20"),
    *("force=40", "latency=0.02", "noise=0.4", "dropout=0.4", "flat+randomised"),
)


@pytest.fixture(autouse=True)
def newton(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let MuJoCo's models use Newton's method."""
    stepped_model = simulation.make_stepping_model

    def solved(*args: Any) -> mujoco.MjModel:
        model = stepped_model(*args)
        model.opt.solver, model.opt.tolerance = mujoco.mjtSolver.mjSOL_NEWTON, 1e-10
        return model

    monkeypatch.setattr(simulation, "make_stepping_model", solved)


def robots(scenario: str, simulator: str) -> SimpleQuadVectorEnv:
    return SimpleQuadVectorEnv(
        ROBOTS, scenario, nthread=1, autoreset_mode="DISABLED", config=CONFIG, simulator=simulator
    )


def compare(scenario: str, steps: int = 40) -> None:
    """Check that observations, rewards and ends agree within 1e-4 in each step from MuJoCo's state, for a trot."""
    ours, theirs = robots(scenario, "mujoco"), robots(scenario, "warp")
    observation, _ = ours.reset(seed=1)
    np.testing.assert_allclose(theirs.reset(seed=1)[0], observation, atol=1e-6)
    trot, touched = policies.make("trot"), 0
    trot.reset(ROBOTS)
    for step in range(-FIRST, steps):
        action = trot.act(observation)
        for field in ("qpos", "qvel"):
            theirs.simulation.batch.bind(field)[:] = ours.simulation.batch.bind(field)
        (observation, rewards, terminated, *_), found = ours.step(action), theirs.step(action)
        if step < 0:
            continue
        np.testing.assert_allclose(found[0] * SCALE, observation * SCALE, atol=1e-4)
        np.testing.assert_allclose(found[1], rewards, atol=1e-4)
        np.testing.assert_array_equal(found[2], terminated)
        touched += not np.array_equal(found[0], observation)
    assert touched > steps / 2, "it is the same simulator"


@pytest.mark.parametrize("scenario", SUPPORTED)
def test_observations_rewards_and_ends_are_mujocos(scenario: str) -> None:
    compare(scenario)


def check_a_step_is_mujocos() -> None:
    compare("payload=10", 10)


@pytest.mark.parametrize("scenario", ["rough", "gravel", "slow_motors", "flat+hardware"])
def test_what_it_cannot_do_is_refused_in_one_line(scenario: str) -> None:
    with pytest.raises(ValueError, match=r"^the simulator warp does not support .*; use mujoco instead$"):
        robots(scenario, "warp")


def test_energy_is_not_measured_there() -> None:
    with pytest.raises(ValueError, match="energy"):
        SimpleQuadVectorEnv(1, readings=True, simulator="warp")


def changed(change: Callable[[WarpBatch], None]) -> Plant:
    """Apply a change at the end of every step."""

    def plant(patch: pytest.MonkeyPatch) -> None:
        true_step = WarpBatch.step

        def step(self: WarpBatch, ids: Any, nstep: int) -> None:
            true_step(self, ids, nstep)
            change(self)

        patch.setattr(WarpBatch, "step", step)

    return plant


def turned(batch: WarpBatch) -> None:
    """Return angular velocities in the world frame."""
    qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
    for place, rates in zip(qpos, qvel, strict=True):
        mujoco.mju_rotVecQuat(rates[3:6], rates[3:6].copy(), place[3:7])


def without(name: str) -> Plant:
    return lambda patch: patch.setattr(WarpBatch, name, lambda *_: None)


FAULTS: Faults = {
    "angular velocity in another frame": (changed(turned), check_a_step_is_mujocos),
    "torques of no step": (changed(lambda batch: batch.bind("actuator_force").fill(0.0)), check_a_step_is_mujocos),
    "payloads where they are not": (without("_upload_expanded_fields"), check_a_step_is_mujocos),
}
test_the_code_passes, test_the_fault_turns_its_check_red, test_every_check_has_a_fault = fault_tests(
    checks_of(globals()), FAULTS
)
