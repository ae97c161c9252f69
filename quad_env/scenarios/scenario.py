"""Scenario: terrain, disturbances, commands and start of an episode, with scaling to another robot."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from quad_env.config import AnyPose, CommandRanges, Settings, StartNoise
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import scale_factor
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Dropouts, Ground, Latency, Motors, Payload, Pushes, SensorNoise, SteadyForce
from quad_env.scenarios.randomisation import DomainRandomisation
from quad_env.scenarios.terrain import Flat, SmoothRandom, Stairs, Terrain

HARDWARE = "+hardware"
"""Name suffix of scenarios with the robot's hardware profile: realistic motors, delays, sensors and estimator."""
RANDOMISED = "+randomised"
"""Name suffix of scenarios with domain randomisation: properties of robot and ground vary between episodes."""
SCAN_LOST = "+scan_lost"
"""Name suffix of scenarios in which every point of the height scan reads -2 m, as for unseen ground."""
SUFFIX_FIELDS = {SCAN_LOST: "scan_lost", RANDOMISED: "randomisation", HARDWARE: "hardware"}
"""Name suffix -> name of the field of `Scenario` that the suffix sets, in the order of the suffixes in a name."""


@dataclass(frozen=True)
class Scenario(Settings):
    """Definition of an episode, except its seed: terrain, disturbances, commands and initial state.

    The field of a disturbance is None if the scenario does not have this disturbance.
    """

    name: str
    terrain: Terrain = field(default_factory=Flat)
    pushes: Pushes | None = None
    commands: CommandRanges = field(default_factory=CommandRanges)
    start: StartNoise | AnyPose = field(default_factory=StartNoise)
    severity: float = 0.0
    """Strength of the disturbance that the scenario's axis varies, in `severity_unit`; 0 if `axis` is empty."""
    severity_unit: str = ""
    axis: str = ""
    """Name of the disturbance axis that the scenario belongs to, see `quad_env.scenarios.axes`; empty if none."""
    force: SteadyForce | None = None
    ground: Ground = field(default_factory=Ground)
    motors: Motors = field(default_factory=Motors)
    payload: Payload | None = None
    latency: Latency | None = None
    noise: SensorNoise | None = None
    dropouts: Dropouts | None = None
    hardware: bool = False
    """True if the robot has its hardware profile, which `quad_env.actuation.hardware` defines.

    False for ideal motors, no delays, and observations of the true state.
    """
    randomisation: DomainRandomisation | None = None
    """Ranges of robot and ground properties that are drawn at random for each episode; None for fixed properties."""
    scan_lost: bool = False
    """True if the height scan fails: every point of the scan reads -2 m, the value of unseen ground."""

    @property
    def suffix(self) -> str:
        """Concatenated name suffixes of the scenario, for example `+randomised+hardware`; empty if none."""
        return "".join(end for end, field in SUFFIX_FIELDS.items() if getattr(self, field))


def with_hardware_profile(scenario: Scenario) -> Scenario:
    """Return `scenario` with the robot's hardware profile and the name suffix `+hardware`.

    The hardware profile has realistic motors, delays, sensors and estimator. A scenario that has it stays unchanged.
    """
    return _with_settings(scenario, hardware=True)


def _with_randomisation(scenario: Scenario, robot: Robot) -> Scenario:
    """Return `scenario` with domain randomisation and the name suffix `+randomised`.

    A scenario that has randomisation ranges keeps them; otherwise it gets the default ranges, scaled to `robot`.
    """
    default = scaled(Scenario("default", randomisation=DomainRandomisation()), robot).randomisation
    return _with_settings(scenario, randomisation=scenario.randomisation or default)


def _without_scan(scenario: Scenario, _: Robot) -> Scenario:
    """Return `scenario` with a failed height scan and the name suffix `+scan_lost`."""
    return _with_settings(scenario, scan_lost=True)


def _with_settings(scenario: Scenario, **settings: Any) -> Scenario:
    """Return `scenario` with changed fields, field name -> new value, and with matching name suffixes.

    The scenario is returned unchanged if no field changes.
    """
    changed = replace(scenario, **settings)
    name = scenario.name.removesuffix(scenario.suffix) + changed.suffix
    return scenario if changed == scenario else replace(changed, name=name)


SUFFIXES: dict[str, Callable[[Scenario, Robot], Scenario]] = {
    HARDWARE: lambda scenario, _: with_hardware_profile(scenario),
    RANDOMISED: _with_randomisation,
    SCAN_LOST: _without_scan,
}
"""Name suffix -> function of scenario and robot that returns the scenario with this suffix and its settings."""


def scaled(scenario: Scenario, robot: Robot) -> Scenario:
    """Scale a scenario of SimpleQuad to another robot by dynamic similarity.

    Commands are scaled at equal Froude number. Pushes are scaled so that they change the robot's speed by the same
    fraction of the commands. Forces and loads are scaled by weight, terrain by leg length, and torques by weight times
    leg length. Times, noise, friction, angles and the field `severity` do not change. The torque limit is at most the
    robot's rated torque.

    Args:
        scenario: Scenario of SimpleQuad.
        robot: Robot to scale the scenario to.

    Returns:
        The scaled scenario; the same object if the robot is SimpleQuad.
    """
    if robot == SIMPLE_QUAD:
        return scenario
    factor = partial(scale_factor, robot)
    pushes = scenario.pushes
    force = scenario.force
    return replace(
        scenario,
        terrain=_scaled_terrain(scenario.terrain, factor("m")),
        commands=scenario.commands.scaled(factor("m/s"), factor("rad/s")),
        pushes=pushes and replace(pushes, impulse=factor("N·s") * pushes.impulse),
        force=force and replace(force, force=factor("N") * force.force),
        ground=replace(scenario.ground, sink_depth=factor("m") * scenario.ground.sink_depth),
        motors=_scaled_motors(scenario.motors, robot),
        payload=_scaled_payload(scenario.payload, robot),
        randomisation=_scaled_randomisation(scenario.randomisation, factor("m")),
    )


def _scaled_motors(motors: Motors, robot: Robot) -> Motors:
    """Scale the torque limit of SimpleQuad's motors to `robot`; the result is at most its rated torque."""
    if motors.torque_limit is None:
        return motors
    torque_limit = scale_factor(robot, "N·m") * motors.torque_limit
    return replace(motors, torque_limit=min(torque_limit, robot.rated_torque))


def _scaled_payload(payload: Payload | None, robot: Robot) -> Payload | None:
    """Scale mass and lengths of SimpleQuad's payload to `robot`; None stays None."""
    if payload is None:
        return None
    length_factor = scale_factor(robot, "m")
    forward, left = payload.reach
    return replace(
        payload,
        mass=scale_factor(robot, "kg") * payload.mass,
        reach=(length_factor * forward, length_factor * left),
        edge=length_factor * payload.edge,
    )


def _scaled_randomisation(randomisation: DomainRandomisation | None, factor: float) -> DomainRandomisation | None:
    """Multiply the lengths in the randomisation ranges by `factor`; None stays None."""
    if randomisation is None:
        return None
    forward, left, up = randomisation.centre_of_mass
    return replace(randomisation, centre_of_mass=(factor * forward, factor * left, factor * up))


def _scaled_terrain(terrain: Terrain, factor: float) -> Terrain:
    """Multiply the lengths of stairs and random ground by `factor`; other terrains stay unchanged."""
    if isinstance(terrain, Stairs):
        landing = max(1.0, factor) * terrain.landing  # because smaller robots need as much room at the start
        lengths = {name: factor * getattr(terrain, name) for name in ("rise", "run", "half_width")}
        return replace(terrain, landing=landing, **lengths)
    if isinstance(terrain, SmoothRandom):
        names = ("peak_to_valley", "correlation_length", "half_size", "spawn_radius", "cell")
        return replace(terrain, **{name: factor * getattr(terrain, name) for name in names})
    return terrain
