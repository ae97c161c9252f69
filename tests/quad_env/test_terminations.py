"""The fall rule simple-quad/1, at its limits."""

from dataclasses import replace

import numpy as np
import pytest

from quad_env.config import FallRule
from quad_env.simulation import Simulation
from quad_env.state import QuadState, rotation_matrix
from quad_env.terminations import fall_reasons
from quad_env.terrain import Flat


@pytest.fixture(scope="module")
def standing() -> QuadState:
    simulation = Simulation(Flat(), 1, 1, 100.0)
    simulation.reset(np.arange(1), np.zeros((1, 35)))
    simulation.step(np.zeros((1, 12)), np.zeros((1, 2)), np.ones(1, bool))
    return simulation.state(np.zeros((1, 3)))


def tilted(state: QuadState, degrees: float, axis: int) -> QuadState:
    quaternion = np.zeros((1, 4))
    quaternion[0, 0], quaternion[0, 1 + axis] = np.cos(np.deg2rad(degrees) / 2), np.sin(np.deg2rad(degrees) / 2)
    return replace(state, rotation=rotation_matrix(quaternion))


def test_a_standing_robot_has_not_fallen(standing: QuadState) -> None:
    assert fall_reasons(standing, FallRule())[0] is None


@pytest.mark.parametrize("axis", [0, 1])
def test_tilt_counts_from_70_degrees_in_roll_and_pitch_alike(standing: QuadState, axis: int) -> None:
    assert fall_reasons(tilted(standing, 69.9, axis), FallRule())[0] is None
    assert fall_reasons(tilted(standing, 70.1, axis), FallRule())[0] == "tilt"


def test_yaw_is_no_tilt(standing: QuadState) -> None:
    assert fall_reasons(tilted(standing, 179.0, 2), FallRule())[0] is None


def test_height_counts_below_12_cm_above_the_terrain(standing: QuadState) -> None:
    assert fall_reasons(replace(standing, height=np.array([0.121])), FallRule())[0] is None
    assert fall_reasons(replace(standing, height=np.array([0.119])), FallRule())[0] == "height"


def test_a_dropped_trunk_touches_the_ground_in_the_simulation() -> None:
    simulation = Simulation(Flat(), 1, 1, 100.0)
    simulation.reset(np.arange(1), np.zeros((1, 35)))
    reasons = set()
    folded = np.tile([0.0, 1.5, -2.5], 4)[None]
    for _ in range(200):
        simulation.step(folded * [[0, -1, 1] * 4], np.zeros((1, 2)), np.ones(1, bool))
        reasons.add(fall_reasons(simulation.state(np.zeros((1, 3))), FallRule())[0])
    assert reasons - {None}
