"""Accuracy of a physics setting: deviation of strides from a reference, and slip of standing feet.

The reference is the same stride with a finer time step and a fully converged solver.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

import policies
from benchmarks.support.bars import ACCURACY_BARS
from benchmarks.support.physics_settings import FINE, PhysicsSetting, SpecEdit, compile_model
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out
from quad_env import TaskConfig
from quad_env.robots.simple_quad import SIMPLE_QUAD

Floats = NDArray[np.float64]
CONTROL_PERIOD = 1 / TaskConfig().control_rate
"""Control period, s."""
COMMANDS = ((0.5, 0.0, 0.0), (1.2, 0.0, 0.0), (0.0, 0.5, 0.0), (-0.4, 0.0, 0.8))
"""Commands of the recorded strides: forward, m/s, left, m/s, and yaw rate, rad/s."""
SETTLING_STEPS = 100
"""Number of control steps between the start of an episode and the recorded stride."""
SIDE_LOAD = 20.0
"""Lateral force on the trunk of a standing robot, under which the slip of the feet is measured, N."""


@dataclass(frozen=True)
class Stride:
    """One stride of the trot, made by `record_strides`: initial state and joint targets."""

    qpos: Floats
    """Initial MuJoCo positions `qpos`, (nq,)."""
    qvel: Floats
    """Initial MuJoCo velocities `qvel`, (nv,)."""
    warmstart: Floats
    """Accelerations with which the solver starts, `qacc_warmstart`, (nv,)."""
    targets: Floats
    """Joint targets at each control step, (steps, 12), rad."""


@dataclass(frozen=True)
class Accuracy:
    """Accuracy of one physics setting, made by `measure_accuracy`.

    `bars.ACCURACY_BARS` has the limit of each field. A deviation is the largest one over all strides.
    """

    trunk_mm: float
    """Largest distance between the trunk positions of stride and reference, mm."""
    tilt_rad: float
    """Largest angle between the trunk orientations of stride and reference, rad."""
    joints_rad: float
    """Largest difference between the joint angles of stride and reference, rad."""
    penetration_mm: float
    """Penetration depth of a standing foot into the ground, mm."""
    slip_mm_s: float
    """Speed of a standing foot while SIDE_LOAD acts on the trunk, mm/s."""

    @property
    def is_within_bars(self) -> bool:
        """True if every value is within its limit."""
        return all(limit.is_met(getattr(self, name)) for name, limit in ACCURACY_BARS.items())


def record_strides(commands: tuple[tuple[float, float, float], ...] = COMMANDS) -> tuple[Stride, ...]:
    """Record one stride of the trot for each command, after SETTLING_STEPS in the shipped environment."""
    return tuple(_stride(command) for command in commands)


def _stride(command: tuple[float, float, float]) -> Stride:
    """Record one stride of the trot at the given command."""
    policy = policies.Trot()
    start: list[mujoco.MjData] = []
    targets: list[Floats] = []

    def watch(step: Step) -> None:
        if step.number == SETTLING_STEPS:
            start.append(step.env.simulation.snapshot(0))
        elif step.number > SETTLING_STEPS:
            targets.append(step.action[0].astype(np.float64))

    steps = SETTLING_STEPS + round(1 / (policy.frequency * CONTROL_PERIOD))
    roll_out(policy, "flat", np.array([0]), watch, steps=steps, command=command)
    (data,) = start
    return Stride(data.qpos.copy(), data.qvel.copy(), data.qacc_warmstart.copy(), np.array(targets))


def measure_accuracy(
    setting: PhysicsSetting, recorded_strides: tuple[Stride, ...], reference: SpecEdit = FINE
) -> Accuracy:
    """Measure the accuracy of a setting.

    Args:
        setting: Physics setting.
        recorded_strides: Strides to replay with the setting and with the reference.
        reference: Change of the shipped model for the reference.

    Returns:
        The accuracy, with the largest deviations over all strides.
    """
    model = compile_model(setting.change)
    reference_model = compile_model(reference)
    deviations = [_deviation(model, reference_model, stride) for stride in recorded_strides]
    trunk, tilt, joints = np.max(deviations, axis=0).tolist()
    penetration, slip = _standing(model)
    return Accuracy(trunk, tilt, joints, penetration, slip)


def _deviation(model: mujoco.MjModel, reference: mujoco.MjModel, stride: Stride) -> tuple[float, float, float]:
    """Return the largest deviations of a stride from the reference: trunk, mm, tilt, rad, joints, rad."""
    positions = replay_stride(model, stride)
    true_positions = replay_stride(reference, stride)
    trunk = np.linalg.norm(positions[:, :3] - true_positions[:, :3], axis=1).max()
    quaternion_product = np.abs((positions[:, 3:7] * true_positions[:, 3:7]).sum(axis=1))
    tilt = 2 * np.arccos(np.minimum(quaternion_product, 1.0)).max()
    return trunk * 1e3, tilt, np.abs(positions[:, 7:] - true_positions[:, 7:]).max()


def replay_stride(model: mujoco.MjModel, stride: Stride) -> Floats:
    """Simulate a `stride` with a `model`; return `qpos` after each control step, (steps, nq)."""
    data = mujoco.MjData(model)
    data.qpos = stride.qpos
    data.qvel = stride.qvel
    data.qacc_warmstart = stride.warmstart
    rows = []
    for target in stride.targets:
        data.ctrl[:] = target
        _advance(model, data, CONTROL_PERIOD)
        rows.append(data.qpos.copy())
    return np.array(rows)


def _standing(model: mujoco.MjModel) -> tuple[float, float]:
    """Return the largest penetration of standing feet, mm, and their largest speed under SIDE_LOAD, mm/s."""
    data = mujoco.MjData(model)
    feet = [model.site(f"{leg}_foot").id for leg in SIMPLE_QUAD.leg_names]
    mujoco.mj_resetDataKeyframe(model, data, 0)
    _advance(model, data, 2.0)
    penetration = SIMPLE_QUAD.foot_radius - data.site_xpos[feet, 2].min()
    data.xfrc_applied[model.body("base_link").id, 1] = SIDE_LOAD
    _advance(model, data, 0.5)
    before = data.site_xpos[feet].copy()
    _advance(model, data, 1.0)
    slip = np.linalg.norm((data.site_xpos[feet] - before)[:, :2], axis=1).max()
    return float(penetration * 1e3), float(slip * 1e3)


def _advance(model: mujoco.MjModel, data: mujoco.MjData, seconds: float) -> None:
    """Step the simulation for a time of `seconds`, with constant control inputs and external forces."""
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
