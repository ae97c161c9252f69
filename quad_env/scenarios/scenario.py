"""A scenario, everything that an episode of a robot is made of apart from its seed; and the same for another robot."""

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

HARDWARE, RANDOMISED, SCAN_LOST = "+hardware", "+randomised", "+scan_lost"
"""Ends of the names of scenarios on the hardware profile, with domain randomisation and with a height scan that shows
nothing."""
SUFFIX_FIELDS = {SCAN_LOST: "scan_lost", RANDOMISED: "randomisation", HARDWARE: "hardware"}
"""End of a name -> the field that it is about, in the order in which they stand."""


@dataclass(frozen=True)
class Scenario(Settings):
    """Terrain, disturbances, commands and start of an episode; None is a disturbance that does not happen."""

    name: str
    terrain: Terrain = field(default_factory=Flat)
    pushes: Pushes | None = None
    commands: CommandRanges = field(default_factory=CommandRanges)
    start: StartNoise | AnyPose = field(default_factory=StartNoise)
    severity: float = 0.0
    """Severity on the scenario's own axis, in the unit of `severity_unit`; 0 where it is of none."""
    severity_unit: str = ""
    axis: str = ""
    """Name of an axis of `quad_env.scenarios.axes`, where the scenario is a severity of one."""
    force: SteadyForce | None = None
    ground: Ground = field(default_factory=Ground)
    motors: Motors = field(default_factory=Motors)
    payload: Payload | None = None
    latency: Latency | None = None
    noise: SensorNoise | None = None
    dropouts: Dropouts | None = None
    hardware: bool = False
    """Whether the robot has its hardware profile, see `quad_env.actuation.hardware`, instead of ideal motors, no delay
    and observations of its true state."""
    randomisation: DomainRandomisation | None = None
    """What of robot and ground differs from episode to episode; None: nothing."""
    scan_lost: bool = False
    """Whether a height scan shows nothing: each of its points reads that of unseen ground, -2 m."""

    @property
    def suffix(self) -> str:
        """End of the name of an axis's scenarios like this."""
        return "".join(end for end, field in SUFFIX_FIELDS.items() if getattr(self, field))


def with_hardware_profile(scenario: Scenario, _: Robot = SIMPLE_QUAD) -> Scenario:
    """The same with the robot's hardware profile, under the name with HARDWARE; itself where it has that already."""
    return _with_settings(scenario, hardware=True)


def _randomised(scenario: Scenario, robot: Robot) -> Scenario:
    usual = scaled(Scenario("usual", randomisation=DomainRandomisation()), robot).randomisation
    return _with_settings(scenario, randomisation=scenario.randomisation or usual)


def _without_scan(scenario: Scenario, _: Robot) -> Scenario:
    return _with_settings(scenario, scan_lost=True)


def _with_settings(scenario: Scenario, **settings: Any) -> Scenario:
    found = replace(scenario, **settings)
    renamed = scenario.name.removesuffix(scenario.suffix) + found.suffix
    return scenario if found == scenario else replace(found, name=renamed)


SUFFIXES: dict[str, Callable[[Scenario, Robot], Scenario]] = {
    HARDWARE: with_hardware_profile,
    RANDOMISED: _randomised,
    SCAN_LOST: _without_scan,
}
"""End of a name -> what it makes of a scenario of a robot."""


def scaled(scenario: Scenario, robot: Robot) -> Scenario:
    """A scenario of SimpleQuad's for another robot, by dynamic similarity: commands by Froude number, pushes by the
    speed that they give, forces and loads by weight, ground by leg length, torques by weight times leg length.

    Times, noise, friction and angles stay as they are, as does the severity. No motor gets more torque than it has.
    """
    if robot == SIMPLE_QUAD:
        return scenario
    by = partial(scale_factor, robot)
    pushes, force, load, motors = scenario.pushes, scenario.force, scenario.payload, scenario.motors
    randomisation = scenario.randomisation
    if motors.torque_limit is not None:
        motors = replace(motors, torque_limit=min(by("N·m") * motors.torque_limit, robot.rated_torque))
    if load is not None:
        ahead, beside = load.reach
        reach = (by("m") * ahead, by("m") * beside)
        load = replace(load, mass=by("kg") * load.mass, reach=reach, edge=by("m") * load.edge)
    if randomisation is not None:
        ahead, beside, above = randomisation.centre_of_mass
        randomisation = replace(randomisation, centre_of_mass=(by("m") * ahead, by("m") * beside, by("m") * above))
    return replace(
        scenario,
        terrain=_scaled_terrain(scenario.terrain, by("m")),
        commands=scenario.commands.scaled(by("m/s"), by("rad/s")),
        pushes=pushes and replace(pushes, impulse=by("N·s") * pushes.impulse),
        force=force and replace(force, force=by("N") * force.force),
        ground=replace(scenario.ground, sink_depth=by("m") * scenario.ground.sink_depth),
        motors=motors,
        payload=load,
        randomisation=randomisation,
    )


def _scaled_terrain(terrain: Terrain, larger: float) -> Terrain:
    if isinstance(terrain, Stairs):
        landing = max(1.0, larger) * terrain.landing  # which small robots need no less
        lengths = {name: larger * getattr(terrain, name) for name in ("rise", "run", "half_width")}
        return replace(terrain, landing=landing, **lengths)
    if isinstance(terrain, SmoothRandom):
        names = "peak_to_valley", "correlation_length", "half_size", "spawn_radius", "cell"
        return replace(terrain, **{name: larger * getattr(terrain, name) for name in names})
    return terrain
