"""`python -m benchmarks.physics`: what each physics setting costs and gives up, against the shipped ones.

Speed is the median ratio of runs interleaved A B A B. The deviation is that of one trot stride from a reference with a
4x finer timestep and a fully converged Newton solver.
"""

import statistics
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from quad_env.robot import HOME_POSE, LEG_NAMES, MODEL_PATH

Floats = NDArray[np.float64]
SHIPPED = "shipped"
ROBOTS, TICKS, REPEATS = 128, 60, 5


def _options(**values: Any) -> Callable[[mujoco.MjSpec], None]:
    def change(spec: mujoco.MjSpec) -> None:
        for name, value in values.items():
            setattr(spec.option, name, value)

    return change


def _gains(stiffness: float, damping: float) -> Callable[[mujoco.MjSpec], None]:
    def change(spec: mujoco.MjSpec) -> None:
        for actuator in spec.actuators:
            actuator.gainprm[0], actuator.biasprm[1], actuator.biasprm[2] = stiffness, -stiffness, -damping

    return change


def _no_self_collision(spec: mujoco.MjSpec) -> None:
    for geom in spec.geoms:
        if geom.contype and geom.name != "ground":
            geom.conaffinity = 2


NEWTON = int(mujoco.mjtSolver.mjSOL_NEWTON)
PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
VARIANTS: dict[str, Callable[[mujoco.MjSpec], None]] = {
    SHIPPED: _options(),
    "Newton": _options(solver=NEWTON, iterations=100),
    "PGS, 10 sweeps": _options(iterations=10),
    "pyramidal cone": _options(cone=PYRAMIDAL, impratio=1),
    "impratio 1": _options(impratio=1),
    "timestep 1 ms": _options(timestep=0.001),
    "kp 100, kv 4": _gains(100, 4),
    "kp 200, kv 8": _gains(200, 8),
    "kp 400, kv 12": _gains(400, 12),
    "no self-collision": _no_self_collision,
}


def compiled(*changes: Callable[[mujoco.MjSpec], None]) -> mujoco.MjModel:
    """The robot with those changes."""
    spec = mujoco.MjSpec.from_file(str(MODEL_PATH))
    for change in changes:
        change(spec)
    return spec.compile()


def targets(tick: int) -> Floats:
    """Joint targets (12,) of a plain trot of 2.5 Hz, blended in from home over 0.2 s."""
    swing = np.sin(2 * np.pi * 2.5 * tick * 0.01)
    lift = np.maximum(0.0, np.array([swing, -swing, -swing, swing]))
    sway = np.cos(2 * np.pi * 2.5 * tick * 0.01) * np.array([1, -1, -1, 1])
    move = lift[:, None] * np.array([0.0, 0.3, -0.6]) + sway[:, None] * np.array([0.0, 0.15, 0.0])
    return HOME_POSE + min(1.0, tick / 20) * move.ravel()


def at_home(model: mujoco.MjModel) -> mujoco.MjData:
    """The robot in the home keyframe."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    return data


def advance(model: mujoco.MjModel, data: mujoco.MjData, seconds: float) -> None:
    """Step for that long."""
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)


def stride(model: mujoco.MjModel) -> Floats:
    """Trunk position and joint angles each 10 ms of 0.4 s, (40, 15)."""
    data, rows = at_home(model), []
    for tick in range(40):
        data.ctrl[:] = targets(tick)
        advance(model, data, 0.01)
        rows.append(np.concatenate((data.qpos[:3], data.qpos[7:])))
    return np.array(rows)


def standing(model: mujoco.MjModel) -> tuple[float, float, float, float]:
    """Joint error, rad; settling time to 1 mm, s; creep under a 20 N side load, mm/s; penetration, mm."""
    data, heights = at_home(model), []
    for _ in range(200):
        advance(model, data, 0.01)
        heights.append(data.qpos[2])
    late = np.flatnonzero(np.abs(np.array(heights) - heights[-1]) > 0.001)
    error = np.abs(data.qpos[7:] - HOME_POSE).max()
    data.xfrc_applied[model.body("base_link").id, 1] = 20.0
    advance(model, data, 0.5)
    feet = [model.site(f"{leg}_foot").id for leg in LEG_NAMES]
    before = data.site_xpos[feet].copy()
    advance(model, data, 1.0)
    creep = np.linalg.norm((data.site_xpos[feet] - before)[:, :2], axis=1).max()
    settling = 0.01 * (late.max() + 1) if len(late) else 0.0
    return float(error), settling, float(creep) * 1000, float(0.02 - data.site_xpos[feet, 2].min()) * 1000


def seconds_per_run(batch: Batch, model: mujoco.MjModel) -> float:
    """Time of TICKS control steps of ROBOTS trotting robots."""
    batch.reset(keyframe=0)
    controls, noise = batch.bind("ctrl"), np.random.default_rng(0)
    begin = time.perf_counter()
    for tick in range(TICKS):
        controls[:] = targets(tick) + noise.normal(0, 0.02, (ROBOTS, 12))
        batch.step(nstep=round(0.01 / model.opt.timestep))
    return time.perf_counter() - begin


def main() -> None:
    """Print the table."""
    models = {name: compiled(change) for name, change in VARIANTS.items()}
    batches = {name: Batch(model, ROBOTS, 2) for name, model in models.items()}
    times: dict[str, list[float]] = {name: [] for name in models}
    for _ in track(range(REPEATS), description="speed"):
        for name, model in models.items():
            times[name].append(seconds_per_run(batches[name], model))
    table = Table(title="Physics settings")
    for head in ("setting", "speed", "trunk mm", "joints rad", "sag rad", "settles s", "creep mm/s", "sinks mm"):
        table.add_column(head, justify="left" if head == "setting" else "right")
    fine = _options(timestep=0.0005, solver=NEWTON, iterations=100, tolerance=1e-10)
    for name, model in models.items():
        ratio = statistics.median(a / b for a, b in zip(times[SHIPPED], times[name], strict=True))
        error = stride(model) - stride(compiled(VARIANTS[name], fine))
        trunk = np.linalg.norm(error[:, :3], axis=1).max() * 1000
        figures = (ratio, trunk, np.abs(error[:, 3:]).max(), *standing(model))
        table.add_row(name, *(f"{value:.3f}" for value in figures))
    console = Console(width=110)
    console.print(table)
    rate = ROBOTS * TICKS / statistics.median(times[SHIPPED])
    console.print(f"shipped: {rate:.0f} control steps/s with {ROBOTS} robots on 2 threads, MuJoCo {mujoco.__version__}")


if __name__ == "__main__":
    main()
