"""Scenarios for robots of other sizes: what is hard for SimpleQuad, as hard for another robot."""

from dataclasses import replace
from functools import partial

from quad_env.config import CommandRanges
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import ratio
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.disturbances import Ground, Motors, Payload
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import SmoothRandom, Stairs, Terrain


def scaled(scenario: Scenario, robot: Robot) -> Scenario:
    """A scenario of SimpleQuad's for another robot, by dynamic similarity: commands by Froude number, pushes by the
    speed that they give, forces and loads by weight, ground by leg length, torques by weight times leg length.

    Times, noise, friction and angles stay as they are, as does the severity. No motor gets more torque than it has.
    """
    if robot == SIMPLE_QUAD:
        return scenario
    by = partial(ratio, robot)
    pushes, force = scenario.pushes, scenario.force
    return replace(
        scenario,
        terrain=_terrain(scenario.terrain, by("m")),
        commands=_commands(scenario.commands, by("m/s"), by("rad/s")),
        pushes=pushes and replace(pushes, impulse=by("N·s") * pushes.impulse),
        force=force and replace(force, force=by("N") * force.force),
        ground=_ground(scenario.ground, by("m")),
        motors=_motors(scenario.motors, by("N·m"), robot.rated_torque),
        payload=scenario.payload and _payload(scenario.payload, by("m"), by("kg")),
    )


def _commands(ranges: CommandRanges, faster: float, turning: float) -> CommandRanges:
    (back, ahead), (right, left), (clockwise, round_) = ranges.forward, ranges.lateral, ranges.yaw_rate
    return replace(
        ranges,
        forward=(faster * back, faster * ahead),
        lateral=(faster * right, faster * left),
        yaw_rate=(turning * clockwise, turning * round_),
    )


def _terrain(terrain: Terrain, larger: float) -> Terrain:
    if isinstance(terrain, Stairs):
        landing = max(1.0, larger) * terrain.landing  # which small robots need no less
        width = larger * terrain.half_width
        return replace(terrain, rise=larger * terrain.rise, run=larger * terrain.run, landing=landing, half_width=width)
    if isinstance(terrain, SmoothRandom):
        lengths = "peak_to_valley", "correlation_length", "half_size", "spawn_radius", "cell"
        return replace(terrain, **{name: larger * getattr(terrain, name) for name in lengths})
    return terrain


def _ground(ground: Ground, larger: float) -> Ground:
    return replace(ground, sink_depth=larger * ground.sink_depth)


def _motors(motors: Motors, stronger: float, rated: float) -> Motors:
    limit = motors.torque_limit
    return replace(motors, torque_limit=None if limit is None else min(stronger * limit, rated))


def _payload(payload: Payload, larger: float, heavier: float) -> Payload:
    ahead, beside = payload.reach
    reach = (larger * ahead, larger * beside)
    return replace(payload, mass=heavier * payload.mass, reach=reach, edge=larger * payload.edge)
