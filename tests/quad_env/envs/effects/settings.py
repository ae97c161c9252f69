"""Effect of every field of the settings on a reading."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

import quad_env
from quad_env import TaskConfig
from quad_env.robots.simple_quad import SIMPLE_QUAD
from tests.quad_env.envs.effects.episode import (
    WIND,
    arrived,
    command,
    commanded,
    drawn,
    fallen,
    force,
    held,
    pushed,
    received,
)
from tests.quad_env.envs.effects.motors import (
    CENTRE,
    DAMPING,
    DELAY,
    FRICTION,
    MASS,
    OFFSET,
    STIFFNESS,
    STRENGTH,
    centre_of_mass,
    far_torques,
    grip,
    lagging,
    load,
    loaded,
    servo_gains,
    servo_targets,
    weight,
)
from tests.quad_env.envs.effects.robot import (
    CALM,
    DT,
    HOME,
    IDEAL,
    SCAN,
    STEPS,
    STRAIGHT,
    WAVES,
    Effect,
    after,
    part,
    scene,
    series,
    streams,
    suite,
)
from tests.quad_env.envs.effects.sensors import (
    cut,
    disturbed,
    late,
    noisy,
    off,
    scan,
    seen,
    seen_angles,
    sensed,
    sensed_late,
    sensor,
    slow,
    white,
)

Usual = tuple[Any, Callable[[Any], dict[str, Any]]]
USUAL: dict[type, Usual] = {
    TaskConfig: (TaskConfig(), lambda config: {"config": config}),
    quad_env.FallRule: (quad_env.FallRule(), lambda rule: scene() | {"config": TaskConfig(fall_rule=rule)}),
    quad_env.CommandRanges: (STRAIGHT, part("commands")),
    quad_env.StartNoise: (CALM, part("start")),
    quad_env.AnyPose: (quad_env.AnyPose(0.0, 0.0, 0.0), part("start")),
    quad_env.Flat: (quad_env.Flat(), part("terrain")),
    quad_env.Pushes: (
        quad_env.Pushes(count=1, duration=0.05, window=(0.0, 0.1)),
        lambda settings: scene(pushes=settings, force=quad_env.SteadyForce(12.0)),
    ),
    quad_env.SteadyForce: (quad_env.SteadyForce(), part("force")),
    quad_env.Motors: (quad_env.Motors(), part("motors")),
    quad_env.Payload: (quad_env.Payload(), part("payload")),
    quad_env.Latency: (quad_env.Latency(0.0, 0.0), part("latency")),
    quad_env.SensorNoise: (quad_env.SensorNoise(0.0), part("noise")),
    quad_env.Dropouts: (quad_env.Dropouts(count=1, duration=0.05, window=(0.0, 0.1)), part("dropouts")),
    quad_env.DomainRandomisation: (
        quad_env.DomainRandomisation((1.0, 1.0), 0.0, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0, 0.0),
        part("randomisation"),
    ),
    quad_env.Imu: (IDEAL.imu, suite("imu")),
    quad_env.Encoders: (IDEAL.encoders, suite("encoders")),
    quad_env.JointTorque: (IDEAL.torque, suite("torque")),
    quad_env.HeightScan: (SCAN, lambda settings: scene() | {"height_scan": settings}),
    quad_env.Actuator: (quad_env.Actuator(), lambda settings: scene() | {"actuator": settings}),
}
"""Type of settings -> the settings of which one field is changed, and the arguments that pass them."""
FIELDS = {
    "TaskConfig.control_rate": Effect(
        50.0, after(lambda robot: [robot.now.time, robot.env.metadata["render_fps"]]), [0.02, 50]
    ),
    "TaskConfig.timestep": Effect(
        0.0025, after(lambda robot: [robot.model.opt.timestep, robot.now.time]), [0.0025, DT]
    ),
    "TaskConfig.solver_iterations": Effect(3, after(lambda robot: robot.model.opt.iterations), 3),
    "FallRule.tilt": Effect(1e-9, after(fallen), [2, 1]),
    "FallRule.height": Effect(0.7, after(fallen), [3, 1]),
    "CommandRanges.forward": Effect((0.2, 0.7), series(command), commanded(forward=(0.2, 0.7))),
    "CommandRanges.zero_fraction": Effect(0.5, series(command), commanded(zero=0.5)),
    "CommandRanges.interval": Effect(0.05, series(command), commanded(interval=5)),
    "StartNoise.yaw": drawn(2, 1, 0.5),
    "StartNoise.tilt": drawn(3, 2, 0.3),
    "StartNoise.joint_position": drawn(5, 12, 0.2),
    "StartNoise.linear_velocity": drawn(17, 3, 0.4),
    "StartNoise.angular_velocity": drawn(20, 3, 0.6),
    "StartNoise.joint_velocity": drawn(23, 12, 0.7),
    "AnyPose.joint_velocity": drawn(23, 12, 0.7),
    "Flat.spawn_radius": drawn(0, 2, 0.5),
    "Pushes.count": Effect(2, series(force), pushed(2, 0, 5)),
    "Pushes.impulse": Effect(20.0, series(force), lambda before: (before - WIND) * 20 / 35 + WIND),
    "Pushes.duration": Effect(0.097, series(force), pushed(1, 0, 10)),
    "Pushes.window": Effect((0.06, 0.12), series(force), pushed(1, 6, 5)),
    "SteadyForce.force": Effect(12.0, series(force), np.tile(WIND, (STEPS + 1, 1))),
    "Motors.bandwidth": lagging(5.0),
    "Payload.mass": Effect(8.0, load, loaded(mass=8.0)),
    "Payload.reach": Effect((0.05, 0.15), load, loaded(reach=(0.05, 0.15))),
    "Payload.edge": Effect(0.1, load, loaded(edge=0.1)),
    "Latency.action": Effect(0.032, series(received), arrived(3)),
    "Latency.observation": Effect(0.032, series(seen), sensed_late),
    "SensorNoise.gyro": disturbed(0.4),
    "Dropouts.count": Effect(2, series(received), held(2, 0, 5)),
    "Dropouts.duration": Effect(0.097, series(received), held(1, 0, 10)),
    "Dropouts.window": Effect((0.06, 0.12), series(received), held(1, 6, 5)),
    "DomainRandomisation.friction": Effect((0.5, 0.9), after(grip), 0.8 * (0.7 + 0.2 * FRICTION)),
    "DomainRandomisation.trunk_mass": Effect(0.4, weight, SIMPLE_QUAD.mass + 0.4 * MASS * 5.0),
    "DomainRandomisation.centre_of_mass": Effect(
        (0.1, 0.05, 0.02), centre_of_mass, np.multiply((0.1, 0.05, 0.02), CENTRE)
    ),
    "DomainRandomisation.stiffness": Effect(
        0.3, servo_gains, np.stack((300.0 * (1 + 0.3 * STIFFNESS), np.full(12, 10.0)), axis=1)
    ),
    "DomainRandomisation.damping": Effect(
        0.3, servo_gains, np.stack((np.full(12, 300.0), 10.0 * (1 + 0.3 * DAMPING)), axis=1)
    ),
    "DomainRandomisation.motor_strength": Effect(0.2, far_torques, 100.0 * (1 + 0.2 * STRENGTH)),
    "DomainRandomisation.delay": Effect(0.08, series(received), arrived(round(4 * (1 + DELAY)))),
    "DomainRandomisation.encoder_offset": Effect(
        0.1, series(seen_angles), lambda before: before + np.float32(0.1 * OFFSET)
    ),
    "Imu.rate": slow(sensor("gyro")),
    "Imu.delay": late(sensor("gyro")),
    "Imu.gyro_bias": off("gyro", 0.2),
    "Imu.gyro_noise": noisy("gyro", 0.3),
    "Imu.gyro_range": cut("gyro", 0.1),
    "Imu.accelerometer_noise": noisy("accelerometer", 0.7),
    "Encoders.bits": Effect(
        8, series(sensor("joint_position")), lambda before: np.rint(before / math.tau * 256) * math.tau / 256
    ),
    "Encoders.noise": noisy("joint_position", 0.1),
    "Encoders.zero_offset": off("joint_position", 0.2),
    "JointTorque.bias": off("joint_torque", 2.0),
    "JointTorque.range": cut("joint_torque", 5.0),
    "HeightScan.rate": slow(scan),
    "HeightScan.delay": late(scan),
    "HeightScan.noise": Effect(0.1, series(scan), lambda before: before + 0.1 * white(streams().scan_noise, 0, 6)),
    "Actuator.bandwidth": lagging(8.0),
    "Actuator.delay": Effect(0.02, series(servo_targets), np.stack([0.0 * HOME, 0.0 * HOME, *(WAVES[:-1] - HOME)])),
}
FIVE = np.array([False] + [True] * 5 + [False] * (STEPS - 5))
"""True in the steps of an event in the first tenth of a second."""
AT_50_HZ = [
    ("CommandRanges.interval", Effect(0.06, series(command), commanded(interval=3))),
    ("Pushes.duration", Effect(0.1, series(lambda robot: np.hypot(*(force(robot) - WIND)[:2])), 350.0 * FIVE)),
    ("Dropouts.duration", Effect(0.1, series(received), held(1, 0, 5))),
    ("Latency.action", Effect(0.06, series(received), arrived(3))),
    ("Latency.observation", late(sensed, 0.06)),
    ("Latency.observation", late(sensed, 0.06, {"sensors": "ideal"})),
    ("Latency.observation", late(scan, 0.06, {"height_scan": SCAN})),
    ("Imu.rate", slow(sensor("gyro"), 25.0)),
    ("Imu.delay", late(sensor("gyro"), 0.06)),
    ("HeightScan.rate", slow(scan, 25.0)),
    ("HeightScan.delay", late(scan, 0.06)),
]
"""Effects of settings in seconds or hertz, in control steps of 20 ms."""
BEFORE: dict[Any, Any] = {}
"""Readings at the default values."""


def check(field: str, effect: Effect) -> None:
    owner, name = field.split(".")
    usual, given = next(each for kind, each in USUAL.items() if kind.__name__ == owner)
    known = owner, effect.reading, repr(effect.given)
    if known not in BEFORE:
        BEFORE[known] = effect.of(False, given(usual))
    effect.check(BEFORE[known], effect.of(False, given(replace(usual, **{name: effect.value}))))
