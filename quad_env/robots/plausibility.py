"""Figures of a robot that no real one has: most often a placeholder, or a model in other units. Nothing is refused."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from quad_env.config import GRAVITY
from quad_env.robots.kinematics import foot_positions
from quad_env.robots.robot import Robot

SHORTEST, LONGEST = 0.05, 3.0
"""Legs of quadrupeds with twelve joints, m."""
STRONGEST = 2.5
"""Largest torque in m·g·L, weight times leg length: SimpleQuad has 1.2, the robots of the `robots` extra 0.2 to 0.6."""
LEAST_DAMPING, MOST_DAMPING = 0.1, 8.0
"""Damping ratios of a joint's servo with the leg's inertia in the home pose; 1 is critical."""


def warnings_of(robot: Robot) -> Iterator[str]:
    """What is hard to believe about a robot, a line each."""
    length, torque, need = robot.leg_length, robot.rated_torque, standing_torque(robot)
    if length > LONGEST:
        yield f"its legs are {length:.3g} m long: a model in millimetres? MJCF is in metres"
    elif length < SHORTEST:
        yield f"its legs are {length:.3g} m long: is the model in metres?"
    if torque > STRONGEST * robot.mass * GRAVITY * length:
        times = f"{torque / need:.0f} times what standing takes"
        yield f"its motors have {torque:.4g} N·m, {times}: a placeholder? Give rated_torque, N·m"
    elif torque < need:
        yield (
            f"its motors have {torque:.3g} N·m, and standing in the home pose takes {need:.3g} N·m: masses in another "
            "unit than kg? Check them, or give rated_torque, N·m"
        )
    ratios = damping_ratios(robot)
    least, most = int(ratios.argmin()), int(ratios.argmax())
    unlikely = {"little": least} if ratios[least] < LEAST_DAMPING else {}
    unlikely |= {"much": most} if ratios[most] > MOST_DAMPING else {}
    for word, joint in unlikely.items():
        yield (
            f"the servo of {robot.joint_names[joint]} has a damping ratio of {ratios[joint]:.2g}, very {word} "
            "(1 is critical): check servo_stiffness, N·m/rad, and servo_damping, N·m·s/rad"
        )


def standing_torque(robot: Robot) -> float:
    """Largest torque of a thigh or calf joint when four legs carry the robot at rest in the home pose, N·m."""
    foot = foot_positions(robot, robot.home_pose.reshape(1, -1, 3))[0]
    knee = -robot.thigh_length * np.sin(robot.home_pose[1::3])
    levers = np.abs(np.concatenate((foot[:, 0], foot[:, 0] - knee)))
    return float(0.25 * robot.mass * GRAVITY * levers.max())


def damping_ratios(robot: Robot) -> NDArray[np.float64]:
    """Of each joint, d / (2·√(k·I)), with the damping d and stiffness k of its servo and the inertia I that it moves in
    the home pose with all other joints at rest and the trunk held; shape (12,)."""
    import mujoco

    model, inertia = robot.model, np.empty((robot.model.nv, robot.model.nv))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    dofs = [int(model.joint(name).dofadr[0]) for name in robot.joint_names]
    damping = robot.servo_damping + model.dof_damping[dofs].reshape(len(dofs), -1)[:, 0]
    moved = np.diag(inertia)[dofs]
    return np.asarray(damping / (2.0 * np.sqrt(robot.servo_stiffness * moved)))
