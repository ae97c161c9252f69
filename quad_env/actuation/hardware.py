"""The hardware profile of a robot: motors, sensors and estimator like the real one's, see `Scenario.hardware`."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

from quad_env.actuation.models import ACTUATORS, Actuator, TorqueSpeed
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

DELAY = 0.005
"""s from a policy to the servos, rounded up to whole physics steps; the way back is that of the sensors."""
SENSORS, ESTIMATOR = "typical", "kalman"
"""Names of `quad_env.SENSORS`, each reading a control step late, and of `quad_env.ESTIMATORS`: the one with which more
validation episodes succeed under pushes, and as many on rough ground."""
# Peak torques and speeds: unitreerobotics/unitree_ros, go1_description and go2_description, xacro/const.xacro; a calf's
# linkage gives 1.5 times the torque. The line: the maker's unitree_rl_lab, assets/robots/unitree_actuators.py, Go2HV:
# 20.2 N·m up to 13.5 rad/s, none at 30 rad/s, which meets standstill at 20.2 · 30 / (30 - 13.5) N·m.
_GO = TorqueSpeed(stall_torque=(36.7, 36.7, 55.1), no_load_speed=(30.1, 30.1, 20.06), peak_torque=(23.7, 23.7, 35.55))
CURVES = {"go1": _GO, "go2": _GO}
"""Hip, thigh and calf of robots whose makers publish them. Of others the line leads from the rated torque at standstill
to none at the rated speed."""


class HardwareProfile(NamedTuple):
    """Arguments of an environment."""

    actuator: Actuator
    sensors: str
    estimator: str


@lru_cache(maxsize=32)
def hardware_profile(robot: Robot) -> HardwareProfile:
    """That of a robot. SimpleQuad has 100 N·m and 10 rad/s, as in its article, and all else of `ACTUATORS["motor"]`.

    Others have its bandwidth and cold windings: no maker publishes how theirs heat.
    """
    step, motor = float(robot.model.opt.timestep), ACTUATORS["motor"]
    if robot != SIMPLE_QUAD:
        curve = CURVES.get(robot.name) if robot.source is None else None
        motor = Actuator(curve or TorqueSpeed(), bandwidth=motor.bandwidth)
    delay = step * math.ceil(round(DELAY / step, 6))
    return HardwareProfile(replace(motor, delay=delay), SENSORS, ESTIMATOR)
