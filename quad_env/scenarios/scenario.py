"""Scenario: terrain, disturbances, commands and start of an episode, with scaling to another robot."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from quad_env.config import AnyPose, CommandRanges, Settings, StartNoise
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import scale_factor
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import (
    Dropouts,
    Ground,
    Kicks,
    Latency,
    Motors,
    Payload,
    Pushes,
    ScanDropouts,
    SensorNoise,
    SteadyForce,
)
from quad_env.scenarios.randomisation import DomainRandomisation
from quad_env.scenarios.terrain import Flat, GradedRandom, SmoothRandom, Stairs, Terrain

HARDWARE = "+hardware"
"""Suffix of scenario names: the robot has realistic motors, delays, sensors and estimator (hardware profile)."""
RANDOMISED = "+randomised"
"""Suffix of scenario names: properties of robot and ground differ in every episode (domain randomisation)."""
SCAN_LOST = "+scan_lost"
"""Suffix of scenario names: the height scan fails, so that every point reads -2 m, as for unseen ground."""
SCAN_DROPOUTS = "+scan_dropouts"
"""Suffix of scenario names: the height scan fails at times, in all points or in a half of them."""
SUFFIX_FIELDS = {
    SCAN_DROPOUTS: "scan_dropouts", SCAN_LOST: "scan_lost", RANDOMISED: "randomisation", HARDWARE: "hardware",
}  # fmt: skip
"""Suffix of a scenario name -> name of the field of `Scenario` that the suffix sets.

A name with several suffixes has them in the order of this dictionary.
"""


@dataclass(frozen=True)
class Scenario(Settings):
    """Definition of an episode, except its seed: terrain, disturbances, commands and initial state.

    Each of the fields `pushes`, `force`, `payload`, `latency`, `noise` and `dropouts` is None if the scenario does not
    have the disturbance that the field describes.
    """

    name: str
    terrain: Terrain = field(default_factory=Flat)
    pushes: Pushes | None = None
    commands: CommandRanges = field(default_factory=CommandRanges)
    start: StartNoise | AnyPose = field(default_factory=StartNoise)
    severity: float = 0.0
    """Strength of the disturbance of the axis `axis`, in the unit `severity_unit`; 0 if `axis` is empty."""
    severity_unit: str = ""
    axis: str = ""
    """Name of the disturbance axis that the scenario belongs to; empty if the scenario belongs to none.

    `quad_env.scenarios.axes` defines the axes.
    """
    force: SteadyForce | None = None
    ground: Ground = field(default_factory=Ground)
    motors: Motors = field(default_factory=Motors)
    payload: Payload | None = None
    latency: Latency | None = None
    noise: SensorNoise | None = None
    dropouts: Dropouts | None = None
    hardware: bool = False
    """True if motors, delays, sensors and estimator are realistic, as the robot's hardware profile defines them.

    If `hardware` is False, motors are ideal, and the observation shows the true state without delay.
    `quad_env.actuation.hardware` defines the profiles.
    """
    randomisation: DomainRandomisation | None = None
    """Ranges of the random properties of robot and ground in each episode; None for fixed properties."""
    scan_lost: bool = False
    """True if the height scan fails: every point of the scan reads -2 m, the value of unseen ground."""
    scan_dropouts: ScanDropouts | None = None
    """Periods in which the height scan, or a half of it, shows no ground; None for no periods."""
    kicks: Kicks | None = None
    """Kicks, which are short forces of random strength on the trunk, for training; None for no kicks."""

    @property
    def suffix(self) -> str:
        """Concatenated name suffixes of the scenario, such as `+randomised+hardware`; empty without suffixes."""
        return "".join(end for end, field in SUFFIX_FIELDS.items() if getattr(self, field))


def with_hardware_profile(scenario: Scenario) -> Scenario:
    """Return `scenario` with the robot's hardware profile and the name suffix `+hardware`.

    The hardware profile has realistic motors, delays, sensors and estimator. If the scenario has the profile already,
    the scenario is returned unchanged.
    """
    return _with_settings(scenario, hardware=True)


def _with_randomisation(scenario: Scenario, robot: Robot) -> Scenario:
    """Return `scenario` with domain randomisation and the name suffix `+randomised`.

    If the scenario has randomisation ranges already, the scenario keeps these ranges. Otherwise it gets the default
    ranges, scaled to `robot`.
    """
    default = scaled(Scenario("default", randomisation=DomainRandomisation()), robot).randomisation
    return _with_settings(scenario, randomisation=scenario.randomisation or default)


def _without_scan(scenario: Scenario, _: Robot) -> Scenario:
    """Return `scenario` with a failed height scan (all points read -2 m) and the suffix `+scan_lost`."""
    return _with_settings(scenario, scan_lost=True)


def _with_scan_dropouts(scenario: Scenario, _: Robot) -> Scenario:
    """Return `scenario` with dropouts of the height scan and the suffix `+scan_dropouts`; own dropouts are kept."""
    return _with_settings(scenario, scan_dropouts=scenario.scan_dropouts or ScanDropouts())


def _with_settings(scenario: Scenario, **settings: Any) -> Scenario:
    """Return `scenario` with new `settings`, field name -> value, and with the matching name suffixes.

    If no field changes, the scenario is returned unchanged.
    """
    changed = replace(scenario, **settings)
    name = scenario.name.removesuffix(scenario.suffix) + changed.suffix
    return scenario if changed == scenario else replace(changed, name=name)


SUFFIXES: dict[str, Callable[[Scenario, Robot], Scenario]] = {
    HARDWARE: lambda scenario, _: with_hardware_profile(scenario),
    RANDOMISED: _with_randomisation,
    SCAN_LOST: _without_scan,
    SCAN_DROPOUTS: _with_scan_dropouts,
}
"""Suffix of a scenario name -> function of scenario and robot that returns the changed scenario."""


def scaled(scenario: Scenario, robot: Robot) -> Scenario:
    """Scale a scenario of SimpleQuad to another robot by dynamic similarity.

    Commanded velocities are scaled so that the Froude number stays the same. Impulses of pushes are scaled so that a
    push changes the robot's speed by the same fraction of the commanded velocity. Forces and loads are scaled in
    proportion to the robot's weight, and lengths in proportion to the leg length. Torques are scaled in proportion to
    weight times leg length. Times, noise, friction, angles and the field `severity` do not change. The torque limit is
    at most the robot's rated torque.

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
    kicks = scenario.kicks
    force = scenario.force
    return replace(
        scenario,
        terrain=_scaled_terrain(scenario.terrain, factor("m")),
        commands=scenario.commands.scaled(factor("m/s"), factor("rad/s")),
        pushes=pushes and replace(pushes, impulse=factor("N·s") * pushes.impulse),
        kicks=kicks and replace(kicks, speed=factor("m/s") * kicks.speed),
        force=force and replace(force, force=factor("N") * force.force),
        ground=replace(scenario.ground, sink_depth=factor("m") * scenario.ground.sink_depth),
        motors=_scaled_motors(scenario.motors, robot),
        payload=_scaled_payload(scenario.payload, robot),
        randomisation=_scaled_randomisation(scenario.randomisation, factor("m")),
    )


def _scaled_motors(motors: Motors, robot: Robot) -> Motors:
    """Scale the torque limit of SimpleQuad's motors to `robot`, to at most the robot's rated torque."""
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
    """Multiply the largest displacements of the centre of mass, m, by `factor`; None stays None."""
    if randomisation is None:
        return None
    forward, left, up = randomisation.centre_of_mass
    return replace(randomisation, centre_of_mass=(factor * forward, factor * left, factor * up))


def _scaled_terrain(terrain: Terrain, factor: float) -> Terrain:
    """Multiply the lengths of stairs or random ground, `terrain`, by `factor`; return other terrains unchanged."""
    if isinstance(terrain, Stairs):
        # The landing is not made shorter, because a smaller robot needs the same room at the start.
        landing = max(1.0, factor) * terrain.landing
        lengths = {name: factor * getattr(terrain, name) for name in ("rise", "run", "half_width")}
        return replace(terrain, landing=landing, **lengths)
    if isinstance(terrain, SmoothRandom):
        names = ["peak_to_valley", "correlation_length", "half_size", "spawn_radius", "cell"]
        if isinstance(terrain, GradedRandom):
            names += ["max_peak_to_valley", "ramp"]
        return replace(terrain, **{name: factor * getattr(terrain, name) for name in names})
    return terrain
