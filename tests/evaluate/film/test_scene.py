"""Arrows of the command, the velocity and the push."""

import math

import numpy as np
import pytest

import policies
import quad_env
from evaluate.film.scene import AHEAD, COMMAND, CONTACT, PUSH, PUSH_DISPLAY_TIME, SWING, VELOCITY, Scene, heading_angle
from evaluate.rollouts.observers import Step
from evaluate.rollouts.rollout import iterate_episode
from quad_env import Pushes
from quad_env.physics.arrows import Arrow, Ball, Colour


def test_where_a_robot_faces_does_not_depend_on_its_tilt() -> None:
    step = next(iterate_episode(policies.make("stand"), quad_env.scenario("flat"), 1, steps=1))
    yaw, pitch = 2.0, -0.4
    cos, sin = math.cos(pitch / 2), math.sin(pitch / 2)
    tilted = (math.cos(yaw / 2) * cos, -math.sin(yaw / 2) * sin, math.cos(yaw / 2) * sin, math.sin(yaw / 2) * cos)
    step.infos["quaternion"][0] = tilted
    assert heading_angle(step) == pytest.approx(yaw)


PUSHED = quad_env.Scenario("pushed", pushes=Pushes(count=2, window=(1.0, 2.0), impulse=35.0))


@pytest.fixture(scope="module")
def shown() -> list[tuple[Step, dict[Colour, Arrow]]]:
    """Return the arrows of each control step by colour, for a trot that turns and is pushed."""
    steps = iterate_episode(policies.make("trot"), PUSHED, 4, steps=220, command=(0.5, 0.0, 0.5))
    start = next(steps)
    scene, told = Scene(start), []
    for step in steps:
        scene.advance(step)
        told.append((step, {arrow.colour: arrow for arrow in scene.arrows()}))
    return told


def direction(arrow: Arrow) -> float:
    """Return the direction of an arrow in the world frame, rad."""
    way = np.subtract(arrow.end, arrow.start)
    assert way[2] == 0.0
    return float(np.arctan2(way[1], way[0]))


def angle_between(first: float, second: float) -> float:
    return abs((first - second + np.pi) % (2 * np.pi) - np.pi)


def test_the_velocity_points_along_the_way_that_the_robot_goes(shown) -> None:
    for now in (60, 90, 110):
        way = shown[now][0].infos["position"][0] - shown[now - 50][0].infos["position"][0]
        halfway = 0.25 * 0.5  # rad; yaw since the middle of the half second of the mean
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
    lingering = round(PUSH_DISPLAY_TIME / 0.01)
    assert len(on) == 20
    drawn = [number for number, (_, marks) in enumerate(shown) if PUSH in marks]
    assert drawn == sorted({number + more for number in on for more in range(lingering)})
    for number in on:
        force = shown[number][0].infos["push"][0]
        assert angle_between(direction(shown[number][1][PUSH]), np.arctan2(force[1], force[0])) < 1e-6


def test_each_foot_has_its_legs_name_and_is_blue_on_the_ground_alone() -> None:
    seen = set()
    for step in iterate_episode(policies.make("trot"), quad_env.scenario("flat"), 1, steps=40, command=(0.5, 0.0, 0.0)):
        balls = [mark for mark in Scene(step).marks() if isinstance(mark, Ball)]
        assert [ball.name for ball in balls] == ["FL", "FR", "HL", "HR"]
        for ball, place, on in zip(
            balls, step.infos["foot_position"][0], step.infos["foot_contact"][0].tolist(), strict=True
        ):
            assert ball.centre == pytest.approx(place.tolist())
            assert ball.colour == (CONTACT if on else SWING)
            seen.add(on)
    assert seen == {True, False}
