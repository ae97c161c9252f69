"""Whether the robot stands: it holds its home pose for two seconds, and then squats."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quad_env.doctor.check import Finding, Subject, ok, problem
from quad_env.robots.similarity import servo_gains

STAND_TIME = 2.0
"""s"""
LARGEST_TILT, LARGEST_SINK = 0.1, 0.2
"""Of a robot that stands: rad, and a share of its height."""
LARGEST_LAG = 0.1
"""Of a joint from its target under the robot's weight, rad."""
RESERVE = 1.25
"""Factor on the stiffness that would just hold the joints at `LARGEST_LAG`"""
FULL_LOAD = 0.95
"""Share of the rated torque at which a joint has no reserve."""
RINGING = 1.0
"""Root mean square of all joint speeds at rest in the squat, rad/s; of a robot by name at most 0.3"""
SETTLED = 0.5
"""s until it has come to rest in the squat"""
LAST = 0.2
"""s before an end that are looked at"""
SQUAT = 0.1
"""Step of the thighs' targets, and half of the calves', rad"""


def stands(subject: Subject) -> Finding:
    """Whether the joints hold their targets under the robot's weight and come to rest, and the robot stands."""
    env, robot, figures = subject.env, subject.env.robot, subject.figures
    stiffness, damping = servo_gains(robot)
    env.reset(seed=0, options={"command": np.zeros(3)})
    at_rest = states(env, robot.home_pose, STAND_TIME)[-round(LAST / env.dt) :]
    lags = np.abs(np.mean([state.joint_position - robot.home_pose for state in at_rest], axis=0))
    torque = np.abs(np.mean([state.joint_torque for state in at_rest], axis=0)).max()
    held = f"standing, {robot.joint_names[int(lags.argmax())]} is {lags.max():.3f} rad off its target"
    springs = float(robot.model.jnt_stiffness.max())
    sprung = f"springs of the joints, up to {springs:g} N·m/rad, pull them off their targets"
    if torque > FULL_LOAD * robot.rated_torque:
        held = f"standing takes all of the joints' {robot.rated_torque:g} N·m, for {robot.mass:.3g} kg"
        cause = "masses are too large (grams for kilograms?), or the largest torque is too small"
        what = "mass of the bodies"
        if springs > 0.0:
            cause, what = sprung, "stiffness and springref of the joints"
        return problem(held, cause, f"{what} in {robot.mjcf}, or rated_torque in {figures}")
    if lags.max() > LARGEST_LAG:
        cause = f"a stiffness of {robot.servo_stiffness.min():g} N·m/rad is too little for {robot.mass:.3g} kg"
        wanted = max(stiffness, RESERVE * robot.servo_stiffness.max() * lags.max() / LARGEST_LAG)
        remedy = f"servo_stiffness = {wanted:.0f} or so in {figures}"
        if springs > 0.0:
            cause, remedy = sprung, f"stiffness and springref of the joints in {robot.mjcf}, or {remedy}"
        return problem(held, cause, remedy)
    if (ringing := _ringing(env)) > RINGING:
        moving = f"half a second after a step of their targets the joints still move at {ringing:.1f} rad/s"
        gains = f"{robot.servo_damping.min():g} N·m·s/rad is too little for {robot.servo_stiffness.max():g} N·m/rad"
        remedy = f"servo_stiffness = {stiffness:.0f} and servo_damping = {damping:.1f} or so in {figures}"
        return problem(moving, f"a damping of {gains}", remedy)
    height, tilt = at_rest[-1].height, math.acos(min(max(at_rest[-1].rotation[2][2], -1.0), 1.0))
    trunk = f"its trunk is {height:.3f} m high and tilted by {tilt:.3f} rad"
    if tilt > LARGEST_TILT or height < (1.0 - LARGEST_SINK) * robot.home_height:
        cause = "in the home pose the feet are not below the centre of mass, or a mass is not where it should be"
        remedy = f"home_pose in {figures}, or masses in {robot.mjcf}; describe --picture shows it"
        return problem(f"it does not stand: {trunk}", cause, remedy)
    return ok(f"{trunk}; {held}, with {100.0 * torque / robot.rated_torque:.0f} % of the largest torque")


def _ringing(env: Any) -> float:
    """Root mean square of all joint speeds at the end of a squat, rad/s."""
    robot = env.robot
    step = SQUAT * np.array([[0.0, -knee, 2.0 * knee] for knee in robot.knee_direction]).ravel()
    squatting = states(env, robot.home_pose + step, SETTLED)[-round(LAST / env.dt) :]
    return float(np.sqrt(np.mean(np.square([state.joint_velocity for state in squatting]))))


def states(env: Any, target: NDArray[np.float64], seconds: float) -> list[Any]:
    """States of the robot of a single environment while it holds a target for so long."""
    found = []
    for _ in range(round(seconds / env.dt)):
        env.step(target.astype(np.float32))
        found.append(env.simulation.state((0.0, 0.0, 0.0), None))
    return found
