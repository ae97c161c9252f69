"""The part of a height field that a free camera draws is the ground of the robots, for any shape of the field."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from quad_env.physics.model import compile_model
from quad_env.physics.rendering import DRAWN_HALF_WIDTH, TerrainPatch
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import HeightField

FIELDS = {  # rows, columns and size along x and y, m
    "tall": (100, 60, (6.0, 10.0)),
    "wide": (60, 100, (10.0, 6.0)),
    "cells that are no squares": (81, 81, (4.0, 20.0)),
    "larger than what is drawn": (301, 401, (40.0, 30.0)),
    "a strip": (2, 300, (30.0, 2.0)),
    "coarse": (5, 3, (60.0, 80.0)),
}


def field(name: str, folder: Path) -> HeightField:
    rows, columns, size = FIELDS[name]
    heights = np.random.default_rng(0).uniform(-0.1, 0.3, (rows, columns))
    heights[:, 0] += 0.5  # the side of least x
    heights[0] += 1.0  # the side of largest y
    np.save(folder / "hill.npy", heights)
    (folder / "hill.toml").write_text(f'file = "hill.npy"\nsize = {list(size)}\n', encoding="utf-8")
    return HeightField.from_toml(folder / "hill.toml")


def drawn_height(ground: TerrainPatch, data: mujoco.MjData, x: float, y: float) -> float:
    """Return the world height of the drawn surface, by a ray from above, m."""
    geom = np.flatnonzero(ground.model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD)[0]
    down = np.array((0.0, 0.0, -1.0))
    start = np.array((x, y, 50.0))
    hit = mujoco.mj_rayHfield(ground.model, data, int(geom), start, down, np.zeros(3))
    return 50.0 - hit


@pytest.mark.parametrize("name", FIELDS)
def test_the_drawn_surface_is_that_of_the_terrain(name: str, tmp_path: Path) -> None:
    terrain = field(name, tmp_path)
    model = compile_model(SIMPLE_QUAD, Scenario("made", terrain=terrain))
    ground = TerrainPatch(model)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(1)
    half = np.array(terrain.half)
    for corner in ((0.0, 0.0), (0.9, 0.9), (-0.9, 0.9), (0.9, -0.9)):
        target = corner * half
        assert ground.recenter((*target, 0.0)) or corner != (0.0, 0.0)
        ground.move(data)
        for _ in range(20):
            x, y = np.clip(target + rng.uniform(-0.7, 0.7, 2) * DRAWN_HALF_WIDTH / 2.0, -0.999 * half, 0.999 * half)
            expected = float(terrain.height(np.array(x), np.array(y)))
            assert drawn_height(ground, data, x, y) == pytest.approx(expected, abs=2e-3)
