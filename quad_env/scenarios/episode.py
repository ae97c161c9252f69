"""Random draws of an episode from its seed: initial state, commands and disturbances."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quad_env.columns import Array
from quad_env.config import AnyPose
from quad_env.robots.robot import Robot
from quad_env.scenarios.disturbances import Dropouts, Kicks, Pushes, ScanDropouts, SteadyForce
from quad_env.scenarios.randomisation import RandomizationSample
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import GradedRandom, HeightField
from quad_env.seeding import EpisodeStreams

NEVER = np.iinfo(np.int64).max
"""Control step that no episode reaches."""


@dataclass(frozen=True)
class PushPlan:
    """Pushes (force pulses on the trunk) of one episode, or of n episodes.

    For n episodes the arrays have a first axis of length n. Kicks, which training adds, may overlap pushes; the forces
    then add up. `count` is the number of pushes and kicks of an episode.
    """

    first_step: NDArray[np.int64]
    """Control step in which each push begins, counted from the start of the episode, (count,) or (n, count)."""
    steps: int | NDArray[np.int64]
    """Duration of each push, control steps: one number for all, (count,) or (n, count); 0 for no pushes."""
    force: Array
    """Force of each push, world frame, x and y, (count, 2) or (n, count, 2), N."""

    def force_at(self, step: ArrayLike) -> Array | None:
        """Return the pushing force on each of n trunks in a control step, world frame, x and y, (n, 2), N.

        `step` is the number of control steps since the start of each robot's episode, (n,). The result is None if there
        are no pushes.
        """
        if isinstance(self.steps, int) and not self.steps:
            return None
        steps_since_start = np.asarray(step)[..., None] - self.first_step
        is_acting = (steps_since_start >= 0) & (steps_since_start < self.steps)
        return cast("Array", np.where(is_acting[..., None], self.force, 0.0).sum(axis=-2))


class MovedProperties(NamedTuple):
    """Properties of ground and payload in an episode that may differ in severity from other episodes."""

    friction: float
    """Friction coefficient of the ground."""
    payload_mass: float
    """Mass of the payload, kg; 0 without a payload."""
    payload_inertia: float
    """Moment of inertia of the payload about each of its axes, kg·m²."""


@dataclass(frozen=True)
class ScanDropoutPlan:
    """Dropouts of the height scan in one episode."""

    first_step: NDArray[np.int64]
    """Control step in which each dropout begins, counted from the start of the episode, (count,)."""
    end_step: NDArray[np.int64]
    """First control step after each dropout, (count,)."""
    side: Array
    """Direction in which each dropout hides the points of the grid, heading frame, x and y, (count, 2).

    It is a unit vector, or zero for a dropout that hides all points."""


class EpisodeSample:
    """Random draws of one episode: initial state, commands, disturbances and domain randomisation.

    Each kind of random draw has its own random stream, so that the draws of one kind do not depend on other kinds.

    Args:
        robot: Robot of the episode.
        scenario: Scenario that defines the distributions of initial state, commands and disturbances.
        seed: Seed that defines a sequence of episodes.
        number: Index of this episode in the sequence of the seed, from 0.
        dt: Control period, s.

    Attributes:
        scenario: Scenario of the episode.
        streams: Random streams of the episode. The models of sensors and noise draw from them during the episode.
        start: Initial state (trunk pose, joint offsets, velocities) in the order that `draw_start` documents, (35,).
        pushes: Pushes on the trunk in the episode.
        force: Steady force on the trunk, world frame, (2,), N; None if the scenario has none.
        payload_position: Centre of the payload relative to the trunk's centre, forward and left, (2,), m; None if the
            scenario has no payload.
        dropouts: First control step of each dropout, (count,), and index of its joint, (count,). In a dropout a joint
            receives no targets. None if the scenario has no dropouts.
        scan_dropouts: Dropouts of the height scan; None if the scenario has none.
        randomised: Randomised properties of robot and ground; None if the scenario has no domain randomisation.
        friction: Friction coefficient of the ground.
        action_delay: Delay of the joint targets from the policy to the servos, control steps.
    """

    def __init__(self, robot: Robot, scenario: Scenario, seed: int, number: int, dt: float) -> None:
        self.scenario = scenario
        self.streams = EpisodeStreams(seed, number)
        self.start = draw_start(robot, scenario, self.streams.start)
        terrain = scenario.terrain
        if isinstance(terrain, HeightField) and terrain.start is not None:
            self.start[:2] += terrain.start
        elif isinstance(terrain, GradedRandom):
            self.start[0] = terrain.start_x
        self.pushes = _draw_pushes(scenario.pushes, self.streams.pushes, dt)
        if scenario.kicks is not None:
            self.pushes = _add_kicks(self.pushes, scenario.kicks, robot.mass, self.streams.pushes, dt)
        self.force = None if scenario.force is None else _draw_force(scenario.force, self.streams.force)
        self.payload_position: Array | None = None
        if (payload := scenario.payload) is not None:
            self.payload_position = self.streams.payload.uniform(-1, 1, 2) * np.array(payload.reach)
        self.dropouts: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None
        if (dropouts := scenario.dropouts) is not None:
            first_step = _stratified_start_steps(dropouts, self.streams.dropouts, dt)
            joint_ids = self.streams.dropouts.integers(robot.num_joints, size=dropouts.count)
            self.dropouts = (first_step, joint_ids)
        self.scan_dropouts = (
            None
            if scenario.scan_dropouts is None
            else _draw_scan_dropouts(scenario.scan_dropouts, self.streams.scan_dropouts, dt)
        )
        self.friction = scenario.ground.friction
        self.action_delay = 0 if scenario.latency is None else round(scenario.latency.action / dt)
        self.randomised: RandomizationSample | None = None
        if (randomisation := scenario.randomisation) is not None:
            self.randomised = randomisation.draw(robot.num_joints, self.streams.randomisation)
            self.friction *= self.randomised.friction
            self.action_delay += round(self.randomised.delay / dt)

    def next_command(self, present: Array | None = None) -> Array:
        """Draw the command of the next command interval, (3,): forward and lateral m/s, yaw rate rad/s.

        Every call takes the same number of values from the random stream, even if the drawn command is zero. Later
        commands therefore do not depend on the number of zero commands.

        Args:
            present: Present command, (3,); the new command may keep some of its components. None for the first
                command of the episode.

        Returns:
            The new command, heading frame, (3,).
        """
        ranges = self.scenario.commands
        zero_draw, *unit_draws = self.streams.commands.random(4)
        low, high = np.transpose((ranges.forward, ranges.lateral, ranges.yaw_rate))
        is_zero = zero_draw < ranges.zero_fraction
        command = low + (high - low) * np.asarray(unit_draws)
        if ranges.draws_components:
            draws = self.streams.commands.random((2, 3))
            command = np.where(draws[0] < ranges.on_probability, command, 0.0)
            if present is not None:
                command = np.where(draws[1] < ranges.keep_probability, present, command)
        return np.zeros(3) if is_zero else command

    def next_interval(self, dt: float) -> int:
        """Draw the number of control steps until the next command, at least 1; `dt` is the control period, s."""
        ranges = self.scenario.commands
        if not ranges.random_intervals:
            return ranges.steps(dt)
        return control_steps(float(self.streams.commands.exponential(ranges.interval)), dt)


def draw_start(robot: Robot, scenario: Scenario, stream: np.random.Generator) -> Array:
    """Draw the initial state of one robot at the start of an episode.

    Args:
        robot: Robot, which defines the number of joints and their limits.
        scenario: Scenario that defines the start noise and the spawn radius of the terrain.
        stream: Random stream of the episode for the initial state.

    Returns:
        Initial state, (35,), in this order: x and y, m; yaw, roll and pitch, rad; 12 joint offsets from the home pose,
        rad; 3 linear velocities, m/s; 3 angular and 12 joint velocities, rad/s.
    """
    noise = scenario.start
    radius = scenario.terrain.spawn_radius
    joints = robot.num_joints
    if isinstance(noise, AnyPose):
        return _draw_any_pose(robot, noise, radius, stream)
    widths = (
        (radius, 2),
        (noise.yaw, 1),
        (noise.tilt, 2),
        (noise.joint_position, joints),
        (noise.linear_velocity, 3),
        (noise.angular_velocity, 3),
        (noise.joint_velocity, joints),
    )
    width = np.repeat([half_width for half_width, _ in widths], [count for _, count in widths])
    return width * stream.uniform(-1, 1, len(width))


def _draw_any_pose(robot: Robot, start: AnyPose, radius: float, stream: np.random.Generator) -> Array:
    """Draw an initial state with a random orientation and random joint angles, (35,), as after a fall.

    Yaw, roll, and the sine of the pitch are uniformly distributed. Joint angles are uniformly distributed within the
    joint limits. The function `draw_start` documents the order of the components. `radius` is half of the side of the
    square around the origin in which robots start, m.
    """
    position = radius * stream.uniform(-1, 1, 2)
    yaw, sin_pitch, roll = stream.uniform(-1, 1, 3)
    angles = (np.pi * yaw, np.pi * roll, np.arcsin(sin_pitch))
    joints = stream.uniform(robot.joint_lower, robot.joint_upper) - robot.home_pose
    width = np.repeat([start.linear_velocity, start.angular_velocity, start.joint_velocity], [3, 3, len(joints)])
    return np.concatenate((position, angles, joints, width * stream.uniform(-1, 1, len(width))))


def _draw_pushes(pushes: Pushes | None, stream: np.random.Generator, dt: float) -> PushPlan:
    """Draw the pushes of an episode, one in each of `pushes.count` equal parts of the time window.

    The direction of each push is horizontal and uniformly random. `dt` is the control period, s.
    """
    if pushes is None or pushes.count == 0:
        return PushPlan(np.empty(0, np.int64), 0, np.empty((0, 2)))
    steps = control_steps(pushes.duration, dt)
    first_step = _stratified_start_steps(pushes, stream, dt)
    angle = stream.uniform(-np.pi, np.pi, pushes.count)
    force = pushes.impulse / (steps * dt) * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    return PushPlan(first_step, steps, force)


def _add_kicks(plan: PushPlan, kicks: Kicks, mass: float, stream: np.random.Generator, dt: float) -> PushPlan:
    """Draw the kicks of an episode, and add them to the pushes of a plan.

    Args:
        plan: Pushes of the episode.
        kicks: Distribution of the kicks.
        mass: Mass of the robot, kg.
        stream: Random stream of the pushes.
        dt: Control period, s.

    Returns:
        The plan with pushes and kicks.
    """
    first_step = np.floor(np.cumsum(stream.uniform(*kicks.interval, kicks.count)) / dt).astype(np.int64)
    steps = np.maximum(np.round(stream.uniform(*kicks.duration, kicks.count) / dt), 1).astype(np.int64)
    angle = stream.uniform(-np.pi, np.pi, kicks.count)
    size = mass * stream.uniform(0.0, kicks.speed, kicks.count) / (steps * dt)
    force = size[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    return PushPlan(
        np.concatenate((plan.first_step, first_step)),
        np.concatenate((np.full(len(plan.first_step), plan.steps), steps)),
        np.concatenate((plan.force, force)),
    )


def _draw_force(steady: SteadyForce, stream: np.random.Generator) -> Array:
    """Draw the steady force on the trunk in a uniformly random horizontal direction, world frame, (2,), N."""
    angle = stream.uniform(-np.pi, np.pi)
    return steady.force * np.array((np.cos(angle), np.sin(angle)))


def control_steps(duration: float, dt: float) -> int:
    """Return the rounded number of control steps in a `duration`, s, at least 1; `dt` is the control period, s."""
    return max(1, round(duration / dt))


def stack_initial_conditions(
    episodes: Sequence[EpisodeSample],
) -> tuple[Array, Array | None, Array | None, list[RandomizationSample]]:
    """Stack the initial conditions of k episodes of one scenario to arrays, for `Simulation.reset`.

    Args:
        episodes: Random draws of the k episodes.

    Returns:
        starts: Initial states (trunk pose, joint offsets, velocities) in the order of `draw_start`, (k, 35).
        forces: Steady forces on the trunk, world frame, (k, 2), N; None if the scenario has none.
        payload_positions: Payload centres relative to the trunk's centre, forward and left, (k, 2), m; None if the
            scenario has no payload.
        randomised: Randomised properties of the k episodes; empty if the scenario has no domain randomisation.
    """
    starts = np.stack([episode.start for episode in episodes])
    forces = [episode.force for episode in episodes if episode.force is not None]
    positions = [episode.payload_position for episode in episodes if episode.payload_position is not None]
    randomised = [episode.randomised for episode in episodes if episode.randomised is not None]
    return starts, np.stack(forces) if forces else None, np.stack(positions) if positions else None, randomised


def moved_properties(episodes: Sequence[EpisodeSample]) -> list[MovedProperties]:
    """Return friction and payload of k episodes, which may differ in severity, for `Simulation.reset`."""
    properties = []
    for episode in episodes:
        payload = episode.scenario.payload
        mass = 0.0 if payload is None else payload.mass
        inertia = 0.0 if payload is None else payload.moment_of_inertia
        properties.append(MovedProperties(episode.friction, mass, inertia))
    return properties


def _draw_scan_dropouts(dropouts: ScanDropouts, stream: np.random.Generator, dt: float) -> ScanDropoutPlan:
    """Draw the dropouts of the height scan in an episode; `dt` is the control period, s."""
    first_step = _stratified_start_steps(dropouts, stream, dt)
    angle = stream.uniform(-np.pi, np.pi, dropouts.count)
    is_complete = stream.random(dropouts.count) < 0.5
    is_lost = stream.random() < dropouts.lost_fraction
    side = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    side[is_complete] = 0.0
    # The last dropout is the whole episode, or nothing.
    return ScanDropoutPlan(
        first_step=np.append(first_step, 0),
        end_step=np.append(first_step + control_steps(dropouts.duration, dt), NEVER if is_lost else 0),
        side=np.append(side, np.zeros((1, 2)), axis=0),
    )


def _stratified_start_steps(
    events: Pushes | Dropouts | ScanDropouts, stream: np.random.Generator, dt: float
) -> NDArray[np.int64]:
    """Draw the first control step of each push or dropout, (count,).

    The time window of `events` is divided into `count` equal parts, and each part contains one event at a uniformly
    random time. `dt` is the control period, s.
    """
    edges = np.linspace(*events.window, events.count + 1)
    start = stream.uniform(edges[:-1], edges[1:] - events.duration)
    return np.floor(start / dt).astype(np.int64)
