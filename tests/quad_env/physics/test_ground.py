"""Friction and softness of the ground, each measured on a standing robot."""

import numpy as np
import pytest

from quad_env.physics.simulation import Simulation
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Ground
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import Flat, Stairs, Terrain

WEIGHT = SIMPLE_QUAD.mass * 9.81


def stand(simulation: Simulation, steps: int, force: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Return the feet of a robot that stood in its home pose under a constant force on its trunk, (4, 3)."""
    simulation.reset(np.arange(1), np.zeros((1, 35)), np.array([force]))
    for _ in range(steps):
        simulation.step(SIMPLE_QUAD.home_pose[None], None)
    data = simulation.snapshot(0)
    return np.array([data.site(f"{leg}_foot").xpos for leg in SIMPLE_QUAD.leg_names])


@pytest.mark.parametrize(("terrain", "depth"), [(Flat(), 0.005), (Stairs(), 0.08)])
def test_standing_feet_sink_to_the_depth_that_was_asked_for(terrain: Terrain, depth: float) -> None:
    feet = stand(Simulation(SIMPLE_QUAD, Scenario("made", terrain=terrain, ground=Ground(sink_depth=depth))), 300)
    assert SIMPLE_QUAD.foot_radius - feet[:, 2].mean() == pytest.approx(depth, rel=0.05)


@pytest.mark.parametrize(("terrain", "friction"), [(Flat(), 0.1), (Stairs(), 0.3)])
def test_a_robot_slides_where_the_side_force_exceeds_friction_times_weight(terrain: Terrain, friction: float) -> None:
    def slid(share: float) -> float:
        simulation = Simulation(SIMPLE_QUAD, Scenario("made", terrain=terrain, ground=Ground(friction=friction)))
        side = (0.0, share * friction * WEIGHT)
        return float((stand(simulation, 150, side) - stand(simulation, 50, side))[:, 1].mean())

    assert slid(0.8) < 0.01
    assert slid(1.25) > 0.5 * 0.25 * friction * 9.81 * (1.5**2 - 0.5**2) / 2
