"""Scenario: complete definition of an episode except its seed, and its scaling to another robot."""

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
"""Suffix of the names of scenarios on the hardware profile."""
RANDOMISED = "+randomised"
"""Suffix of the names of scenarios with domain randomisation."""
SCAN_LOST = "+scan_lost"
"""Suffix of the names of scenarios with a height scan that shows nothing."""
SUFFIX_FIELDS = {SCAN_LOST: "scan_lost", RANDOMISED: "randomisation", HARDWARE: "hardware"}
"""Suffix of a name -> the field of the scenario that it sets, in the order in which suffixes are written."""


@dataclass(frozen=True)
class Scenario(Settings):
    """Terrain, disturbances, commands and start of an episode; None is the absence of a disturbance."""

    name: str
    terrain: Terrain = field(default_factory=Flat)
    pushes: Pushes | None = None
    commands: CommandRanges = field(default_factory=CommandRanges)
    start: StartNoise | AnyPose = field(default_factory=StartNoise)
    severity: float = 0.0
    """Severity on the scenario's axis, in `severity_unit`; 0 without an axis."""
    severity_unit: str = ""
    axis: str = ""
    """Name of the axis of `quad_env.scenarios.axes` that contains the scenario; empty without."""
    force: SteadyForce | None = None
    ground: Ground = field(default_factory=Ground)
    motors: Motors = field(default_factory=Motors)
    payload: Payload | None = None
    latency: Latency | None = None
    noise: SensorNoise | None = None
    dropouts: Dropouts | None = None
    hardware: bool = False
    """True if the robot has its hardware profile, see `quad_env.actuation.hardware`, instead of ideal motors, no delay
    and observations of its true state."""
    randomisation: DomainRandomisation | None = None
    """Properties of robot and ground that are drawn for each episode; None for none."""
    scan_lost: bool = False
    """True if a height scan shows nothing: each of its points reads -2 m, as unseen ground does."""

    @property
    def suffix(self) -> str:
        """Suffixes that the name of the scenario has by its fields."""
        return "".join(end for end, field in SUFFIX_FIELDS.items() if getattr(self, field))


def with_hardware_profile(scenario: Scenario) -> Scenario:
    """Return the `scenario` on the hardware profile, with the suffix HARDWARE; unchanged if it has it."""
    return _with_settings(scenario, hardware=True)


def _with_randomisation(scenario: Scenario, robot: Robot) -> Scenario:
    """Return the scenario with domain randomisation, by default the usual one scaled to the robot."""
    default = scaled(Scenario("default", randomisation=DomainRandomisation()), robot).randomisation
    return _with_settings(scenario, randomisation=scenario.randomisation or default)


def _without_scan(scenario: Scenario, _: Robot) -> Scenario:
    """Return the scenario with a height scan that shows nothing."""
    return _with_settings(scenario, scan_lost=True)


def _with_settings(scenario: Scenario, **settings: Any) -> Scenario:
    """Return the scenario with other settings and their suffixes; unchanged if it has them."""
    changed = replace(scenario, **settings)
    name = scenario.name.removesuffix(scenario.suffix) + changed.suffix
    return scenario if changed == scenario else replace(changed, name=name)


SUFFIXES: dict[str, Callable[[Scenario, Robot], Scenario]] = {
    HARDWARE: lambda scenario, _: with_hardware_profile(scenario),
    RANDOMISED: _with_randomisation,
    SCAN_LOST: _without_scan,
}
"""Suffix of a name -> function that applies it to a robot's scenario."""


def scaled(scenario: Scenario, robot: Robot) -> Scenario:
    """Scale a scenario of SimpleQuad to another robot by dynamic similarity.

    Commands scale by Froude number, pushes by the speed change that they cause, forces and loads by weight, ground by
    leg length, torques by weight times leg length. Times, noise, friction, angles and the severity do not change. No
    motor gets a larger torque limit than its own.

    Args:
        scenario: A scenario of SimpleQuad.
        robot: The other robot.

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
    """Return the motors with their torque limit scaled, at most the robot's rated torque."""
    if motors.torque_limit is None:
        return motors
    torque_limit = scale_factor(robot, "N·m") * motors.torque_limit
    return replace(motors, torque_limit=min(torque_limit, robot.rated_torque))


def _scaled_payload(payload: Payload | None, robot: Robot) -> Payload | None:
    """Return the payload with mass and lengths scaled."""
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
    """Return the randomisation with lengths scaled."""
    if randomisation is None:
        return None
    forward, left, up = randomisation.centre_of_mass
    return replace(randomisation, centre_of_mass=(factor * forward, factor * left, factor * up))


def _scaled_terrain(terrain: Terrain, factor: float) -> Terrain:
    """Return the terrain with lengths scaled; a user's height field keeps its size."""
    if isinstance(terrain, Stairs):
        landing = max(1.0, factor) * terrain.landing  # small robots need the same landing
        lengths = {name: factor * getattr(terrain, name) for name in ("rise", "run", "half_width")}
        return replace(terrain, landing=landing, **lengths)
    if isinstance(terrain, SmoothRandom):
        names = ("peak_to_valley", "correlation_length", "half_size", "spawn_radius", "cell")
        return replace(terrain, **{name: factor * getattr(terrain, name) for name in names})
    return terrain
