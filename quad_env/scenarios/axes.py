"""Axes of disturbance: one kind of trouble each, as scenarios from harmless to where robots fall.

A severity is in the axis's own physical unit, its levels chosen for SimpleQuad. `push` is the axis at its nominal
severity, `push:3` its third level.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from quad_env.config import CommandRanges
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Dropouts, Ground, Latency, Motors, Payload, Pushes, SensorNoise, SteadyForce
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import Slope, SmoothRandom, Stairs


@dataclass(frozen=True)
class Axis:
    """A scenario for each severity."""

    name: str
    unit: str
    levels: tuple[float, ...]
    """Severities from the mildest to the hardest; where less is harder, as with friction, they fall."""
    at: Callable[[float], Scenario]
    """The scenario of a severity; its name, axis and severity are filled in here."""
    nominal: float
    """Severity of the scenario that has the axis's bare name."""
    quantity: str
    """What the severity is, in words."""
    end: str
    """Why the levels end where they do: everybody falls, or what is physically beyond."""

    @property
    def falling(self) -> bool:
        """Whether a smaller severity is harder."""
        return self.levels[0] > self.levels[-1]

    def level(self, number: int) -> Scenario:
        """The scenario of the level of that number, counted from 1; ValueError names the valid ones."""
        if not 1 <= number <= len(self.levels):
            raise ValueError(f"{self.name} has levels 1 to {len(self.levels)}, not {number}")
        return self.scenario(self.levels[number - 1], f"{self.name}:{number}")

    def scenario(self, severity: float, name: str) -> Scenario:
        """The scenario of that severity under that name."""
        return replace(self.at(severity), name=name, axis=self.name, severity=severity, severity_unit=self.unit)


def _flat(top_speed: float) -> Scenario:
    """The ranges of `CommandRanges`, all in proportion to the top commanded forward speed."""
    ranges = CommandRanges()
    share = top_speed / ranges.forward[1]
    forward, lateral, yaw_rate = (
        (share * low, share * high) for low, high in (ranges.forward, ranges.lateral, ranges.yaw_rate)
    )
    return Scenario("flat", commands=replace(ranges, forward=forward, lateral=lateral, yaw_rate=yaw_rate))


def _push(impulse: float) -> Scenario:
    return Scenario("push", pushes=Pushes(impulse=impulse))


def _force(force: float) -> Scenario:
    return Scenario("force", force=SteadyForce(force))


def _rough(peak_to_valley: float) -> Scenario:
    return Scenario("rough", terrain=SmoothRandom(peak_to_valley=peak_to_valley))


def _slope(degrees: float) -> Scenario:
    return Scenario("slope", terrain=Slope(math.radians(degrees)))


def _stairs(rise: float) -> Scenario:
    return Scenario("stairs", terrain=Stairs(rise))


def _gravel(peak_to_valley: float) -> Scenario:
    """Stones of about two feet's size: a foot is a ball of 0.04 m."""
    return Scenario("gravel", terrain=SmoothRandom(peak_to_valley, correlation_length=0.08, cell=0.04))


def _soft(sink_depth: float) -> Scenario:
    return Scenario("soft", ground=Ground(sink_depth=sink_depth))


def _slippery(friction: float) -> Scenario:
    return Scenario("slippery", ground=Ground(friction=friction))


def _payload(mass: float) -> Scenario:
    return Scenario("payload", payload=Payload(mass))


def _weak_motors(torque_limit: float) -> Scenario:
    return Scenario("weak_motors", motors=Motors(torque_limit=torque_limit))


def _slow_motors(bandwidth: float) -> Scenario:
    return Scenario("slow_motors", motors=Motors(bandwidth=bandwidth))


def _latency(delay: float) -> Scenario:
    return Scenario("latency", latency=Latency(action=delay, observation=delay))


def _noise(gyro: float) -> Scenario:
    return Scenario("noise", noise=SensorNoise(gyro))


def _dropout(duration: float) -> Scenario:
    return Scenario("dropout", dropouts=Dropouts(duration=duration))


def _surprise(share: float) -> Scenario:
    """All at once: at share 1 each disturbance has the amplitude written here, at another share that share of it.

    Where less is harder it goes geometrically: friction 0.8 · 0.75^share, torque limit 100 N·m · 0.5^share. A servo's
    time constant is in proportion. Latency is in whole control steps.
    """
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


FALLS = "every shipped policy that walks falls in four of five episodes"

AXES: dict[str, Axis] = {
    axis.name: axis
    for axis in (
        Axis(
            "flat",
            "m/s",
            (1.0, 1.5, 2.0, 3.0, 4.5, 6.0),
            _flat,
            1.5,
            "top commanded forward speed",
            "a leg of 0.6 m at its rated 10 rad/s",
        ),
        Axis(
            "push",
            "N·s",
            (20.0, 35.0, 50.0, 65.0, 80.0, 100.0, 140.0, 200.0),
            _push,
            35.0,
            "impulse of each push",
            FALLS,
        ),
        Axis("rough", "m", (0.06, 0.12, 0.18, 0.24, 0.32, 0.4, 0.5), _rough, 0.12, "height from valley to peak", FALLS),
        Axis(
            "force",
            "N",
            (20.0, 40.0, 60.0, 80.0, 110.0, 140.0),
            _force,
            40.0,
            "steady horizontal force",
            "more than the friction of all feet on level ground, 111 N",
        ),
        Axis(
            "slope",
            "°",
            (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0),
            _slope,
            15.0,
            "angle of the plane",
            "nearly the friction angle, 39°",
        ),
        Axis(
            "stairs",
            "m",
            (0.05, 0.1, 0.15, 0.2, 0.3, 0.4),
            _stairs,
            0.1,
            "rise of a step, run 0.3 m",
            "higher than the hips of a robot that trots",
        ),
        Axis(
            "gravel",
            "m",
            (0.04, 0.08, 0.12, 0.16, 0.24, 0.32),
            _gravel,
            0.08,
            "height from valley to peak",
            "spikes four times as high as they are apart",
        ),
        Axis(
            "soft",
            "m",
            (0.005, 0.01, 0.02, 0.04, 0.08, 0.16),
            _soft,
            0.02,
            "depth that standing feet sink",
            "a standing robot's knees touch the ground, a trotting one's sink in",
        ),
        Axis(
            "slippery",
            "",
            (0.6, 0.4, 0.2, 0.1, 0.05, 0.02),
            _slippery,
            0.4,
            "friction coefficient",
            "0.7 N move a foot that carries a quarter of the weight",
        ),
        Axis(
            "payload",
            "kg",
            (2.5, 5.0, 10.0, 20.0, 40.0, 60.0),
            _payload,
            5.0,
            "mass on the trunk",
            "four times the robot's own mass",
        ),
        Axis(
            "weak_motors",
            "N·m",
            (50.0, 30.0, 20.0, 10.0, 5.0, 2.5),
            _weak_motors,
            20.0,
            "torque limit",
            "the knees need 4 N·m to stand in the home pose: the robot sits down",
        ),
        Axis(
            "slow_motors",
            "Hz",
            (20.0, 10.0, 5.0, 2.0, 1.0, 0.5),
            _slow_motors,
            5.0,
            "bandwidth of the servos",
            "slower than a stride: the legs hardly move",
        ),
        Axis(
            "latency",
            "s",
            (0.01, 0.02, 0.04, 0.08, 0.16, 0.32),
            _latency,
            0.02,
            "delay of actions, and of readings",
            "more than a stride from reading to action",
        ),
        Axis(
            "noise",
            "rad/s",
            (0.1, 0.2, 0.4, 0.8, 1.6, 3.2),
            _noise,
            0.2,
            "standard deviation of the gyro's noise",
            "the noise of the gravity reading is as large as gravity",
        ),
        Axis(
            "dropout",
            "s",
            (0.1, 0.2, 0.4, 0.8, 1.4, 2.0),
            _dropout,
            0.4,
            "time that a joint hears nothing",
            "from the first second on, some joint always hears nothing",
        ),
        Axis(
            "surprise", "", (0.5, 1.0, 1.5, 2.0, 3.0, 4.0), _surprise, 1.0, "share of the reference amplitudes", FALLS
        ),
    )
}
