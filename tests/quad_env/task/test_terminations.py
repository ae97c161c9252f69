"""The fall rule simple-quad/1 at its limits."""

import math

import numpy as np
import pytest

from quad_env.config import FALL_REASONS, FallRule
from quad_env.physics.simulation import Simulation
from quad_env.physics.state import QuadState, rotation_matrix
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.scenario import Scenario
from quad_env.task.terminations import fall_reason_code

TILT, HEIGHT = FALL_REASONS.index("tilt"), FALL_REASONS.index("height")


@pytest.fixture(scope="module")
def standing() -> QuadState[float]:
    simulation = Simulation(SIMPLE_QUAD, Scenario("made"))
    simulation.reset(np.arange(1), np.zeros((1, 35)))
    simulation.step(np.zeros((1, 12)), np.zeros((1, 2)))
    return simulation.state((0.0, 0.0, 0.0), None)


def tilted(state: QuadState[float], degrees: float, axis: int) -> QuadState[float]:
    quaternion = [math.cos(math.radians(degrees) / 2), 0.0, 0.0, 0.0]
    quaternion[1 + axis] = math.sin(math.radians(degrees) / 2)
    return state._replace(rotation=rotation_matrix(quaternion))


def test_a_standing_robot_has_not_fallen(standing: QuadState) -> None:
    assert fall_reason_code(standing, FallRule(), 0.12) == 0
    assert fall_reason_code(tilted(standing, 179.0, 2), FallRule(), 0.12) == 0  # yaw does not count as tilt


@pytest.mark.parametrize("axis", [0, 1])
def test_tilt_counts_from_70_degrees_in_roll_and_pitch_alike(standing: QuadState, axis: int) -> None:
    assert fall_reason_code(tilted(standing, 69.9, axis), FallRule(), 0.12) == 0
    assert fall_reason_code(tilted(standing, 70.1, axis), FallRule(), 0.12) == TILT


def test_height_counts_below_12_cm_above_the_terrain(standing: QuadState) -> None:
    assert fall_reason_code(standing._replace(height=0.121), FallRule(), 0.12) == 0
    assert fall_reason_code(standing._replace(height=0.119), FallRule(), 0.12) == HEIGHT


def test_of_two_reasons_the_first_counts_for_one_robot_and_in_a_batch(standing: QuadState[float]) -> None:
    low, tilted_and_low = standing._replace(height=0.1), tilted(standing, 80.0, 0)._replace(height=0.1)
    states = (standing, low, tilted_and_low, tilted_and_low._replace(trunk_contact=True))
    codes = [fall_reason_code(state, FallRule(), 0.12) for state in states]
    assert [FALL_REASONS[code] for code in codes] == ["none", "height", "tilt", "trunk_contact"]
    batch = QuadState(*(np.moveaxis(np.array(readings), 0, -1) for readings in zip(*states, strict=True)))
    assert fall_reason_code(batch, FallRule(), 0.12).tolist() == codes
