"""Scenario: complete definition of an episode except the seed, with scaling to another robot."""

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
"""Name suffix of scenarios with the robot's hardware profile: motors, delays, sensors and estimator."""
RANDOMISED = "+randomised"
"""Name suffix of scenarios with domain randomisation."""
SCAN_LOST = "+scan_lost"
"""Name suffix of scenarios in which the height scan shows nothing."""
SUFFIX_FIELDS = {SCAN_LOST: "scan_lost", RANDOMISED: "randomisation", HARDWARE: "hardware"}
"""Name suffix -> field of the scenario that the suffix sets, in the order of the suffixes in a name."""


@dataclass(frozen=True)
class Scenario(Settings):
    """Terrain, disturbances, commands and initial state of an episode; None if a disturbance is absent."""

    name: str
    terrain: Terrain = field(default_factory=Flat)
    pushes: Pushes | None = None
    commands: CommandRanges = field(default_factory=CommandRanges)
    start: StartNoise | AnyPose = field(default_factory=StartNoise)
    severity: float = 0.0
    """Severity on the scenario's axis, in `severity_unit`; 0 if the scenario belongs to no axis."""
    severity_unit: str = ""
    axis: str = ""
    """Name of the axis of `quad_env.scenarios.axes` that contains the scenario; empty if there is none."""
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
    """Ranges of the properties of robot and ground that are drawn for each episode; None to draw nothing."""
    scan_lost: bool = False
    """True if the height scan is lost: every point of the scan reads -2 m, the value of unseen ground."""

    @property
    def suffix(self) -> str:
        """Name suffixes that belong to the fields of the scenario, joined; empty if there are none."""
        return "".join(end for end, field in SUFFIX_FIELDS.items() if getattr(self, field))


def with_hardware_profile(scenario: Scenario) -> Scenario:
    """Return the `scenario` with the hardware profile and its name suffix; unchanged if it has both."""
    return _with_settings(scenario, hardware=True)


def _with_randomisation(scenario: Scenario, robot: Robot) -> Scenario:
    """Return the scenario with domain randomisation, by default with the default ranges for the robot."""
    default = scaled(Scenario("default", randomisation=DomainRandomisation()), robot).randomisation
    return _with_settings(scenario, randomisation=scenario.randomisation or default)


def _without_scan(scenario: Scenario, _: Robot) -> Scenario:
    """Return the scenario with a lost height scan."""
    return _with_settings(scenario, scan_lost=True)


def _with_settings(scenario: Scenario, **settings: Any) -> Scenario:
    """Return the scenario with changed settings and matching name suffixes; unchanged if nothing differs."""
    changed = replace(scenario, **settings)
    name = scenario.name.removesuffix(scenario.suffix) + changed.suffix
    return scenario if changed == scenario else replace(changed, name=name)


SUFFIXES: dict[str, Callable[[Scenario, Robot], Scenario]] = {
    HARDWARE: lambda scenario, _: with_hardware_profile(scenario),
    RANDOMISED: _with_randomisation,
    SCAN_LOST: _without_scan,
}
"""Name suffix -> function of scenario and robot that returns the scenario with the suffix."""


def scaled(scenario: Scenario, robot: Robot) -> Scenario:
    """Scale a scenario of SimpleQuad to another robot by dynamic similarity.

    Commands are scaled at equal Froude number, and pushes at equal speed change relative to the commands. Forces and
    loads are scaled by weight, terrain by leg length, and torques by weight times leg length. Times, noise, friction,
    angles and the severity do not change. The torque limit is at most the robot's rated torque.

    Args:
        scenario: Scenario of SimpleQuad.
        robot: Robot to scale the scenario to.

    Returns:
        The scaled scenario.
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
    """Return the motors with a scaled torque limit, at most the robot's rated torque."""
    if motors.torque_limit is None:
        return motors
    torque_limit = scale_factor(robot, "N·m") * motors.torque_limit
    return replace(motors, torque_limit=min(torque_limit, robot.rated_torque))


def _scaled_payload(payload: Payload | None, robot: Robot) -> Payload | None:
    """Return the payload with scaled mass and lengths."""
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
    """Return the domain randomisation with scaled lengths."""
    if randomisation is None:
        return None
    forward, left, up = randomisation.centre_of_mass
    return replace(randomisation, centre_of_mass=(factor * forward, factor * left, factor * up))


def _scaled_terrain(terrain: Terrain, factor: float) -> Terrain:
    """Return the terrain with scaled lengths; a user's height field keeps its size."""
    if isinstance(terrain, Stairs):
        landing = max(1.0, factor) * terrain.landing  # because smaller robots need as much room at the start
        lengths = {name: factor * getattr(terrain, name) for name in ("rise", "run", "half_width")}
        return replace(terrain, landing=landing, **lengths)
    if isinstance(terrain, SmoothRandom):
        names = ("peak_to_valley", "correlation_length", "half_size", "spawn_radius", "cell")
        return replace(terrain, **{name: factor * getattr(terrain, name) for name in names})
    return terrain
