"""Gains, contact and solver settings have the effects that the XML states."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from quad_env.robots.simple_quad import SIMPLE_QUAD

Trace = NDArray[np.float64]


def load(**options: float) -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_path(str(SIMPLE_QUAD.mjcf))
    for name, value in options.items():
        setattr(model.opt, name, value)
    return model


def at_home(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    return data


def run(model: mujoco.MjModel, data: mujoco.MjData, seconds: float) -> None:
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)


def stride(model: mujoco.MjModel) -> Trace:
    """Return trunk position and joint angles over one stride of 0.4 s in place, one row per 10 ms."""
    data, rows = at_home(model), []
    for tick in range(40):
        swing = np.sin(2 * np.pi * 2.5 * tick * 0.01)
        lift = np.maximum(0.0, np.array([swing, -swing, -swing, swing]))
        data.ctrl[:] = (SIMPLE_QUAD.home_pose.reshape(4, 3) + lift[:, None] * np.array([0.0, 0.3, -0.6])).ravel()
        run(model, data, 0.01)
        rows.append(np.concatenate((data.qpos[:3], data.qpos[7:])))
    return np.array(rows)


def test_standing_settles_fast_and_holds_the_weight() -> None:
    model = load()
    assert model.opt.timestep == 0.002
    data = at_home(model)
    run(model, data, 0.1)
    early = data.qpos[2]
    run(model, data, 2.0)
    assert abs(early - data.qpos[2]) < 0.001  # settled to a millimetre after 0.1 s
    assert np.abs(data.qpos[7:] - SIMPLE_QUAD.home_pose).max() < 0.02
    assert np.abs(data.qvel).max() < 1e-3  # without chatter


def test_a_standing_foot_neither_sinks_nor_creeps_under_a_side_load() -> None:
    model = load()
    data = at_home(model)
    run(model, data, 1.0)
    data.xfrc_applied[model.body("base_link").id, 1] = 20.0
    run(model, data, 0.5)
    sites = [model.site(f"{leg}_foot").id for leg in SIMPLE_QUAD.leg_names]
    before = data.site_xpos[sites].copy()
    run(model, data, 1.0)
    after = data.site_xpos[sites]
    assert np.linalg.norm((after - before)[:, :2], axis=1).max() < 0.001  # m in one second
    assert 0.02 - after[:, 2].min() < 0.002


def test_a_stride_agrees_with_a_four_times_finer_timestep() -> None:
    coarse, fine = stride(load()), stride(load(timestep=0.0005, solver=2, iterations=100, tolerance=1e-10))
    assert np.linalg.norm(coarse[:, :3] - fine[:, :3], axis=1).max() < 0.002
    assert np.abs(coarse[:, 3:] - fine[:, 3:]).max() < 0.01
