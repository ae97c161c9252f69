"""Option `servo` of the functions that make policies: it selects servo gains, and rejects other gains."""

from typing import Any

from policies.base import Policy, PolicyError
from quad_env.robots.robot import Robot

OWN = "own"
"""Value of the option `servo` for the servo gains that the policy chooses itself."""


def with_servo_option(robot: Robot, servo: Any) -> Robot:
    """Return a robot with the servo gains that the option `servo` selects.

    Args:
        robot: Robot for which a policy is made.
        servo: None for the gains of the robot, "stiff" for its gains `Robot.stiff_servo`, or a pair of stiffness,
            N·m/rad, and damping, N·m·s/rad, as in `gym.make`. "own" leaves the choice to the policy.

    Returns:
        The robot with the selected gains; the unchanged robot if `servo` is None or "own".

    Raises:
        PolicyError: The option is not valid.
    """
    if servo is None or (isinstance(servo, str) and servo == OWN):
        return robot
    try:
        return robot.with_servo(*robot.servo_gains(servo)[:, 0])
    except ValueError as error:
        raise PolicyError(str(error), f'a policy also takes servo="{OWN}", for gains of its own') from None


def check_servo(policy: Policy, robot: Robot, servo: Any) -> None:
    """Check that a policy commands the servo gains of a robot, unless the option `servo` is "own".

    Args:
        policy: Policy that was made for the robot.
        robot: Robot with the servo gains of an environment that is made with the same options `robot` and `servo`.
        servo: Option `servo`, as in `with_servo_option`.

    Raises:
        PolicyError: The policy commands other servo gains than the robot has. The message names the remedy.
    """
    if isinstance(servo, str) and servo == OWN:
        return
    own = policy.robot
    if own.has_gains(robot.gains):
        return
    remedy = f'make it with servo="{OWN}" and its environment with robot=policy.robot'
    if own.has_gains(robot.stiff_servo):
        remedy = 'make it and its environment with servo="stiff"'
    raise PolicyError(f"{policy.name} commands servos of {own.servo}, but {robot.name} has {robot.servo}", remedy)
