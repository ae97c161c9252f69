"""Faults of measured work, planted into the real code: each must make a named check fail."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pytest

import policies
import quad_env
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.physics import energy
from quad_env.physics.energy import JOINT_READINGS, MotorMeter
from tests.planted_faults.harness import Faults, checks_of, fault_tests
from tests.robot_models import NEEDS_MODELS

RATE = 500.0
"""Hz. Every control step is one physics step, so that each physics step is visible."""


class Robot:
    """One robot that stands up from a crouch, walks ahead and is pushed, with readings after each physics step."""

    def __init__(self, robot: str = "simple_quad", policy: str = "trot", **options: Any) -> None:
        self.policy = policies.make(policy, robot=robot)
        config = quad_env.TaskConfig(control_rate=RATE)
        options |= {"robot": self.policy.robot or robot, "config": config, "max_episode_steps": None}
        self.env = SimpleQuadVectorEnv(1, "flat", nthread=1, readings=True, terminate_on_fall=False, **options)
        self.simulation = self.env.simulation
        self.model, self.data = self.simulation.model, mujoco.MjData(self.simulation.model)

    def walk(self, seconds: float) -> Iterator[dict[str, np.ndarray]]:
        """Yield the readings of each physics step."""
        self.policy.reset(1)
        observation, _ = self.env.reset(seed=0, options={"command": (0.0, 0.0, 0.0)})
        crouch = np.zeros((1, 35))
        crouch[0, 5:17] = np.tile([0.0, 0.6, -1.0], 4)
        self.simulation.reset(np.arange(1), crouch)
        action = self.env.robot.home_pose[None].astype(np.float32)
        for step in range(round(seconds * RATE)):
            if step == 0.3 * RATE:
                self.env.steer((0.5, 0.0, 0.0))
            if step == 0.7 * RATE:
                self.env.push((0.0, 14.0 * self.env.robot.mass), 0.1)
            if step % 5 == 0 and step >= 0.3 * RATE:
                action = self.policy.act(observation)
            observation, *_, infos = self.env.step(action)
            yield {name: infos[name][0].astype(np.float64) for name in JOINT_READINGS}

    @property
    def energy(self) -> float:
        """Return kinetic and potential energy by MuJoCo, J."""
        self.data.qpos[:], self.data.qvel[:] = self.simulation.qpos[0], self.simulation.qvel[0]
        mujoco.mj_fwdPosition(self.model, self.data)
        mujoco.mj_energyPos(self.model, self.data)
        mujoco.mj_energyVel(self.model, self.data)
        return float(self.data.energy.sum())


def motor_work_and_what_it_became(**robot: Any) -> tuple[float, float]:
    """Return the motors' net work, J, and its balance: change of energy plus losses minus the work of the push, J.

    Losses are in joint damping and contacts.
    """
    walking = Robot(**robot)
    batch, model, start = walking.simulation.batch, walking.model, None
    contact, bearings = batch.bind("qfrc_constraint"), model.dof_damping
    work = losses = 0.0
    before = walking.simulation.qvel[0].copy()
    for step, read in enumerate(walking.walk(1.0)):
        after = walking.simulation.qvel[0].copy()
        if step:  # the first step starts in the crouch, before the energy is known
            mean = 0.5 * (before + after)
            work += float((read["positive_work"] - read["regeneration"]).sum())
            force = -contact[0] + bearings * after  # implicit integration
            force[:2] -= walking.simulation.push[0]
            losses += float(force @ mean) / RATE
        else:
            start = walking.energy
        before = after
    assert start is not None
    return work, walking.energy - start + losses


def check_the_energy_balance_closes() -> None:
    work, became = motor_work_and_what_it_became()
    assert work > 10.0
    assert work == pytest.approx(became, rel=0.01)


def check_joints_receive_what_the_equation_of_motion_needs(**options: Any) -> None:
    """M (v' − v) / h is the sum of all forces; the motor forces are the difference to the other forces."""
    robot = Robot(**options)
    simulation, model, data = robot.simulation, robot.model, robot.data
    bias, contact = (simulation.batch.bind(name) for name in ("qfrc_bias", "qfrc_constraint"))
    inertia, before = np.empty((model.nv, model.nv)), None
    for step, read in enumerate(robot.walk(0.4)):
        qpos, qvel = simulation.qpos[0].copy(), simulation.qvel[0].copy()
        if before is not None and step % 3 == 0:
            data.qpos[:], data.qvel[:] = before
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fullM(model, data, inertia)
            forces = inertia @ (qvel - before[1]) * RATE + bias[0] - contact[0] + model.dof_damping * qvel
            np.testing.assert_allclose(read["peak_torque"], np.abs(forces[6:]), atol=1e-9)
        before = qpos, qvel


def check_work_is_that_of_every_physics_step() -> None:
    """The same walk is measured at 100 Hz and in each of its physics steps."""
    fine, coarse = Robot(), Robot()
    coarse.env = SimpleQuadVectorEnv(1, "flat", nthread=1, readings=True)
    for robot in (fine, coarse):
        robot.env.reset(seed=3, options={"command": (0.5, 0.0, 0.0)})
    rng, home = np.random.default_rng(0), fine.env.robot.home_pose
    for _ in range(20):
        action = (home + rng.uniform(-0.2, 0.2, (1, 12))).astype(np.float32)
        parts = [fine.env.step(action)[-1] for _ in range(5)]
        whole = coarse.env.step(action)[-1]
        np.testing.assert_array_equal(whole["joint_velocity"], parts[-1]["joint_velocity"])
        for name in (*JOINT_READINGS, "foot_impulse"):
            each = np.array([part[name] for part in parts])
            # Motors without a curve have no Joule heat; torque changes are means over control steps.
            if name not in ("joule_heat", "torque_change"):
                of_step = {"mean_torque": each.mean(0)}.get(name, each.max(0) if "peak" in name else each.sum(0))
                np.testing.assert_allclose(whole[name], of_step, atol=1e-9, err_msg=name)


def without_damping(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(energy, "make_applied_torque_reader", lambda *_: lambda outputs, _: outputs["actuator_force"])


def in_the_last_substep_alone(patch: pytest.MonkeyPatch) -> None:
    def finish(self: MotorMeter, ids: Any) -> None:
        self._samples[:] = self._samples[-1:] * len(self._samples)
        true(self, ids)

    true = MotorMeter.finish
    patch.setattr(MotorMeter, "finish", finish)


def at_the_speed_before_the_step(patch: pytest.MonkeyPatch) -> None:
    def finish(self: MotorMeter, ids: Any) -> None:
        self._samples[:] = [sample._replace(speed_after=sample.speed_before) for sample in self._samples]
        true(self, ids)

    true = MotorMeter.finish
    patch.setattr(MotorMeter, "finish", finish)


FAULTS: Faults = {
    "power without damping": (without_damping, check_the_energy_balance_closes),
    "torque without damping": (without_damping, check_joints_receive_what_the_equation_of_motion_needs),
    "speed and torque at the start of the step": (at_the_speed_before_the_step, check_the_energy_balance_closes),
    "torque of the last substep only": (in_the_last_substep_alone, check_work_is_that_of_every_physics_step),
}
test_the_code_passes, test_a_planted_fault_is_found, test_every_check_finds_one = fault_tests(
    checks_of(globals()), FAULTS
)


@pytest.mark.parametrize(
    "options",
    [{"actuator": "motor"}, pytest.param({"robot": "go1", "policy": "trot_feedback"}, marks=NEEDS_MODELS)],
    ids=str,
)
def test_both_hold_with_motors_and_on_another_robot(options: dict[str, Any]) -> None:
    """Motors with a curve have their own damping; the joints of go1 have dry friction."""
    work, became = motor_work_and_what_it_became(**options)
    assert work == pytest.approx(became, rel=0.02)
    check_joints_receive_what_the_equation_of_motion_needs(**options)
