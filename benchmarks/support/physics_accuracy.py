"""What a physics setting gives up: a stride against its reference, and a standing foot."""

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
"""s"""
COMMANDS = ((0.5, 0.0, 0.0), (1.2, 0.0, 0.0), (0.0, 0.5, 0.0), (-0.4, 0.0, 0.8))
"""Commands of the strides: forward m/s, lateral m/s, yaw rate rad/s."""
SETTLING_STEPS = 100
"""Control steps before a stride."""
SIDE_LOAD = 20.0
"""N on a standing trunk."""


@dataclass(frozen=True)
class Stride:
    """A stride of the trot: where it starts, and its targets."""

    qpos: Floats
    qvel: Floats
    warmstart: Floats
    targets: Floats
    """(ticks, 12), rad"""


@dataclass(frozen=True)
class Accuracy:
    """Figures of one setting, each held to its bar in `bars.ACCURACY`."""

    trunk_mm: float
    """Largest distance of the trunk from the reference's, in the worst stride."""
    tilt_rad: float
    """Largest angle between the two trunks."""
    joints_rad: float
    """Largest difference of a joint angle."""
    penetration_mm: float
    """How deep a standing foot sinks."""
    slip_mm_s: float
    """Speed of a standing foot under a side load of 20 N."""

    @property
    def is_within_bars(self) -> bool:
        """Whether the setting meets the accuracy bar."""
        return all(limit.is_met(getattr(self, name)) for name, limit in ACCURACY_BARS.items())


def record_strides(commands: tuple[tuple[float, float, float], ...] = COMMANDS) -> tuple[Stride, ...]:
    """One stride of the trot for each command, from a settled gait in the shipped environment."""
    return tuple(_stride(command) for command in commands)


def _stride(command: tuple[float, float, float]) -> Stride:
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


def measure_accuracy(setting: PhysicsSetting, walked: tuple[Stride, ...], reference: SpecEdit = FINE) -> Accuracy:
    """Every figure of a setting; strides are compared with those of the `reference`."""
    model, true = compile_model(setting.change), compile_model(reference)
    trunk, tilt, joints = np.max([_deviation(model, true, stride) for stride in walked], axis=0).tolist()
    sinks, slip = _standing(model)
    return Accuracy(trunk, tilt, joints, sinks, slip)


def _deviation(model: mujoco.MjModel, reference: mujoco.MjModel, stride: Stride) -> tuple[float, float, float]:
    """Largest deviations of a stride, mm, rad, rad."""
    ours, theirs = replay_stride(model, stride), replay_stride(reference, stride)
    trunk = np.linalg.norm(ours[:, :3] - theirs[:, :3], axis=1).max()
    same = np.abs((ours[:, 3:7] * theirs[:, 3:7]).sum(axis=1))
    tilt = 2 * np.arccos(np.minimum(same, 1.0)).max()
    return trunk * 1e3, tilt, np.abs(ours[:, 7:] - theirs[:, 7:]).max()


def replay_stride(model: mujoco.MjModel, stride: Stride) -> Floats:
    """Positions after each control step, (ticks, nq)."""
    data, rows = mujoco.MjData(model), []
    data.qpos, data.qvel, data.qacc_warmstart = stride.qpos, stride.qvel, stride.warmstart
    for target in stride.targets:
        data.ctrl[:] = target
        _advance(model, data, CONTROL_PERIOD)
        rows.append(data.qpos.copy())
    return np.array(rows)


def _standing(model: mujoco.MjModel) -> tuple[float, float]:
    """How deep a standing foot sinks, mm, and how fast the fastest one slips under a side load, mm/s."""
    data, feet = mujoco.MjData(model), [model.site(f"{leg}_foot").id for leg in SIMPLE_QUAD.leg_names]
    mujoco.mj_resetDataKeyframe(model, data, 0)
    _advance(model, data, 2.0)
    sinks = SIMPLE_QUAD.foot_radius - data.site_xpos[feet, 2].min()
    data.xfrc_applied[model.body("base_link").id, 1] = SIDE_LOAD
    _advance(model, data, 0.5)
    before = data.site_xpos[feet].copy()
    _advance(model, data, 1.0)
    slip = np.linalg.norm((data.site_xpos[feet] - before)[:, :2], axis=1).max()
    return float(sinks * 1e3), float(slip * 1e3)


def _advance(model: mujoco.MjModel, data: mujoco.MjData, seconds: float) -> None:
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
