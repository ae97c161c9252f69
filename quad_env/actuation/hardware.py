"""Choice of the hardware profile of each robot: realistic motors, delays, sensors and state estimator.

A simulated robot has its hardware profile if the field `Scenario.hardware` of its scenario is True.
"""

import math
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

from quad_env.actuation.models import ACTUATORS, Actuator, TorqueSpeed
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

DELAY = 0.005
"""Time from the output of a joint target by the policy to its effect on the servo, s.

`hardware_profile` rounds this time up to whole physics steps. The sensors add their own delays.
"""
SENSORS = "typical"
"""Sensor suite of the hardware profile, a name in `quad_env.SENSORS`; it delays every sensor by one control step."""
ESTIMATOR = "kalman"
"""State estimator of the hardware profile, a name in `quad_env.ESTIMATORS`.

This estimator was chosen on episodes that are reserved for validation. Under pushes, policies succeeded in more
episodes than with the estimator `complementary`. On rough ground, the policies succeeded in equally many episodes.
"""
# Peak torques and speeds are from unitreerobotics/unitree_ros, go1_description and go2_description, xacro/const.xacro.
# The torque of a calf motor is 1.5 times as large at the joint, because a linkage multiplies it.
# The torque-speed line is from the manufacturer's unitree_rl_lab, assets/robots/unitree_actuators.py, motor Go2HV.
# The line gives 20.2 N·m at 13.5 rad/s and 0 N·m at 30 rad/s, so the stall torque is 20.2 · 30 / (30 - 13.5) N·m.
_GO = TorqueSpeed(stall_torque=(36.7, 36.7, 55.1), no_load_speed=(30.1, 30.1, 20.06), peak_torque=(23.7, 23.7, 35.55))
CURVES = {"go1": _GO, "go2": _GO}
"""Name of a robot -> published torque-speed curve of its hip, thigh and calf motors.

For all other robots, the torque limit falls along a straight line: from the rated torque at standstill to 0 at the
rated speed.
"""


class HardwareProfile(NamedTuple):
    """Realistic motors, sensors and state estimator of a robot, as values for the arguments of `gym.make`."""

    actuator: Actuator
    sensors: str
    """Name of the sensor suite in `quad_env.SENSORS`."""
    estimator: str
    """Name of the estimator in `quad_env.ESTIMATORS`."""


@lru_cache(maxsize=32)
def hardware_profile(robot: Robot) -> HardwareProfile:
    """Return the hardware profile of a `robot`: realistic motors, sensors and state estimator.

    SimpleQuad has the motor `ACTUATORS["motor"]` with 100 N·m and 10 rad/s, as in the article on the robot. Other
    robots have motors with the same bandwidth. The motors of the other robots have no thermal model, because no
    manufacturer publishes thermal parameters.
    """
    timestep = float(robot.model.opt.timestep)
    motor = ACTUATORS["motor"]
    if robot != SIMPLE_QUAD:
        curve = CURVES.get(robot.name) if robot.source is None else None
        motor = Actuator(curve or TorqueSpeed(), bandwidth=motor.bandwidth)
    delay = timestep * math.ceil(round(DELAY / timestep, 6))
    return HardwareProfile(replace(motor, delay=delay), SENSORS, ESTIMATOR)
