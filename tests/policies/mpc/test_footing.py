"""The ground that footprints show."""

import numpy as np

from policies.mpc.footing import Footprints
from policies.mpc.motion import motion
from quad_env.physics.dynamics import Dynamics
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.policies.readings import reading


def test_the_slope_turns_with_the_heading_frame() -> None:
    """A robot that turns at 1.5 rad/s on a slope: a mean in a frame that turns would be 0.1 off."""
    prints, yaw_rate, period, rise = Footprints(slope_time=0.3, period=0.01), 1.5, 0.01, 0.25
    now = motion(SIMPLE_QUAD, Dynamics(SIMPLE_QUAD), reading(1, angular_velocity=(0.0, 0.0, yaw_rate)))
    uphill = np.zeros(2)
    for step in range(300):
        uphill = rise * np.array([np.cos(yaw_rate * period * step), -np.sin(yaw_rate * period * step)])
        feet = now.bodies.feet.copy()
        feet[..., 2] = -0.4 + feet[..., :2] @ uphill
        ground = prints.ground(now._replace(bodies=now.bodies._replace(feet=feet)), np.ones((1, 4), np.bool_))
    np.testing.assert_allclose([ground.forward[0], ground.lateral[0]], uphill, atol=0.01)
