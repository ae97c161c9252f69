"""The ghost is where a robot would be that did exactly as asked; arrows show command, velocity and push."""

import math

import numpy as np
import pytest

import policies
import quad_env
from evaluate.film.scene import AHEAD, COMMAND, GHOST, PUSH, PUSH_LINGERS, VELOCITY, CommandedPath, Scene, heading
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import watch
from quad_env import Pushes
from quad_env.physics.marks import Arrow, Colour
from quad_env.robots.kinematics import feet_in_world
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.terrain import Slope, SmoothRandom, Terrain

START = CommandedPath(1.0, -2.0, 0.3)


def walked(path: CommandedPath, command: tuple[float, float, float], steps: int, dt: float = 0.01) -> CommandedPath:
    for _ in range(steps):
        path = path.after(command, dt)
    return path


@pytest.mark.parametrize("yaw_rate", [0.6, -0.6])
def test_forward_and_turning_lead_along_an_arc_to_its_end(yaw_rate: float) -> None:
    """About a centre to the left for a positive yaw rate, at the radius v/w."""
    end = walked(START, (0.5, 0.0, yaw_rate), 250)
    angle, radius = yaw_rate * 2.5, 0.5 / yaw_rate
    centre = START.x - radius * math.sin(0.3), START.y + radius * math.cos(0.3)
    assert end.x == pytest.approx(centre[0] + radius * math.sin(0.3 + angle))
    assert end.y == pytest.approx(centre[1] - radius * math.cos(0.3 + angle))
    assert end.yaw == pytest.approx(0.3 + angle)


def test_left_is_to_the_left_of_the_heading_and_a_command_without_a_turn_leads_straight() -> None:
    end = walked(CommandedPath(0.0, 0.0, math.pi / 2), (0.2, 0.1, 0.0), 100)
    assert (end.x, end.y, end.yaw) == pytest.approx((-0.1, 0.2, math.pi / 2))


def test_the_ghost_of_an_episode_follows_its_command_from_where_the_robot_began() -> None:
    """Whatever the robot does, here nothing; it starts at a place and a heading that its seed draws."""
    command = (0.5, 0.1, 0.8)
    steps = watch(policies.make("stand"), quad_env.scenario("flat"), 3, steps=120, command=command)
    start = next(steps)
    scene, yaw = Scene(start), heading(start)
    assert abs(yaw) > 0.2
    for step in steps:
        scene.advance(step)
    expected = walked(CommandedPath(*start.infos["position"][0, :2], yaw), command, 120)
    assert (scene.path.x, scene.path.y, scene.path.yaw) == pytest.approx((expected.x, expected.y, expected.yaw))
    assert scene.way_to_ghost == pytest.approx(math.dist(step.infos["position"][0, :2], (expected.x, expected.y)))
    assert scene.way_to_ghost > 0.4


def test_where_a_robot_faces_does_not_depend_on_its_tilt() -> None:
    step = next(watch(policies.make("stand"), quad_env.scenario("flat"), 1, steps=1))
    yaw, pitch = 2.0, -0.4
    cos, sin = math.cos(pitch / 2), math.sin(pitch / 2)
    tilted = (math.cos(yaw / 2) * cos, -math.sin(yaw / 2) * sin, math.cos(yaw / 2) * sin, math.sin(yaw / 2) * cos)
    step.infos["quaternion"][0] = tilted
    assert heading(step) == pytest.approx(yaw)


@pytest.mark.parametrize("terrain", [Slope(), SmoothRandom(peak_to_valley=0.24)], ids=["slope", "rough"])
@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_the_ghost_stands_on_the_ground_above_its_place(terrain: Terrain, yaw: float) -> None:
    path = CommandedPath(1.2, 0.4, yaw)
    ghost = path.ghost(SIMPLE_QUAD, terrain, GHOST)
    assert ghost.position[:2] == (path.x, path.y)
    assert np.linalg.det(ghost.rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(ghost.rotation @ ghost.rotation.T, np.eye(3), atol=1e-12)
    assert math.atan2(ghost.rotation[1, 0], ghost.rotation[0, 0]) == pytest.approx(yaw)
    where = np.array([ghost.position]), ghost.rotation[None], SIMPLE_QUAD.home_pose[None]
    feet = feet_in_world(SIMPLE_QUAD, *where)[0]
    clear = feet[:, 2] - terrain.ball_height(feet[:, 0], feet[:, 1], SIMPLE_QUAD.foot_radius)
    assert clear.min() == pytest.approx(0.0, abs=1e-9)
    assert clear.max() < 0.15
    if isinstance(terrain, Slope):
        np.testing.assert_allclose(clear, 0.0, atol=1e-9)


PUSHED = quad_env.Scenario("pushed", pushes=Pushes(count=2, window=(1.0, 2.0), impulse=35.0))


@pytest.fixture(scope="module")
def shown() -> list[tuple[Step, dict[Colour, Arrow]]]:
    """Of each control step of a trot that turns and is pushed, by their colour."""
    steps = watch(policies.make("trot"), PUSHED, 4, steps=220, command=(0.5, 0.0, 0.5))
    start = next(steps)
    scene, told = Scene(start), []
    for step in steps:
        scene.advance(step)
        told.append((step, {mark.colour: mark for mark in scene.marks() if isinstance(mark, Arrow)}))
    return told


def direction(arrow: Arrow) -> float:
    """In the world, rad."""
    way = np.subtract(arrow.end, arrow.start)
    assert way[2] == 0.0
    return float(np.arctan2(way[1], way[0]))


def angle_between(first: float, second: float) -> float:
    return abs((first - second + np.pi) % (2 * np.pi) - np.pi)


def test_the_velocity_points_along_the_way_that_the_robot_goes(shown) -> None:
    for now in (60, 90, 110):
        way = shown[now][0].infos["position"][0] - shown[now - 50][0].infos["position"][0]
        halfway = 0.25 * 0.5  # turned since the middle of that half second, of which it is the mean, rad
        drawn = direction(shown[now][1][VELOCITY])
        assert angle_between(drawn, np.arctan2(way[1], way[0]) + halfway) < 0.12
        length = np.linalg.norm(np.subtract(shown[now][1][VELOCITY].end, shown[now][1][VELOCITY].start))
        assert length == pytest.approx(AHEAD * np.linalg.norm(way[:2]) / 0.5, rel=0.1)


def test_the_command_points_ahead_of_the_robot(shown) -> None:
    for step, drawn in shown[::40]:
        w, x, y, z = step.infos["quaternion"][0]
        assert angle_between(direction(drawn[COMMAND]), np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))) < 1e-6
        assert np.linalg.norm(np.subtract(drawn[COMMAND].end, drawn[COMMAND].start)) == pytest.approx(AHEAD * 0.5)
        assert drawn[COMMAND].start[2] > step.infos["position"][0, 2]


def test_a_push_points_along_its_force_while_it_is_on_and_a_moment_longer(shown) -> None:
    on = [number for number, (step, _) in enumerate(shown) if step.infos["push"].any()]
    lingering = round(PUSH_LINGERS / 0.01)
    assert len(on) == 20
    drawn = [number for number, (_, marks) in enumerate(shown) if PUSH in marks]
    assert drawn == sorted({number + more for number in on for more in range(lingering)})
    for number in on:
        force = shown[number][0].infos["push"][0]
        assert angle_between(direction(shown[number][1][PUSH]), np.arctan2(force[1], force[0])) < 1e-6
