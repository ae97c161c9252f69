"""Every argument of the environments, and fields of the settings of each kind, reach the simulated robots.

`ARGUMENTS`, `ALONE` and `BATCHED` have an entry for each argument; one without an entry fails. An entry changes one
value and reads the model, the motion, the observation or the infos of the second robot of a batch; of arguments, those
of a robot alone too.
"""

import copy
import dataclasses
import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import quad_env
from quad_env import OBSERVATION, OBSERVATION_SIZE, TaskConfig
from quad_env.envs.base import EnvKwargs
from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import EpisodeStreams
from tests.quad_env.robots.alike import alike

SEED, STEPS, DT = 5, 12, 0.01
"""Of the robot that is looked at. Control steps of a series. Period, s."""
HOME, FAR = SIMPLE_QUAD.home_pose, tuple(SIMPLE_QUAD.joint_upper)
"""FAR is out of reach of every servo for some steps."""
WAVES = HOME + np.random.default_rng(0).uniform(-0.15, 0.15, (STEPS, 12))
CALM = quad_env.StartNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
IDEAL = quad_env.SENSORS["ideal"]
STRAIGHT = quad_env.CommandRanges(zero_fraction=0.0, interval=0.02)
SCAN = quad_env.HeightScan(ahead=1, behind=0, aside=1)
FALLS = TaskConfig(fall_rule=quad_env.FallRule(tilt=1e-9))


class Robot:
    """A robot alone, or the second of a batch, whose others are asked for something else and are steps ahead of it.

    It has moved in an episode before, of which nothing is to be left.
    """

    def __init__(self, alone: bool, reset: Any = None, **options: Any) -> None:
        self.alone, self.row = alone, 0 if alone else 1
        how = {"disable_env_checker": True} if alone else {"num_envs": 2}
        self.env: Any = (gym.make if alone else gym.make_vec)("quad_env:SimpleQuad-v0", **how | options)
        self.base = self.env.unwrapped
        self._keep(*self.env.reset(seed=99))
        for _ in range(2):
            self.step(SIMPLE_QUAD.joint_upper)
        mask = {} if alone else {"reset_mask": np.arange(self.base.num_envs) == 1}
        self._keep(*self.env.reset(seed=SEED - self.row, options=mask | (reset or {})))

    def step(self, action: np.ndarray = HOME) -> None:
        others = np.tile(action + 0.1, (1 if self.alone else self.base.num_envs, 1))
        others[self.row] = action
        seen, self.reward, self.ended, self.cut, infos = self.env.step(action if self.alone else others)
        self._keep(seen, infos)

    def _keep(self, seen: Any, infos: Any) -> None:
        self.seen = self.own(seen)
        self.infos = {key: self.own(value) for key, value in infos.items() if not isinstance(value, dict)}

    def own(self, value: Any) -> Any:
        """Of something that a batch has for each robot."""
        return value if self.alone else value[self.row]

    @property
    def now(self) -> Any:
        """Its simulation; the model, too, is its own from here on."""
        return self.base.simulation.snapshot(self.row)

    @property
    def model(self) -> Any:
        return self.base.simulation.model


Reading = Callable[[Robot], Any]


@dataclass(frozen=True)
class Effect:
    """What a value is for: with it the reading, which was another, is what is expected, `within` so much of it."""

    value: Any
    reading: Reading
    expected: Any
    """Or a function from what the reading is at the usual value."""
    given: dict[str, Any] = dataclasses.field(default_factory=dict)
    """Arguments without which the value means nothing."""
    within: float = 1e-5

    def of(self, alone: bool, options: dict[str, Any]) -> Any:
        """The reading of a robot that is made with these arguments."""
        return self.reading(Robot(alone, **self.given | options))

    def check(self, before: Any, after: Any) -> None:
        expected = self.expected(before) if callable(self.expected) else self.expected
        assert same(after, expected, self.within), (after, expected)
        assert not same(before, expected, self.within), "or this shows nothing"


def same(found: Any, expected: Any, within: float) -> bool:
    found, expected = np.asarray(found), np.asarray(expected)
    if found.dtype.kind not in "fiub":
        return found.shape == expected.shape and bool((found == expected).all())
    return found.shape == expected.shape and np.allclose(found, expected, within, within)


@cache
def series(read: Reading) -> Reading:
    """A reading after the reset and after each step of a robot that waves its legs."""

    def step(robot: Robot, action: np.ndarray) -> Any:
        robot.step(action)
        return read(robot)

    return lambda robot: np.array([read(robot), *(step(robot, action) for action in WAVES)])


@cache
def after(read: Reading, action: tuple[float, ...] = tuple(HOME), steps: int = 1) -> Reading:
    """A reading after so many steps towards that."""
    return lambda robot: [*(robot.step(np.array(action)) for _ in range(steps)), read(robot)][-1]


def scene(**parts: Any) -> dict[str, Any]:
    return {"scenario": quad_env.Scenario("made", **{"start": CALM} | parts)}


def part(name: str) -> Callable[[Any], dict[str, Any]]:
    """The arguments that hand over this part of a scenario."""
    return lambda settings: scene(**{name: settings})


def suite(name: str) -> Callable[[Any], dict[str, Any]]:
    return lambda settings: scene() | {"sensors": replace(IDEAL, **{name: settings})}


def streams() -> EpisodeStreams:
    return EpisodeStreams(SEED, 0)


UNITS = streams().start.uniform(-1, 1, 35)


def start(robot: Robot) -> np.ndarray:
    """Where it starts, in the order of the draws: place, yaw, roll, pitch, joints, velocities."""
    now = robot.now
    turn = now.body("base_link").xmat.reshape(3, 3)
    angles = np.arctan2(turn[1, 0], turn[0, 0]), np.arctan2(turn[2, 1], turn[2, 2]), -np.arcsin(turn[2, 0])
    return np.concatenate((now.qpos[:2], angles, now.qpos[7:] - HOME, now.qvel))


def drawn(first: int, count: int, width: float) -> Effect:
    """These parts of the start are drawn, half as wide as that, and no others change."""
    drawn = np.isin(np.arange(35), np.arange(first, first + count))
    return Effect(width, start, lambda before: np.where(drawn, width * UNITS, before))


def force(robot: Robot) -> np.ndarray:
    return np.array(robot.now.body("base_link").xfrc_applied)


def blown(by: float) -> np.ndarray:
    angle = streams().force.uniform(-np.pi, np.pi)
    return by * np.array((np.cos(angle), np.sin(angle)))


WIND = np.array((*blown(12.0), 0.0, 0.0, 0.0, 0.0))


def pushed(count: int, first: int, steps: int) -> np.ndarray:
    """Forces of the wind and of pushes of 35 N·s that fill their windows, in the directions of the streams."""
    stream, out = streams().pushes, np.zeros((STEPS + 1, 6)) + WIND
    stream.uniform(size=count)
    for number, angle in enumerate(stream.uniform(-np.pi, np.pi, count)):
        begin = 1 + first + number * steps
        out[begin : begin + steps, :2] += 35.0 / (steps * DT) * np.array((np.cos(angle), np.sin(angle)))
    return out


def received(robot: Robot) -> np.ndarray:
    """Targets that the servos go by, and the action that is shown."""
    return np.array((robot.now.ctrl, HOME + robot.seen[OBSERVATION["previous_action"]]))


def arrived(late: int) -> np.ndarray:
    """Targets that come so many control steps late; what is shown is what was asked for."""
    return np.stack((np.vstack(([HOME] * (1 + late), WAVES[: STEPS - late])), np.vstack((HOME, WAVES))), axis=1)


def held(count: int, first: int, steps: int) -> np.ndarray:
    """Targets in dropouts that fill their windows: a joint that gets none holds its last."""
    stream, out = streams().dropouts, arrived(0)
    stream.uniform(size=count)
    for number, joint in enumerate(stream.integers(12, size=count)):
        last = first + number * steps
        out[last + 1 : last + 1 + steps, 0, joint] = out[last, 0, joint]
    return out


def command(robot: Robot) -> np.ndarray:
    """That to follow next, which is shown, and that of the step taken."""
    return np.array([robot.seen[OBSERVATION["command"]], robot.infos["command"]])


def commanded(interval: int = 2, zero: float = 0.0, **ranges: tuple[float, float]) -> np.ndarray:
    """What is drawn in turn, each for so many steps."""
    own = replace(STRAIGHT, **ranges)
    low, high = np.transpose((own.forward, own.lateral, own.yaw_rate))
    draws = streams().commands.random((STEPS, 4))[np.arange(STEPS + 1) // interval]
    shown = np.where(draws[:, :1] < zero, 0.0, low + (high - low) * draws[:, 1:])
    return np.stack((shown, shown[np.maximum(np.arange(STEPS + 1) - 1, 0)]), axis=1)


def servo_targets(robot: Robot) -> np.ndarray:
    """Targets that the servos go by, from their torques, less the home pose."""
    now = robot.now
    return np.array((now.actuator_force + 10 * now.qvel[6:]) / 300 + now.qpos[7:] - HOME)


def servo_gains(robot: Robot) -> np.ndarray:
    """Stiffness and damping of each servo, by the torques of two targets and two speeds."""
    model, now = robot.model, robot.now
    torques = []
    for target, speed in ((0.0, 0.0), (0.1, 0.0), (0.0, 0.1)):
        now.ctrl[:], now.qvel[6:] = now.qpos[7:] + target, speed
        mujoco.mj_forward(model, now)
        torques.append(now.actuator_force.copy())
    return 10.0 * np.stack((torques[1] - torques[0], torques[0] - torques[2]), axis=1)


def lagging(bandwidth: float) -> Effect:
    """A tenth of a radian is asked for."""
    share = 1 - math.exp(-DT * 2 * math.pi * bandwidth)
    return Effect(bandwidth, after(servo_targets, tuple(HOME + 0.1)), np.full(12, 0.1 * share))


def largest_torque(robot: Robot) -> float:
    return float(np.abs(robot.now.actuator_force).max())


def weight(robot: Robot) -> float:
    """What holds a robot at rest, kg."""
    return float(robot.now.qfrc_bias[2]) / 9.81


def grip(robot: Robot) -> float:
    """The friction of its feet on the ground."""
    now = robot.now  # first: then the model is its own
    (found,) = {float(contact.friction[0]) for contact in now.contact[: now.ncon]}
    return found


def centre_of_mass(robot: Robot) -> np.ndarray:
    """Of the trunk, along its axes."""
    now, trunk = robot.now, robot.model.body("base_link").id
    return (now.xipos[trunk] - now.xpos[trunk]) @ now.xmat[trunk].reshape(3, 3)


def far_torques(robot: Robot) -> np.ndarray:
    """Largest torques, where the targets are out of reach."""
    model, now = robot.model, robot.now
    now.ctrl[:] = FAR
    mujoco.mj_forward(model, now)
    return np.array(now.actuator_force)


NUMBERS = streams().randomisation
FRICTION, MASS, DELAY, *CENTRE = NUMBERS.uniform(-1, 1, 6)
STIFFNESS, DAMPING, STRENGTH, OFFSET = NUMBERS.uniform(-1, 1, (4, 12))
"""Of what is randomised."""


def load(robot: Robot) -> list[float]:
    """Mass of a payload, its place on the trunk, that of the cube that is drawn, and its moment of inertia."""
    now, trunk = robot.now, robot.model.body("base_link").id
    places = np.array((now.body("payload").xipos, now.geom("payload").xpos)) - now.xpos[trunk]
    mass = robot.model.body_subtreemass[trunk] - SIMPLE_QUAD.mass
    return [mass, *np.ravel(places @ now.xmat[trunk].reshape(3, 3)), robot.model.body("payload").inertia[0]]


def loaded(mass: float = 5.0, reach: tuple[float, float] = (0.2, 0.1), edge: float = 0.2) -> list[float]:
    place = *(streams().payload.uniform(-1, 1, 2) * reach), (SIMPLE_QUAD.trunk_size[2] + edge) / 2
    return [mass, *place, *place, mass * edge**2 / 6]


def temperature(robot: Robot) -> Any:
    return robot.base.simulation.winding_temperature[robot.row]


def fallen(robot: Robot) -> list[int]:
    return [int(robot.infos["fall"]), int(robot.own(robot.ended))]


LATE, SLOW = np.maximum(np.arange(STEPS + 1) - 3, 0), np.arange(STEPS + 1) // 2 * 2
"""Which samples are seen that are three control steps late, or of which there is one in two control steps."""
PLACES = {"gyro": slice(0, 3), "accelerometer": slice(3, 6), "joint_position": slice(6, 18)}
PLACES |= {"foot_contact": slice(18, 22), "joint_torque": slice(22, 34)}
"""Of the draws for each sensor."""


def white(stream: np.random.Generator, skipped: int, width: int) -> np.ndarray:
    stream.standard_normal(skipped)
    return stream.standard_normal((50, width), dtype=np.float32)[: STEPS + 1]


BIAS, NOISE = streams().sensors.standard_normal(34), white(streams().sensors, 34, 34)


def slow(read: Reading, rate: float = 50.0) -> Effect:
    return Effect(rate, series(read), lambda before: before[SLOW])


def late(read: Reading, delay: float = 0.022, given: Any = None) -> Effect:
    return Effect(delay, series(read), lambda before: before[LATE], given or {})


@cache
def sensor(name: str) -> Reading:
    return lambda robot: robot.infos[f"sensor_{name}"]


def off(name: str, by: float) -> Effect:
    """A sensor whose bias is drawn with that deviation."""
    return Effect(by, series(sensor(name)), lambda before: before + by * BIAS[PLACES[name]])


def noisy(name: str, by: float) -> Effect:
    return Effect(by, series(sensor(name)), lambda before: before + by * NOISE[:, PLACES[name]])


def cut(name: str, to: float) -> Effect:
    return Effect(to, series(sensor(name)), lambda before: np.clip(before, -to, to))


def made_out(robot: Robot) -> bool:
    """Whether some bias is taken off what the gyroscope reads."""
    return bool((robot.seen[OBSERVATION["angular_velocity"]] != np.float32(robot.infos["sensor_gyro"])).any())


def seen_from_the_side(robot: Robot) -> bool:
    """Whether the frame is that of the camera beside the robot."""
    with mujoco.Renderer(robot.base.model, 48, 64) as renderer:
        renderer.update_scene(robot.base.data, "side")
        return bool(np.array_equal(robot.env.render(), renderer.render()))


SENSED = OBSERVATION["previous_action"].start


def seen(robot: Robot) -> Any:
    return robot.seen


def seen_angles(robot: Robot) -> Any:
    return robot.seen[OBSERVATION["joint_position"]]


def sensed(robot: Robot) -> Any:
    return robot.seen[:SENSED]


def sensed_late(before: np.ndarray) -> np.ndarray:
    """A late observation: its command and the action, as asked for, are not late."""
    return np.hstack((before[LATE, :SENSED], before[:, SENSED:]))


DEVIATIONS = np.repeat([0.25, 1.0, 0.5, 0.05, 7.5], [3, 3, 3, 12, 12])
"""Of the terms that are sensed, by the gyroscope's."""
BOUND = np.repeat([1.0, 100.0], [3, 30])


def disturbed(gyro: float) -> Effect:
    noise = gyro * DEVIATIONS * white(streams().noise, 0, 33)
    return Effect(gyro, series(sensed), lambda before: np.clip(before + noise, -BOUND, BOUND))


def scan(robot: Robot) -> np.ndarray:
    return np.array(robot.seen[OBSERVATION_SIZE:])


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
"""The settings of which one field is changed, and the arguments that hand them over."""
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
ARGUMENTS = {
    "scenario": Effect("weak_motors=8", after(largest_torque, FAR), 8.0),
    "terminate_on_fall": Effect(False, after(fallen), [2, 0], {"config": FALLS}),
    "config": Effect(TaskConfig(control_rate=50.0), after(lambda robot: robot.now.time), 0.02),
    "actuator": Effect("motor", lambda robot: robot.base.simulation.winding_temperature is not None, True),
    "sensors": Effect("ideal", lambda robot: robot.infos.get("sensor_joint_position"), HOME, scene()),
    "robot": Effect(alike, lambda robot: robot.model.body_mass.sum(), 0.1 * SIMPLE_QUAD.mass),
    "servo": Effect((60.0, 2.0), after(servo_gains, FAR), np.tile((60.0, 2.0), (12, 1))),
    "estimator": Effect("kalman", after(made_out, steps=20), True, {"sensors": "typical"}),
    "height_scan": Effect(SCAN, lambda robot: scan(robot) + robot.now.qpos[2], np.zeros(6)),
    "max_episode_steps": Effect(
        3, lambda robot: [after(lambda robot: robot.own(robot.cut))(robot) for _ in range(3)], [False, False, True]
    ),
    "render_mode": Effect("rgb_array", lambda robot: robot.base.render_mode == "rgb_array", True),
}
ALONE = {
    "width": Effect(64, lambda robot: robot.env.render().shape[:2], (9, 64), {"render_mode": "rgb_array", "height": 9}),
    "height": Effect(48, lambda robot: robot.env.render().shape[:2], (48, 9), {"render_mode": "rgb_array", "width": 9}),
    "camera": Effect("side", seen_from_the_side, True, {"render_mode": "rgb_array", "width": 64, "height": 48}),
}
BATCHED = {
    "num_envs": Effect(3, lambda robot: len(robot.base.simulation.quaternion), 3),
    "nthread": Effect(3, lambda robot: robot.base.simulation.batch.nthread, 3, {"num_envs": 4}),
    "autoreset_mode": Effect(
        "SAME_STEP", after(lambda robot: "final_obs" in robot.infos), True, {"max_episode_steps": 1}
    ),
    "readings": Effect(True, lambda robot: robot.infos.get("joint_position"), HOME, scene()),
}
FIVE = np.array([False] + [True] * 5 + [False] * (STEPS - 5))
"""Steps of what happens in the first tenth of a second."""
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
"""Whatever is said in seconds or hertz, in control steps of 20 ms."""


def test_every_argument_has_an_effect_that_is_tested() -> None:
    for kind, own in ((SimpleQuadEnv, ALONE), (SimpleQuadVectorEnv, BATCHED)):
        of_test_drake = "simulator"
        given = {*inspect.signature(kind).parameters, *EnvKwargs.__annotations__, "max_episode_steps"} - {"parts"}
        assert given == {*ARGUMENTS, *own, of_test_drake}


@pytest.mark.parametrize("field", FIELDS)
def test_a_field_reaches_what_it_governs(field: str) -> None:
    """Of a robot of a batch; a robot alone has its bits, see `test_same_bits`."""
    check(field, FIELDS[field])


@pytest.mark.parametrize(("field", "effect"), AT_50_HZ, ids=lambda each: each if isinstance(each, str) else "")
def test_seconds_are_seconds_at_any_control_rate(field: str, effect: Effect) -> None:
    slower = {"config": TaskConfig(control_rate=50.0)}
    check(field, replace(effect, given=effect.given | slower))


BEFORE: dict[Any, Any] = {}
"""Readings at the usual values."""


def check(field: str, effect: Effect) -> None:
    owner, name = field.split(".")
    usual, given = next(each for kind, each in USUAL.items() if kind.__name__ == owner)
    known = owner, effect.reading, repr(effect.given)
    if known not in BEFORE:
        BEFORE[known] = effect.of(False, given(usual))
    effect.check(BEFORE[known], effect.of(False, given(replace(usual, **{name: effect.value}))))


@pytest.mark.parametrize(
    ("name", "alone"),
    [
        pytest.param(name, alone, marks=[pytest.mark.rendering] if name in ALONE else [])
        for alone, own in ((True, ALONE), (False, BATCHED))
        for name in (*ARGUMENTS, *own)
    ],
)
def test_an_argument_reaches_what_it_governs(name: str, alone: bool, tmp_path: Path) -> None:
    effect = {**ARGUMENTS, **ALONE, **BATCHED}[name]
    changed = {name: effect.value(tmp_path) if name == "robot" else effect.value}
    effect.check(effect.of(alone, {}), effect.of(alone, changed))


def test_an_accelerometer_with_a_bias_says_where_down_is_at_first() -> None:
    robot = Robot(False, **suite("imu")(replace(IDEAL.imu, accelerometer_bias=0.5)))
    up = np.array((0.0, 0.0, 9.81)) + 0.5 * BIAS[PLACES["accelerometer"]]
    np.testing.assert_allclose(robot.seen[:3], -up / np.linalg.norm(up), atol=1e-6)


def test_drives_go_by_the_timestep() -> None:
    """Motors with a curve see the value of their lag at the start of each physics step."""
    finer, straight = {"config": TaskConfig(400.0, 0.0025)}, quad_env.TorqueSpeed()
    lagging = Robot(False, **scene(), **finer, actuator=quad_env.Actuator(straight, bandwidth=5.0))
    share = 1 - math.exp(-0.0025 * 2 * math.pi * 5.0)
    np.testing.assert_allclose(after(servo_targets, tuple(HOME + 0.1), steps=2)(lagging), np.full(12, 0.1 * share))
    warm = Robot(False, **scene(), **finer, actuator=quad_env.Actuator(straight, thermal=quad_env.Thermal(4.0, 0.5)))
    rise = 4.0 / 10 * 100.0**2 * (1 - math.exp(-0.0025 / 0.5))
    np.testing.assert_allclose(after(temperature, FAR)(warm), np.full(12, 25.0 + rise))


def test_the_model_of_a_single_environment_carries_the_load_of_its_episode() -> None:
    """Without a look at its data, which would bring the model up to date."""
    robot = Robot(alone=True, **scene(payload=quad_env.Payload()))
    np.testing.assert_allclose(robot.base.model.body("payload").pos, loaded()[1:4])


def test_the_model_of_a_robot_has_the_constants_that_follow_from_its_load() -> None:
    robot = Robot(False, **scene(payload=quad_env.Payload(40.0)))
    robot.base.simulation.sync_model(robot.row)
    worked_out = copy.copy(robot.model)
    worked_out.qpos0[2] = worked_out.key("home").qpos[2]
    mujoco.mj_setConst(worked_out, mujoco.MjData(worked_out))
    np.testing.assert_allclose(robot.model.dof_invweight0, worked_out.dof_invweight0)
