"""Disturbance axes: each is a series of scenarios with one disturbance of increasing severity.

This module defines the axes and finds an axis by its name. The severity is the strength of the disturbance, in a
physical unit, such as N·s for pushes. The levels of an axis are numbered severities from harmless to hard, chosen for
SimpleQuad. At the last level, each policy of this project that walks on level ground falls in four of five episodes.
On some axes the last level exceeds a physical limit instead, which the docstring of the axis states. On the axis
`slow` no robot falls.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache

from quad_env.config import CommandRanges
from quad_env.extensions import check_new, when_added
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import scale_factor
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Dropouts, Ground, Latency, Motors, Payload, Pushes, SensorNoise, SteadyForce
from quad_env.scenarios.scenario import Scenario, scaled
from quad_env.scenarios.terrain import Slope, SmoothRandom, Stairs

AtSeverity = Callable[[float], Scenario]
"""Type of a function of a severity, in the unit of its disturbance axis, that returns a scenario."""


@dataclass(frozen=True)
class Axis:
    """Disturbance axis: scenarios with one disturbance of adjustable strength (severity).

    The levels of the axis are a few numbered severities, from easy to hard.
    """

    name: str
    at: AtSeverity
    """Function that takes a severity, in `unit`, and returns the scenario with this severity.

    The method `scenario` calls this function, and then sets the name, axis and severity of the returned scenario.
    """
    quantity: str
    """Description of the quantity that the severity measures, for example `mass on the trunk`."""
    unit: str
    levels: tuple[float, ...]
    """Severities of the numbered levels from easy to hard, in `unit`.

    The numbers decrease if a smaller severity is harder, as with friction.
    """
    nominal: float
    """Severity, in `unit`, of the scenario with the name of the axis only, for example `push`.

    The nominal severity is one of the severities in `levels`.
    """
    sentence: str = ""
    """Description of the scenarios of this axis in one sentence, for lists and reports."""
    scales: bool = True
    """True if the severities are scaled to the size of another robot.

    The axis `slow` is not scaled, because the speed that counts as success is the same for every robot.
    """
    note: str = ""
    """Note that is printed with the results of this axis: influences other than the policy, such as friction."""

    @property
    def harder_when_smaller(self) -> bool:
        """True if a smaller severity is harder for the robot, as with friction."""
        return self.levels[0] > self.levels[-1]

    @property
    def nominal_level(self) -> int:
        """Number of the level that has the nominal severity, counted from 1."""
        return self.levels.index(self.nominal) + 1

    def level(self, number: int) -> Scenario:
        """Return the scenario of a numbered level of the axis.

        Args:
            number: Number of the level, counted from 1.

        Returns:
            The scenario, which is named by the axis and the level.

        Raises:
            ValueError: There is no level of this number; the message names the valid numbers.
        """
        if not 1 <= number <= len(self.levels):
            raise ValueError(f"{self.name} has levels 1 to {len(self.levels)}, not {number}")
        return self.scenario(self.levels[number - 1], f"{self.name}:{number}")

    def scenario(self, severity: float, name: str) -> Scenario:
        """Return the scenario of the axis at a `severity`, in the unit of the axis, with the given `name`."""
        return replace(self.at(severity), name=name, axis=self.name, severity=severity, severity_unit=self.unit)

    def for_robot(self, robot: Robot) -> "Axis":
        """Return a copy of this axis for `robot`, or the axis itself for SimpleQuad.

        The severities of the copy are scaled so that they are as hard for `robot` as for SimpleQuad.
        """
        if robot == SIMPLE_QUAD or not self.scales:
            return self
        factor = self.scaled(1.0, robot)
        return replace(
            self,
            at=lambda severity: scaled(self.at(severity / factor), robot),
            levels=tuple(self.scaled(level, robot) for level in self.levels),
            nominal=self.scaled(self.nominal, robot),
        )

    def scaled(self, severity: float, robot: Robot) -> float:
        """Scale a `severity`, in the unit of the axis, so that the result is as hard for `robot` as for SimpleQuad."""
        return severity * (scale_factor(robot, self.unit) if self.scales and self.unit in ROBOT_SCALED_UNITS else 1.0)

    def of(self, robot: Robot) -> "Axis":
        """Return `for_robot(robot)`; deprecated name of `for_robot`."""
        return self.for_robot(robot)

    @property
    def falling(self) -> bool:
        """Deprecated name of `harder_when_smaller`."""
        return self.harder_when_smaller


ROBOT_SCALED_UNITS = ("m/s", "N·s", "m", "N", "kg", "N·m")
"""Units of severities that depend on the size of the robot: a severity with one of these units is scaled to the robot.

Severities with other units, such as delays in s, bandwidths in Hz and gyro noise in rad/s, are the same for every
robot.
"""
_PUSH_NOTE = (
    "Pushed hard, the feet slide, and falls depend on friction and on how a simulator models it: of 24 episodes at "
    "65 N·s SimpleQuad's trot falls in 16, at friction 0.6 instead of 0.8 in 3 (docs/limits.md)."
)
"""Note that is printed with the results of the axis `push`.

The command `python -m research sliding` measured the numbers in the note.
"""
AXES: dict[str, Axis] = {}
"""Name -> built-in disturbance axis, with severities for SimpleQuad."""


@lru_cache(maxsize=32)
def axes_of(robot: Robot) -> dict[str, Axis]:
    """Return the built-in disturbance axes with severities scaled to `robot`: name -> axis.

    Batteries, the predefined lists of scenarios of the evaluator, use only built-in axes.
    """
    return {name: axis.for_robot(robot) for name, axis in AXES.items()}


@cache
def extension_axes() -> dict[str, Axis]:
    """Return the disturbance axes that extensions add.

    Returns:
        Name -> axis, with severities for SimpleQuad.

    Raises:
        ValueError: An object is not an `Axis`, its `name` is not its key in the extension, or the name is built-in.
    """
    axes = check_new("axes", AXES)
    for name, axis in axes.items():
        if not isinstance(axis, Axis) or axis.name != name:
            raise ValueError(f"extension: axes {name}: expected a quad_env.Axis of this name, got {axis!r}")
    return axes


when_added(extension_axes.cache_clear)


def known_axis(name: str) -> Axis | None:
    """Return the disturbance axis `name` for SimpleQuad, built-in or of an extension; None if unknown."""
    return AXES[name] if name in AXES else extension_axes().get(name)


def known_axes(robot: Robot) -> dict[str, Axis]:
    """Return all disturbance axes, built-in and of extensions, scaled to `robot`: name -> axis."""
    return axes_of(robot) | {name: axis.for_robot(robot) for name, axis in extension_axes().items()}


def _axis(
    quantity: str, unit: str, levels: tuple[float, ...], nominal: float, *, scales: bool = True, note: str = ""
) -> Callable[[AtSeverity], AtSeverity]:
    """Return a decorator that registers a function from severity to scenario as an axis.

    The axis is named like the scenarios that the function returns. Its `sentence` is the first sentence of the
    function's docstring.
    """

    def add(at: AtSeverity) -> AtSeverity:
        name = at(nominal).name
        text = " ".join((at.__doc__ or "").split())
        sentence = text.partition(". ")[0].rstrip(".") + "."
        AXES[name] = Axis(name, at, quantity, unit, levels, nominal, sentence, scales, note)
        return at

    return add


@_axis("top commanded forward speed", "m/s", (1.0, 1.5, 2.0, 3.0, 4.5, 6.0), nominal=1.5)
def _flat(top_speed: float) -> Scenario:
    """Level ground, and commands from ranges in proportion to the top commanded forward speed.

    The ranges are `CommandRanges()` times a factor. At the last level, the top speed is 6 m/s. This is the speed of the
    foot of a leg of 0.6 m that turns at its rated 10 rad/s.
    """
    ranges = CommandRanges()
    scale = top_speed / ranges.forward[1]
    return Scenario("flat", commands=ranges.scaled(scale, scale))


@_axis(
    "impulse of each push", "N·s", (20.0, 35.0, 50.0, 65.0, 80.0, 100.0, 140.0, 200.0), nominal=35.0, note=_PUSH_NOTE
)
def _push(impulse: float) -> Scenario:
    """Two pushes an episode, at random times and in random directions."""
    return Scenario("push", pushes=Pushes(impulse=impulse))


@_axis("height from valley to peak", "m", (0.06, 0.12, 0.18, 0.24, 0.32, 0.4, 0.5), nominal=0.12)
def _rough(peak_to_valley: float) -> Scenario:
    """Random ground, another surface in every episode."""
    return Scenario("rough", terrain=SmoothRandom(peak_to_valley=peak_to_valley))


@_axis("steady horizontal force", "N", (20.0, 40.0, 60.0, 80.0, 110.0, 140.0), nominal=40.0)
def _force(force: float) -> Scenario:
    """Steady force on the trunk in a random direction, for example wind.

    The last level exceeds the friction force of all feet on level ground, 111 N.
    """
    return Scenario("force", force=SteadyForce(force))


@_axis("angle of the plane", "°", (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0), nominal=15.0)
def _slope(degrees: float) -> Scenario:
    """Plane that the robot crosses in all directions.

    The plane of the last level, 35°, is nearly as steep as the friction angle, 39°, at which feet begin to slide.
    """
    return Scenario("slope", terrain=Slope(math.radians(degrees)))


@_axis("rise of a step, run half a leg", "m", (0.05, 0.1, 0.15, 0.2, 0.3, 0.4), nominal=0.1)
def _stairs(rise: float) -> Scenario:
    """Stairs up and down from a landing.

    At the last level, a step is higher than the hips of a trotting robot.
    """
    return Scenario("stairs", terrain=Stairs(rise))


@_axis("height from valley to peak", "m", (0.04, 0.08, 0.12, 0.16, 0.24, 0.32), nominal=0.08)
def _gravel(peak_to_valley: float) -> Scenario:
    """Random ground of stones, each about two feet long.

    A foot is a ball of 0.04 m. At the last level, the stones are spikes four times as high as their distance. The
    correlation length of the heights is short, so each square of 2 m × 2 m is effectively a different surface.
    """
    terrain = SmoothRandom(peak_to_valley, correlation_length=0.08, cell=0.04, half_size=26.0, spawn_radius=8.0)
    return Scenario("gravel", terrain=terrain)


@_axis("depth that standing feet sink", "m", (0.005, 0.01, 0.02, 0.04, 0.08, 0.16), nominal=0.02)
def _soft(sink_depth: float) -> Scenario:
    """Ground that gives way like a damped spring under each foot.

    At the last level a standing robot's knees touch the ground and a trotting robot's knees sink in.
    """
    return Scenario("soft", ground=Ground(sink_depth=sink_depth))


@_axis("friction coefficient", "", (0.6, 0.4, 0.2, 0.1, 0.05, 0.02), nominal=0.4)
def _slippery(friction: float) -> Scenario:
    """Level ground of little friction.

    At the last level, a horizontal force of 0.7 N moves a foot that carries a quarter of the robot's weight.
    """
    return Scenario("slippery", ground=Ground(friction=friction))


@_axis("mass on the trunk", "kg", (2.5, 5.0, 10.0, 20.0, 40.0, 60.0), nominal=5.0)
def _payload(mass: float) -> Scenario:
    """Load somewhere on the trunk, at another place in every episode.

    At the last level, the load has four times the mass of the robot.
    """
    return Scenario("payload", payload=Payload(mass))


@_axis("torque limit", "N·m", (50.0, 30.0, 20.0, 10.0, 5.0, 2.5), nominal=20.0)
def _weak_motors(torque_limit: float) -> Scenario:
    """Motors of less torque.

    At the last level, the robot sits down, because its knees need 4 N·m to stand in the home pose.
    """
    return Scenario("weak_motors", motors=Motors(torque_limit=torque_limit))


@_axis("bandwidth of the servos", "Hz", (20.0, 10.0, 5.0, 2.0, 1.0, 0.5), nominal=5.0)
def _slow_motors(bandwidth: float) -> Scenario:
    """Servos that follow their targets late.

    At the last level, the servos are slower than a stride, so that the legs hardly move.
    """
    return Scenario("slow_motors", motors=Motors(bandwidth=bandwidth))


@_axis("delay of actions, and of readings", "s", (0.01, 0.02, 0.04, 0.08, 0.16, 0.32), nominal=0.02)
def _latency(delay: float) -> Scenario:
    """Actions arrive late, and readings as late again.

    At the last level, the delay from a reading to the resulting action is longer than a stride.
    """
    return Scenario("latency", latency=Latency(action=delay, observation=delay))


@_axis("standard deviation of the gyro's noise", "rad/s", (0.1, 0.2, 0.4, 0.8, 1.6, 3.2), nominal=0.2)
def _noise(gyro: float) -> Scenario:
    """Noise on everything that is sensed, in proportion to the gyro's.

    At the last level, the noise of the measured gravity direction is about as large as its unit length.
    """
    return Scenario("noise", noise=SensorNoise(gyro))


@_axis("time that a joint receives no targets", "s", (0.1, 0.2, 0.4, 0.8, 1.4, 2.0), nominal=0.4)
def _dropout(duration: float) -> Scenario:
    """Four times an episode one joint's servo receives no targets and holds its last target.

    At the last level, from the first second on, there is always one joint that receives no targets.
    """
    return Scenario("dropout", dropouts=Dropouts(duration=duration))


def _check_positive(quantity: str, value: float) -> None:
    """Raise ValueError if the severity `value` of an axis is not above zero; `quantity` names the severity.

    Some axes have no scenario at severity zero.
    """
    if not value > 0:
        raise ValueError(f"the {quantity} must be more than 0, got {value}")


@_axis("share of the reference amplitudes", "", (0.5, 1.0, 1.5, 2.0, 3.0, 4.0), nominal=1.0)
def _surprise(share: float) -> Scenario:
    """Rough ground, pushes, wind, a load, weak and slow motors, latency, noise and dropouts at once.

    Each amplitude is `share` times the reference value in the code. Quantities that are harder when smaller decrease
    exponentially: friction 0.8 · 0.75^share, torque limit 100 N·m · 0.5^share. The time constant of the servos grows in
    proportion to `share`. Latencies are rounded to whole control steps.
    """
    _check_positive("share", share)
    return Scenario(
        "surprise",
        terrain=SmoothRandom(peak_to_valley=0.06 * share),
        pushes=Pushes(impulse=20.0 * share),
        force=SteadyForce(10.0 * share),
        ground=Ground(friction=Ground().friction * 0.75**share),
        payload=Payload(2.0 * share),
        motors=Motors(torque_limit=SIMPLE_QUAD.rated_torque * 0.5**share, bandwidth=20.0 / share),
        latency=Latency(action=0.01 * share, observation=0.01 * share),
        noise=SensorNoise(0.1 * share),
        dropouts=Dropouts(duration=0.1 * share),
    )


@_axis("commanded forward speed", "m/s", (0.2, 0.1, 0.05), nominal=0.2, scales=False)
def _slow(speed: float) -> Scenario:
    """Level ground, and always straight ahead at one slow speed: where a policy no longer moves is its dead zone.

    The last level is 0.05 m/s. The rule of success requires that a robot moves if its command is above this speed.
    Observations and stored results hold commands in single precision, where 0.05 is 0.0500000007. So the last level is
    just above the limit.
    """
    _check_positive("speed", speed)
    return Scenario("slow", commands=CommandRanges.straight(speed))
