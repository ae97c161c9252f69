"""What an episode draws from its seed: start, commands and disturbances."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quad_env.columns import Array
from quad_env.config import AnyPose
from quad_env.robots.robot import Robot
from quad_env.scenarios.disturbances import Dropouts, Pushes
from quad_env.scenarios.randomisation import RandomizationSample
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import HeightField
from quad_env.seeding import EpisodeStreams


@dataclass(frozen=True)
class PushPlan:
    """Pushes of one episode, or of n with a leading axis; each acts for `steps` control steps, never two at once."""

    first_step: NDArray[np.int64]
    """Control step at which each push begins, (…, count)."""
    steps: int
    force: Array
    """World frame, x and y, (…, count, 2), N."""

    def force_at(self, step: ArrayLike) -> Array | None:
        """Forces on the trunk during those control steps, (n,); world frame, (n, 2), N. None without pushes."""
        if not self.steps:
            return None
        since = np.asarray(step)[..., None] - self.first_step
        acting = (since >= 0) & (since < self.steps)
        return cast("Array", np.where(acting[..., None], self.force, 0.0).sum(axis=-2))


class EpisodeSample:
    """One episode's draws, each kind from its own stream, so that nothing depends on actions or on other robots."""

    def __init__(self, robot: Robot, scenario: Scenario, seed: int, number: int, dt: float) -> None:
        self._scenario = scenario
        self.streams = EpisodeStreams(seed, number)
        self.start = draw_start(robot, scenario, self.streams.start)
        """Start of the robot, see `draw_start`, (35,)."""
        if isinstance(terrain := scenario.terrain, HeightField) and terrain.start is not None:
            self.start[:2] += terrain.start
        self.pushes = _draw_pushes(scenario.pushes, self.streams.pushes, dt)
        self.force: Array | None = None
        """Steady force on the trunk in a uniformly random horizontal direction, world frame, (2,), N."""
        self.payload_position: Array | None = None
        """Centre of the payload, ahead and to the left of the trunk's centre, (2,), m."""
        self.randomised: RandomizationSample | None = None
        """Figures of robot and ground that are not as usual."""
        self.friction = scenario.ground.friction
        """Coefficient of the ground."""
        self.action_delay = 0 if scenario.latency is None else round(scenario.latency.action / dt)
        """Control steps from the policy to the servos."""
        self.dropouts: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None
        """Control step at which each dropout begins, and the joint whose servo receives no targets, (count,) each."""
        if (steady := scenario.force) is not None:
            angle = self.streams.force.uniform(-np.pi, np.pi)
            self.force = steady.force * np.array((np.cos(angle), np.sin(angle)))
        if (payload := scenario.payload) is not None:
            self.payload_position = self.streams.payload.uniform(-1, 1, 2) * np.array(payload.reach)
        if (dropouts := scenario.dropouts) is not None:
            first_step = _stratified_start_steps(dropouts, self.streams.dropouts, dt)
            self.dropouts = first_step, self.streams.dropouts.integers(robot.num_joints, size=dropouts.count)
        if (randomisation := scenario.randomisation) is not None:
            self.randomised = randomisation.draw(robot.num_joints, self.streams.randomisation)
            self.friction *= self.randomised.friction
            self.action_delay += round(self.randomised.delay / dt)

    def next_command(self) -> Array:
        """The next interval's command, (3,): forward and lateral m/s, yaw rate rad/s.

        Always four numbers from the stream, so that a zero command shifts nothing.
        """
        ranges, (coin, *unit) = self._scenario.commands, self.streams.commands.random(4)
        low, high = np.transpose((ranges.forward, ranges.lateral, ranges.yaw_rate))
        return np.zeros(3) if coin < ranges.zero_fraction else low + (high - low) * np.asarray(unit)


def draw_start(robot: Robot, scenario: Scenario, stream: np.random.Generator) -> Array:
    """Start of one robot, (35,): x, y, m; yaw, roll, pitch, 12 joint offsets from home, rad; 3 linear, 3 angular and
    12 joint velocities, m/s and rad/s."""
    noise, radius, joints = scenario.start, scenario.terrain.spawn_radius, robot.num_joints
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
    width = np.repeat([half for half, _ in widths], [count for _, count in widths])
    return width * stream.uniform(-1, 1, len(width))


def _draw_any_pose(robot: Robot, start: AnyPose, radius: float, stream: np.random.Generator) -> Array:
    """A start row of `draw_start`, uniform over orientations: yaw, the sine of the pitch and roll are uniform."""
    place, (yaw, sin_pitch, roll) = radius * stream.uniform(-1, 1, 2), stream.uniform(-1, 1, 3)
    angles = (np.pi * yaw, np.pi * roll, np.arcsin(sin_pitch))
    joints = stream.uniform(robot.joint_lower, robot.joint_upper) - robot.home_pose
    width = np.repeat([start.linear_velocity, start.angular_velocity, start.joint_velocity], [3, 3, len(joints)])
    return np.concatenate((place, angles, joints, width * stream.uniform(-1, 1, len(width))))


def _draw_pushes(pushes: Pushes | None, stream: np.random.Generator, dt: float) -> PushPlan:
    """One push in each part of the window, each in a uniformly random horizontal direction; `dt`: control period, s."""
    if pushes is None or pushes.count == 0:
        return PushPlan(np.empty(0, np.int64), 0, np.empty((0, 2)))
    steps = control_steps(pushes.duration, dt)
    first_step = _stratified_start_steps(pushes, stream, dt)
    angle = stream.uniform(-np.pi, np.pi, pushes.count)
    force = pushes.impulse / (steps * dt) * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    return PushPlan(first_step, steps, force)


def control_steps(duration: float, dt: float) -> int:
    """Whole control steps of something that lasts so long, s: at least one."""
    return max(1, round(duration / dt))


def stack_initial_conditions(
    episodes: Sequence[EpisodeSample],
) -> tuple[Array, Array | None, Array | None, list[RandomizationSample]]:
    """Starts, (k, 35), forces, (k, 2), and loads, (k, 2), of k episodes of one scenario, None where it has none; and
    what of robot and ground was drawn, k or none."""
    starts = np.stack([episode.start for episode in episodes])
    forces = [episode.force for episode in episodes if episode.force is not None]
    loads = [episode.payload_position for episode in episodes if episode.payload_position is not None]
    randomised = [episode.randomised for episode in episodes if episode.randomised is not None]
    return starts, np.stack(forces) if forces else None, np.stack(loads) if loads else None, randomised


def _stratified_start_steps(events: Pushes | Dropouts, stream: np.random.Generator, dt: float) -> NDArray[np.int64]:
    """First control step of each event, (count,)."""
    edges = np.linspace(*events.window, events.count + 1)
    start = stream.uniform(edges[:-1], edges[1:] - events.duration)
    return np.floor(start / dt).astype(np.int64)
