"""Whether the robot stands: it holds its home pose for two seconds, and then squats."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from quad_env.describe import LARGEST_SINK, LARGEST_TILT, STAND_TIME, height_and_tilt, states
from quad_env.doctor.check import Finding, Subject, ok, problem
from quad_env.robots.similarity import servo_gains

LARGEST_LAG = 0.1
"""Of a joint from its target under the robot's weight, rad."""
FULL_LOAD = 0.95
"""Share of the rated torque at which a joint has no reserve."""
RINGING = 1.0
"""rad/s; of a robot by name at most 0.3"""
SETTLED = 0.5
"""s until it has come to rest in the squat"""
LAST = 0.2
"""s before an end that are looked at"""
SQUAT = 0.1
"""Step of the thighs' targets, and half of the calves', rad"""


@dataclass(frozen=True)
class Stand:
    """What was seen at the end of two seconds, and half a second after a step of the targets."""

    lag: float
    """Farthest joint from its target, mean over those moments, rad."""
    joint: str
    """Name of that joint."""
    load: float
    """Largest joint torque, mean over those moments, as a share of the rated torque."""
    height: float
    """Of the trunk at the end, m."""
    tilt: float
    """Of the trunk at the end, rad."""
    ringing: float
    """Root mean square of all joint speeds at rest in the squat, rad/s."""


@lru_cache(maxsize=1)
def stand(env: Any) -> Stand:
    """Stand on the home pose's targets, from the home pose, and then squat, without falls being an end."""
    robot = env.robot
    env.reset(seed=0, options={"command": np.zeros(3)})
    at_rest, last = states(env, robot.home_pose, STAND_TIME), slice(-round(LAST / env.dt), None)
    lag = np.abs(np.mean([state.joint_position - robot.home_pose for state in at_rest[last]], axis=0))
    torque = np.abs(np.mean([state.joint_torque for state in at_rest[last]], axis=0)).max()
    step = SQUAT * np.array([[0.0, -knee, 2.0 * knee] for knee in robot.knee_direction]).ravel()
    squatting = states(env, robot.home_pose + step, SETTLED)
    height, tilt = height_and_tilt(at_rest[-1])
    return Stand(
        lag=float(lag.max()),
        joint=robot.joint_names[int(lag.argmax())],
        load=float(torque) / robot.rated_torque,
        height=height,
        tilt=tilt,
        ringing=float(np.sqrt(np.mean(np.square([state.joint_velocity for state in squatting[last]])))),
    )


def servos(subject: Subject) -> Finding:
    """Whether the joints hold their targets under the robot's weight, and come to rest."""
    robot, seen = subject.env.robot, stand(subject.env)
    stiffness, damping = servo_gains(robot)
    held = f"standing, {seen.joint} is {seen.lag:.3f} rad off its target"
    if seen.load > FULL_LOAD:
        held = f"standing takes all of the joints' {robot.rated_torque:g} N·m, for {robot.mass:.3g} kg"
        cause = "masses are too large (grams for kilograms?), or the largest torque is too small"
        return problem(held, cause, f"mass of the bodies in {robot.mjcf}, or rated_torque in {subject.figures}")
    if seen.lag > LARGEST_LAG:
        cause = f"a stiffness of {robot.servo_stiffness.min():g} N·m/rad is too little for {robot.mass:.3g} kg"
        return problem(held, cause, f"servo_stiffness = {stiffness:.0f} or so in {subject.figures}")
    if seen.ringing > RINGING:
        seen_moving = f"half a second after a step of their targets the joints still move at {seen.ringing:.1f} rad/s"
        gains = f"{robot.servo_damping.min():g} N·m·s/rad is too little for {robot.servo_stiffness.max():g} N·m/rad"
        cause = f"a damping of {gains}"
        remedy = f"servo_stiffness = {stiffness:.0f} and servo_damping = {damping:.1f} or so in {subject.figures}"
        return problem(seen_moving, cause, remedy)
    return ok(f"{held}, with {100.0 * seen.load:.0f} % of the largest torque")


def stands(subject: Subject) -> Finding:
    """Whether the robot stands in its home pose."""
    robot, seen = subject.robot, stand(subject.env)
    trunk = f"its trunk is {seen.height:.3f} m high and tilted by {seen.tilt:.3f} rad"
    if seen.tilt <= LARGEST_TILT and seen.height >= (1.0 - LARGEST_SINK) * robot.home_height:
        return ok(trunk)
    cause = "in the home pose the feet are not below the centre of mass, or a mass is not where it should be"
    remedy = f"home_pose in {subject.figures}, or masses in {robot.mjcf}; describe --picture shows it"
    return problem(f"it does not stand: {trunk}", cause, remedy)
