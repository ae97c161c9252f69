"""The picture shows the camera's targets and the present robots, at the selected speed."""

import io
import queue
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from PIL import Image

from live.view.controller import ViewController
from live.view.render_request import DISTANCE_RANGE, MAX_ELEVATION, Orbit
from live.view.render_thread import HEIGHT, WIDTH, RenderThread
from quad_env.cli.real_time_rate import RealTimeRate


def walking(*names: str, scenario: str = "flat") -> ViewController:
    return ViewController(names, scenario, command=(0.5, 0.0, 0.0))


def walk(driver: ViewController, steps: int) -> None:
    for session in driver.sessions:
        for _ in range(steps):
            session.step()


def test_dragging_right_turns_the_scene_right_and_dragging_down_lifts_the_camera() -> None:
    orbit = Orbit(azimuth=90.0, elevation=-20.0)
    assert orbit.dragged(10.0, 0.0).azimuth == pytest.approx(86.0)
    assert orbit.dragged(0.0, 10.0).elevation == pytest.approx(-24.0)
    assert orbit.dragged(0.0, 1e6).elevation == -MAX_ELEVATION
    assert orbit.zoomed(5000.0).distance == DISTANCE_RANGE[1]
    assert orbit.zoomed(-100.0).distance < orbit.distance
    robot, shaken = np.array([3.0, -2.0, 0.5]), np.array([3.0, -2.0, 0.6])
    assert Orbit(target=(0.0, 0.0, 0.5)).at(robot).target == (3.0, -2.0, 0.5)
    assert 0.5 < Orbit(target=(3.0, -2.0, 0.5)).at(shaken).target[2] < 0.52


def test_each_picture_looks_at_its_own_robot_while_it_follows() -> None:
    with closing(walking("trot", "stand")) as driver:
        walk(driver, 70)
        places = np.array([shot.viewpoint.target for shot in driver.render_requests()])
        there = [session.latest.infos["position"][0, :2] for session in driver.sessions]
        np.testing.assert_allclose(places[:, :2], there)
        assert places[0, 0] > places[1, 0] + 0.1
        driver.orbit = replace(driver.orbit, follow=False)
        stays = driver.render_requests()[1].viewpoint.target
        walk(driver, 1)
        assert driver.render_requests()[1].viewpoint.target == stays


@pytest.fixture
def drawn() -> Iterator[tuple[RenderThread, "queue.Queue[bytes]"]]:
    files: queue.Queue[bytes] = queue.Queue()
    with closing(RenderThread(files.put)) as painter:
        yield painter, files


@pytest.mark.rendering
def test_pictures_are_of_the_robots_and_the_ground_of_now(drawn: "tuple[RenderThread, queue.Queue[bytes]]") -> None:
    painter, files = drawn

    def picture_of(driver: ViewController, by: RenderThread = painter) -> np.ndarray:
        by.submit(driver.render_requests())
        return np.asarray(Image.open(io.BytesIO(files.get(timeout=60))), float)

    with closing(walking("trot")) as flat, closing(walking("trot", "stand")) as two:
        alone = picture_of(flat)
        assert alone.shape == (HEIGHT, WIDTH, 3)
        assert np.abs(picture_of(flat) - alone).mean() < 1.0
        walk(flat, 60)
        assert np.abs(picture_of(flat) - alone).mean() > 1.0
        assert np.abs(picture_of(two) - alone).mean() > 1.0  # one picture per robot, next to each other
    with closing(walking("trot", scenario="stairs=0.3")) as stairs:
        climbed = picture_of(stairs)  # another model: nothing of the previous one is drawn
        with closing(RenderThread(files.put)) as fresh:
            assert np.abs(picture_of(stairs, fresh) - climbed).mean() < 1.0
        assert np.abs(climbed - alone).mean() > 5.0
    assert painter.failure is None


def test_half_the_speed_takes_twice_the_time_and_a_pause_is_not_caught_up() -> None:
    """Only sleep takes time on the simulated clock, independent of the load of the machine."""
    now = 100.0

    def sleep(duration: float) -> None:
        nonlocal now
        now += duration

    make_rate = partial(RealTimeRate, 0.01, clock=lambda: now, sleep=sleep)

    def seconds(pace: RealTimeRate, steps: int) -> float:
        begin = now
        for _ in range(steps):
            pace.wait()
        return now - begin

    assert seconds(make_rate(speed=0.5), 21) == pytest.approx(0.4)
    quick = make_rate(speed=4.0)
    assert seconds(quick, 21) == pytest.approx(0.05)
    assert quick.lag == pytest.approx(0.0, abs=1e-9)
    sleep(0.2)
    quick.resume()
    assert seconds(quick, 21) == pytest.approx(0.05)
    sleep(0.02)
    quick.wait()
    assert quick.lag == pytest.approx(0.02 - 0.01 / 4.0)
