"""Hardware profile of a robot: motors, sensors and estimator like the real robot's; see `Scenario.hardware`."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

from quad_env.actuation.models import ACTUATORS, Actuator, TorqueSpeed
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

DELAY = 0.005
"""s. Delay from a policy to the servos, rounded up to whole physics steps. The sensors add their own."""
SENSORS = "typical"
"""Name in `quad_env.SENSORS`; each sensor is read one control step late."""
ESTIMATOR = "kalman"
"""Name in `quad_env.ESTIMATORS`; on validation episodes more succeed under pushes, and as many on rough ground."""
# Peak torques and speeds: unitreerobotics/unitree_ros, go1_description and go2_description, xacro/const.xacro; a calf's
# linkage gives 1.5 times the torque. The torque-speed line: the maker's unitree_rl_lab, assets/robots/
# unitree_actuators.py, Go2HV: 20.2 N·m up to 13.5 rad/s, 0 N·m at 30 rad/s. Its stall torque is
# 20.2 · 30 / (30 - 13.5) N·m.
_GO = TorqueSpeed(stall_torque=(36.7, 36.7, 55.1), no_load_speed=(30.1, 30.1, 20.06), peak_torque=(23.7, 23.7, 35.55))
CURVES = {"go1": _GO, "go2": _GO}
"""Torque-speed curves of hip, thigh and calf, of robots with published ones. The curve of another robot leads from its
rated torque at standstill to 0 at its rated speed."""


class HardwareProfile(NamedTuple):
    """Arguments of an environment with the hardware profile of a robot."""

    actuator: Actuator
    sensors: str
    """Name in `quad_env.SENSORS`."""
    estimator: str
    """Name in `quad_env.ESTIMATORS`."""


@lru_cache(maxsize=32)
def hardware_profile(robot: Robot) -> HardwareProfile:
    """Return the hardware profile of a `robot`.

    SimpleQuad has 100 N·m and 10 rad/s, as in its article, and all else of `ACTUATORS["motor"]`. Other robots have its
    bandwidth, and windings that stay cold: no maker publishes their thermal parameters.
    """
    timestep = float(robot.model.opt.timestep)
    motor = ACTUATORS["motor"]
    if robot != SIMPLE_QUAD:
        curve = CURVES.get(robot.name) if robot.source is None else None
        motor = Actuator(curve or TorqueSpeed(), bandwidth=motor.bandwidth)
    delay = timestep * math.ceil(round(DELAY / timestep, 6))
    return HardwareProfile(replace(motor, delay=delay), SENSORS, ESTIMATOR)
