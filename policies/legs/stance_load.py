"""Joint targets of a leg that carries a load: a servo gives way under it, and the targets make up for that."""

import numpy as np

from policies.gait import Floats
from quad_env.robots.robot import Robot


def held_up(
    robot: Robot, hip: Floats, thigh: Floats, calf: Floats, x: Floats, y: Floats, force: Floats
) -> tuple[Floats, Floats, Floats]:
    """Targets whose joints rest at the given angles under an upward force, N, on a foot at x, y in its hip frame.

    A servo of stiffness k holds its target up to torque/k, and the torque is the force times ∂z/∂(joint), which is
    y for the hip, -x cos(hip) for the thigh and L2 sin(thigh + calf) cos(hip) for the calf.
    """
    give = force / robot.servo_stiffness
    give_in_plane = give * np.cos(hip)
    return hip - give * y, thigh + give_in_plane * x, calf - give_in_plane * robot.calf_length * np.sin(thigh + calf)
