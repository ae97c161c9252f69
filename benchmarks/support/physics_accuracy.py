"""Measures the accuracy of a physics setting, such as a solver or a time step.

The accuracy is the deviation of recorded strides of the trot from a reference simulation, and the slip of standing
feet. The reference simulation repeats the same stride with a finer time step and a fully converged solver.
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
"""Time between two control steps in the environment by default, s."""
COMMANDS = ((0.5, 0.0, 0.0), (1.2, 0.0, 0.0), (0.0, 0.5, 0.0), (-0.4, 0.0, 0.8))
"""Velocity command of each recorded stride: forward, m/s, left, m/s, and yaw rate, rad/s."""
SETTLING_STEPS = 100
"""Number of control steps from the start of an episode to the recorded stride, so that the gait is steady."""
SIDE_LOAD = 20.0
"""Lateral force on the trunk of a standing robot, N, during which the slip of the feet is measured."""


@dataclass(frozen=True)
class Stride:
    """Stride (one gait cycle) of the trot that `record_strides` has recorded: initial state and joint targets."""

    qpos: Floats
    """MuJoCo's generalized positions `qpos` at the start of the stride, (nq,), with nq positions of the robot."""
    qvel: Floats
    """MuJoCo's generalized velocities `qvel` at the start of the stride, (nv,), with nv velocities of the robot."""
    warmstart: Floats
    """Accelerations `qacc_warmstart` with which MuJoCo's solver starts, (nv,), one for each of the nv velocities."""
    targets: Floats
    """Joint targets at each control step of the stride, (steps, 12), rad."""


@dataclass(frozen=True)
class Accuracy:
    """Accuracy of one physics setting, made by `measure_accuracy`.

    The first three fields compare simulated strides with the same strides in the reference simulation. Each of them is
    the largest deviation over all recorded strides. `bars.ACCURACY_BARS` has the limit of each field.
    """

    trunk_mm: float
    """Largest distance between the trunk positions of a stride and of its reference simulation, mm."""
    tilt_rad: float
    """Largest angle between the trunk orientations of a stride and of its reference simulation, rad."""
    joints_rad: float
    """Largest difference between the joint angles of a stride and of its reference simulation, rad."""
    penetration_mm: float
    """Largest penetration depth of a standing foot in the ground, mm."""
    slip_mm_s: float
    """Largest slip speed of a standing foot while the lateral force SIDE_LOAD acts on the trunk, mm/s."""

    @property
    def is_within_bars(self) -> bool:
        """True if every field is within its limit in `bars.ACCURACY_BARS`."""
        return all(limit.is_met(getattr(self, name)) for name, limit in ACCURACY_BARS.items())


def record_strides(commands: tuple[tuple[float, float, float], ...] = COMMANDS) -> tuple[Stride, ...]:
    """Record one stride of the trot for each velocity command, after SETTLING_STEPS control steps.

    Args:
        commands: Velocity commands: forward, m/s, left, m/s, and yaw rate, rad/s.

    Returns:
        One stride for each command, simulated in the shipped environment on flat ground.
    """
    return tuple(_stride(command) for command in commands)


def _stride(command: tuple[float, float, float]) -> Stride:
    """Record one stride of the trot at a velocity command: forward, m/s, left, m/s, and yaw rate, rad/s."""
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
    """Measure the accuracy of a physics setting.

    Args:
        setting: Physics setting.
        recorded_strides: Strides to simulate with the setting and with the reference model.
        reference: Function that changes the specification of the shipped model to the reference model.

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
    """Compute the largest deviations between simulations of the same stride with two models.

    Args:
        model: Model of the examined physics setting.
        reference: Reference model.
        stride: Stride to simulate.

    Returns:
        trunk: Distance between the trunk positions, mm.
        tilt: Angle between the trunk orientations, rad.
        joints: Difference between the joint angles, rad.
    """
    positions = replay_stride(model, stride)
    true_positions = replay_stride(reference, stride)
    trunk = np.linalg.norm(positions[:, :3] - true_positions[:, :3], axis=1).max()
    quaternion_product = np.abs((positions[:, 3:7] * true_positions[:, 3:7]).sum(axis=1))
    tilt = 2 * np.arccos(np.minimum(quaternion_product, 1.0)).max()
    return trunk * 1e3, tilt, np.abs(positions[:, 7:] - true_positions[:, 7:]).max()


def replay_stride(model: mujoco.MjModel, stride: Stride) -> Floats:
    """Simulate a stride with a model, and return MuJoCo's `qpos` after each control step, (steps, nq)."""
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
    """Simulate a robot that stands still, and measure penetration and slip of the feet.

    Args:
        model: Model of the examined physics setting.

    Returns:
        penetration: Largest penetration depth of a foot in the ground, mm.
        slip: Largest horizontal speed of a foot while SIDE_LOAD acts on the trunk, mm/s.
    """
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
    """Simulate a time of `seconds` with constant control inputs and external forces."""
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
