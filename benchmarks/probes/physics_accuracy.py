"""What a physics setting gives up: a stride against its reference, a standing foot, energy in flight."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

import policies
from benchmarks.probes.physics_settings import Change, Setting, compiled, together
from benchmarks.support.bars import ACCURACY
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import roll_out
from quad_env import TaskConfig
from quad_env.robots.simple_quad import SIMPLE_QUAD

Floats = NDArray[np.float64]
CONTROL_PERIOD = 1 / TaskConfig().control_rate
"""s"""
COMMANDS = ((0.5, 0.0, 0.0), (1.2, 0.0, 0.0), (0.0, 0.5, 0.0), (-0.4, 0.0, 0.8))
"""Commands of the strides: forward m/s, lateral m/s, yaw rate rad/s."""
SETTLED = 100
"""Control steps before a stride."""
TUMBLE = (2.0, 3.0)
"""Turning of trunk and joints that a flight starts with, rad/s."""
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
    """Figures of one setting; those named in `bars.ACCURACY` are held to it."""

    trunk_mm: float
    """Largest distance of the trunk from the reference's, in the worst stride."""
    tilt_rad: float
    """Likewise the angle between the trunks."""
    joints_rad: float
    """Likewise of any joint."""
    sinks_mm: float
    """How deep a standing foot sinks."""
    slip_mm_s: float
    """Speed of a standing foot under a side load of 20 N."""
    impact_mm: float
    """How deep a foot sinks as it lands, in the worst stride."""
    energy: float
    """Drift of the energy of a tumbling robot without servos, friction or ground, in 1 s, per kinetic energy."""
    sag_rad: float
    """Largest joint error of a standing robot."""
    settles_s: float
    """Until a robot dropped into the home pose is within 1 mm of its height."""

    @property
    def within(self) -> bool:
        """Whether the setting meets the accuracy bar."""
        return all(limit.met(getattr(self, name)) for name, limit in ACCURACY.items())


def strides(commands: tuple[tuple[float, float, float], ...] = COMMANDS) -> tuple[Stride, ...]:
    """One stride of the trot for each command, from a settled gait in the shipped environment."""
    return tuple(_stride(command) for command in commands)


def _stride(command: tuple[float, float, float]) -> Stride:
    policy = policies.Trot()
    start: list[mujoco.MjData] = []
    targets: list[Floats] = []

    def watch(step: Step) -> None:
        if step.number == SETTLED:
            start.append(step.env.simulation.snapshot(0))
        elif step.number > SETTLED:
            targets.append(step.action[0].astype(np.float64))

    steps = SETTLED + round(1 / (policy.frequency * CONTROL_PERIOD))
    roll_out(policy, "flat", np.array([0]), watch, steps=steps, command=command)
    (data,) = start
    return Stride(data.qpos.copy(), data.qvel.copy(), data.qacc_warmstart.copy(), np.array(targets))


def accuracy(setting: Setting, walked: tuple[Stride, ...]) -> Accuracy:
    """Every figure of a setting."""
    model, reference = compiled(setting.change), compiled(setting.reference)
    worst = np.max([_deviation(model, reference, stride) for stride in walked], axis=0)
    trunk, tilt, joints, impact = (float(value) for value in worst)
    standing = _standing(model)
    return Accuracy(
        trunk_mm=trunk,
        tilt_rad=tilt,
        joints_rad=joints,
        impact_mm=impact,
        energy=_energy_drift(setting.change),
        **standing,
    )


def _deviation(model: mujoco.MjModel, reference: mujoco.MjModel, stride: Stride) -> tuple[float, float, float, float]:
    """Largest deviations of a stride, mm, rad, rad; deepest foot, mm."""
    (ours, depth), (theirs, _) = walk(model, stride), walk(reference, stride)
    trunk = np.linalg.norm(ours[:, :3] - theirs[:, :3], axis=1).max()
    same = np.abs((ours[:, 3:7] * theirs[:, 3:7]).sum(axis=1))
    tilt = 2 * np.arccos(np.minimum(same, 1.0)).max()
    return trunk * 1e3, tilt, np.abs(ours[:, 7:] - theirs[:, 7:]).max(), depth


def walk(model: mujoco.MjModel, stride: Stride) -> tuple[Floats, float]:
    """Positions after each control step, (ticks, nq), and how deep a foot sank into flat ground, mm."""
    data, rows, lowest = mujoco.MjData(model), [], np.inf
    feet = _feet(model)
    data.qpos, data.qvel, data.qacc_warmstart = stride.qpos, stride.qvel, stride.warmstart
    for target in stride.targets:
        data.ctrl[:] = target
        for _ in range(round(CONTROL_PERIOD / model.opt.timestep)):
            mujoco.mj_step(model, data)
            lowest = min(lowest, data.site_xpos[feet, 2].min())
        rows.append(data.qpos.copy())
    return np.array(rows), (SIMPLE_QUAD.foot_radius - lowest) * 1e3


def _standing(model: mujoco.MjModel) -> dict[str, float]:
    """The figures of a robot that stands, by the names of `Accuracy`."""
    data, heights = mujoco.MjData(model), []
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(200):
        _advance(model, data, CONTROL_PERIOD)
        heights.append(data.qpos[2])
    late = np.flatnonzero(np.abs(np.array(heights) - heights[-1]) > 0.001)
    settles = CONTROL_PERIOD * (late.max() + 1) if len(late) else 0.0
    sag = np.abs(data.qpos[7:] - SIMPLE_QUAD.home_pose).max()
    sinks = (SIMPLE_QUAD.foot_radius - data.site_xpos[_feet(model), 2].min()) * 1e3
    data.xfrc_applied[model.body("base_link").id, 1] = SIDE_LOAD
    _advance(model, data, 0.5)
    slip = _foot_speed(model, data)
    return {"sag_rad": float(sag), "settles_s": float(settles), "sinks_mm": float(sinks), "slip_mm_s": slip}


def _foot_speed(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Mean horizontal speed of the fastest foot over 1 s, mm/s."""
    feet = _feet(model)
    before = data.site_xpos[feet].copy()
    _advance(model, data, 1.0)
    return float(np.linalg.norm((data.site_xpos[feet] - before)[:, :2], axis=1).max() * 1e3)


def _energy_drift(change: Change) -> float:
    """Largest change of the energy of a robot in free flight, its joints turning, per kinetic energy at the start."""
    model = compiled(together(change, _flight))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qvel[3:6], data.qvel[6:] = TUMBLE
    mujoco.mj_forward(model, data)
    begin, kinetic = data.energy.sum(), data.energy[1]
    largest = 0.0
    for _ in range(round(1.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        largest = max(largest, abs(data.energy.sum() - begin))
    return float(largest / kinetic)


def _flight(spec: mujoco.MjSpec) -> None:
    """No ground, no limits, no servos, no friction; energies computed."""
    disabled = (
        mujoco.mjtDisableBit.mjDSBL_CONSTRAINT,
        mujoco.mjtDisableBit.mjDSBL_ACTUATION,
        mujoco.mjtDisableBit.mjDSBL_DAMPER,
    )
    spec.option.disableflags = sum(int(bit) for bit in disabled)
    spec.option.enableflags = int(mujoco.mjtEnableBit.mjENBL_ENERGY)


def _advance(model: mujoco.MjModel, data: mujoco.MjData, seconds: float) -> None:
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)


def _feet(model: mujoco.MjModel) -> list[int]:
    return [model.site(f"{leg}_foot").id for leg in SIMPLE_QUAD.leg_names]
