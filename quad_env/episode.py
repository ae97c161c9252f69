"""What an episode draws from its seed: start, commands and pushes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quad_env.columns import Array
from quad_env.commands import draw_command
from quad_env.scenarios import Pushes, Scenario
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
        """Forces on the trunk during those control steps, (n,); world frame, (n, 2), N. None where nobody is pushed."""
        if not self.steps:
            return None
        since = np.asarray(step)[..., None] - self.first_step
        acting = (since >= 0) & (since < self.steps)
        force: Array = np.where(acting[..., None], self.force, 0.0).sum(axis=-2)
        return force


class Episode:
    """One episode's draws, each kind from its own stream, so that nothing depends on actions or on other robots."""

    def __init__(self, scenario: Scenario, seed: int, number: int, dt: float) -> None:
        self._scenario = scenario
        self._streams = EpisodeStreams(seed, number)
        self.start = draw_start(scenario, self._streams.start)
        self.pushes = draw_pushes(scenario.pushes, self._streams.pushes, dt)

    def next_command(self) -> Array:
        """The next interval's command, (3,): forward and lateral m/s, yaw rate rad/s."""
        return draw_command(self._scenario.commands, self._streams.commands)


def draw_start(scenario: Scenario, stream: np.random.Generator) -> Array:
    """Start of one robot, (35,): x, y, m; yaw, roll, pitch, 12 joint offsets from home, rad; 3 linear, 3 angular and
    12 joint velocities, m/s and rad/s."""
    noise, radius = scenario.start, scenario.terrain.spawn_radius
    widths = (
        (radius, 2),
        (noise.yaw, 1),
        (noise.tilt, 2),
        (noise.joint_position, 12),
        (noise.linear_velocity, 3),
        (noise.angular_velocity, 3),
        (noise.joint_velocity, 12),
    )
    width = np.repeat([half for half, _ in widths], [count for _, count in widths])
    return width * stream.uniform(-1, 1, len(width))


def draw_pushes(pushes: Pushes | None, stream: np.random.Generator, dt: float) -> PushPlan:
    """One push in each part of the window, each in a uniformly random horizontal direction; `dt`: control period, s."""
    if pushes is None or pushes.count == 0:
        return PushPlan(np.empty(0, np.int64), 0, np.empty((0, 2)))
    steps = max(1, round(pushes.duration / dt))
    edges = np.linspace(*pushes.window, pushes.count + 1)
    start = stream.uniform(edges[:-1], edges[1:] - pushes.duration)
    angle = stream.uniform(-np.pi, np.pi, pushes.count)
    force = pushes.impulse / (steps * dt) * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    return PushPlan(np.floor(start / dt).astype(np.int64), steps, force)
