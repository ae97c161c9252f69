"""Whether the robot moves as it should: steps of time, a batch, servos, standing, speed."""

import os
import time

import numpy as np

from quad_env.describe import LARGEST_SINK, LARGEST_TILT
from quad_env.doctor.check import Finding, ok, problem, warning
from quad_env.doctor.subject import Subject
from quad_env.robots.similarity import servo_gains

CONTROL_PERIOD = 0.01
"""s that every policy here counts on"""
LONGEST_STEP = 0.002
"""s of the joint loop, 500 Hz"""
LARGEST_LAG = 0.1
"""rad from the targets under the robot's weight"""
FULL_LOAD = 0.95
"""Share of the rated torque at which a joint holds nothing more"""
RINGING = 1.0
"""rad/s; of a robot by name at most 0.3"""
ROBOTS, STEPS = 16, 25
"""Of the trial of a batch."""
TRIAL = 0.3
"""s of stepping that speed is measured in"""


def period(subject: Subject) -> Finding:
    """Whether control and physics run at the rates that policies are made for."""
    try:
        env = subject.env
    except ValueError as error:
        cause = "a control step of 0.01 s is not a whole number of the model's timestep"
        return problem(" ".join(str(error).split()), cause, f'timestep="{LONGEST_STEP:g}" in {subject.robot.mjcf}')
    step = float(env.model.opt.timestep)
    if abs(env.dt - CONTROL_PERIOD) > 1e-9:
        seen = f"control runs at {1.0 / env.dt:g} Hz, policies are made for {1.0 / CONTROL_PERIOD:g} Hz"
        return problem(seen, "control_rate of TaskConfig was changed", "control_rate = 100.0 in quad_env/config.py")
    if step > LONGEST_STEP + 1e-9:
        seen = f"the joint loop runs at {1.0 / step:.0f} Hz, 500 Hz are wanted"
        return problem(
            seen, "the timestep of the MJCF is too long", f'timestep="{LONGEST_STEP:g}" in {subject.robot.mjcf}'
        )
    return ok(f"control at {1.0 / env.dt:g} Hz, joint loop at {1.0 / step:g} Hz")


def batch(subject: Subject) -> Finding:
    """Whether robots of a batch, on two threads, do to the bit what a robot alone does."""
    from quad_env.envs.vector_env import SimpleQuadVectorEnv

    env, many = subject.env, SimpleQuadVectorEnv(ROBOTS, nthread=2, robot=subject.robot, terminate_on_fall=False)
    alone, _ = env.reset(seed=ROBOTS - 1)
    together, _ = many.reset(seed=0)
    target = subject.robot.home_pose.astype(np.float32)
    for _ in range(STEPS):
        alone = env.step(target)[0]
        together = many.step(np.tile(target, (ROBOTS, 1)))[0]
    many.close()
    if np.array_equal(alone, together[-1]):
        return ok(f"{ROBOTS} robots on two threads, to the bit as one alone")
    off = float(np.abs(alone - together[-1]).max())
    cause = "MuJoCo or NumPy compute otherwise than those that this was made with"
    return problem(
        f"a robot in a batch is not one alone: off by {off:.2g}", cause, "pip install --force-reinstall mujoco numpy"
    )


def servos(subject: Subject) -> Finding:
    """Whether the joints hold their targets under the robot's weight."""
    robot, seen = subject.robot, subject.stand
    stiffness, damping = servo_gains(robot)
    held = f"standing, {seen.joint} is {seen.lag:.3f} rad off its target"
    if seen.load > FULL_LOAD:
        told = f"standing takes all of the joints' {robot.rated_torque:g} N·m, for {robot.mass:.3g} kg"
        cause = "masses are too large (grams for kilograms?), or the largest torque is too small"
        return problem(told, cause, f"mass of the bodies in {robot.mjcf}, or rated_torque in {subject.figures}")
    if seen.lag > LARGEST_LAG:
        cause = f"a stiffness of {robot.servo_stiffness:g} N·m/rad is too little for {robot.mass:.3g} kg"
        return problem(held, cause, f"servo_stiffness = {stiffness:.0f} or so in {subject.figures}")
    if seen.ringing > RINGING:
        told = f"half a second after a step of their targets the joints still move at {seen.ringing:.1f} rad/s"
        cause = f"a damping of {robot.servo_damping:g} N·m·s/rad is too little for {robot.servo_stiffness:g} N·m/rad"
        remedy = f"servo_stiffness = {stiffness:.0f} and servo_damping = {damping:.1f} or so in {subject.figures}"
        return problem(told, cause, remedy)
    return ok(f"{held}, with {100.0 * seen.load:.0f} % of the largest torque")


def stands(subject: Subject) -> Finding:
    """Whether the robot stands in its home pose."""
    robot, seen = subject.robot, subject.stand
    told = f"its trunk is {seen.height:.3f} m high and tilted by {seen.tilt:.3f} rad"
    if seen.tilt <= LARGEST_TILT and seen.height >= (1.0 - LARGEST_SINK) * robot.home_height:
        return ok(told)
    cause = "in the home pose the feet are not below the centre of mass, or a mass is not where it should be"
    remedy = f"home_pose in {subject.figures}, or masses in {robot.mjcf}; describe --picture shows it"
    return problem(f"it does not stand: {told}", cause, remedy)


def speed(subject: Subject) -> Finding:
    """How many times faster than the robot's own time it is simulated, one robot stepped from Python."""
    env, target = subject.env, subject.robot.home_pose.astype(np.float32)
    env.reset(seed=0)
    start, steps = time.perf_counter(), 0
    while (passed := time.perf_counter() - start) < TRIAL:
        env.step(target)
        steps += 1
    times = steps * env.dt / passed
    seen = f"{times:.1f} times as fast as real time, with {os.cpu_count()} processors"
    if times >= 1.0:
        return ok(seen)
    return warning(
        seen,
        "the machine is busy or slow, or a container has little of it",
        "end other programs; give it more processors",
    )
