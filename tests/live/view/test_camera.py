"""What the picture shows is where things are: footholds, the ghost, the camera's targets, the robots of now."""

import io
import queue
from collections.abc import Iterator
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

import policies
from live.pace import Pace
from live.session import Session
from live.view.camera import FOOTHOLDS, ViewCamera
from live.view.painter import Painter
from live.view.quality import LEVELS, Quality
from quad_env.physics.marks import Ball, Ghost


@pytest.fixture
def camera() -> ViewCamera:
    return ViewCamera()


def walking(camera: ViewCamera, *names: str, scenario: str = "flat") -> Session:
    return Session([policies.make(name) for name in names], scenario, observers=[camera], command=(0.5, 0.0, 0.0))


def balls(camera: ViewCamera, session: Session) -> list[Ball]:
    return [mark for mark in camera.picture(session).marks if isinstance(mark, Ball)]


def test_a_foothold_is_left_where_a_foot_of_the_first_robot_comes_down_and_nowhere_else(camera: ViewCamera) -> None:
    with closing(walking(camera, "trot", "stand")) as session:
        down: list[np.ndarray] = []
        touching = session.latest.infos["foot_contact"][0].copy()
        for _ in range(120):
            infos = session.step().infos
            now = infos["foot_contact"][0]
            down.extend(infos["foot_position"][0][now & ~touching])
            touching = now.copy()
        assert len(down) > 6
        np.testing.assert_allclose([ball.centre for ball in balls(camera, session)], down[-FOOTHOLDS:])
        session.reset()
        assert balls(camera, session) == []


def test_the_ghost_starts_where_the_robot_is_when_its_command_changes(camera: ViewCamera) -> None:
    with closing(walking(camera, "trot")) as session:
        for _ in range(150):
            session.step()
        (gone,) = (mark for mark in camera.picture(session).marks if isinstance(mark, Ghost))
        assert np.hypot(*(np.array(gone.position) - session.latest.infos["position"][0])[:2]) > 0.05
        session.steer((0.0, 0.3, 0.0))
        session.step()
        (begun,) = (mark for mark in camera.picture(session).marks if isinstance(mark, Ghost))
        np.testing.assert_allclose(begun.position[:2], session.latest.infos["position"][0][:2], atol=1e-9)
        camera.ghost = False
        assert not any(isinstance(mark, Ghost) for mark in camera.picture(session).marks)


def test_each_picture_looks_at_its_own_robot_while_it_follows(camera: ViewCamera) -> None:
    with closing(walking(camera, "trot", "stand")) as session:
        for _ in range(100):
            session.step()
        places = np.array(camera.picture(session).places)
        np.testing.assert_allclose(places[:, :2], session.latest.infos["position"][:, :2])
        assert places[0, 0] > places[1, 0] + 0.2
        camera.follow(False)
        stays = camera.picture(session).orbit.target
        session.step()
        assert camera.picture(session).orbit.target == stays


@pytest.fixture
def drawn() -> Iterator[tuple[Painter, "queue.Queue[bytes]"]]:
    files: queue.Queue[bytes] = queue.Queue()
    with closing(Painter(files.put, Quality("low"))) as painter:
        yield painter, files


def picture_of(painter: Painter, files: "queue.Queue[bytes]", camera: ViewCamera, session: Session) -> np.ndarray:
    painter.hand(camera.picture(session))
    return np.asarray(Image.open(io.BytesIO(files.get(timeout=30))), float)


@pytest.mark.rendering
def test_pictures_are_of_the_robots_and_the_ground_of_now(
    camera: ViewCamera, drawn: "tuple[Painter, queue.Queue[bytes]]"
) -> None:
    with closing(walking(camera, "trot")) as flat, closing(walking(ViewCamera(), "trot", "stand")) as two:
        alone = picture_of(*drawn, camera, flat)
        assert alone.shape == (LEVELS[0].height, LEVELS[0].width, 3)
        assert np.abs(picture_of(*drawn, camera, flat) - alone).mean() < 1.0
        for _ in range(60):
            flat.step()
        assert np.abs(picture_of(*drawn, camera, flat) - alone).mean() > 1.0
        left, right = np.split(picture_of(*drawn, camera, two), 2, axis=1)  # a picture each
        camera.together = True
        both = picture_of(*drawn, camera, two)
        assert left.shape == right.shape
        assert np.abs(both[:, : left.shape[1]] - left).mean() > 1.0
        camera.together = False
    with closing(walking(camera, "trot", scenario="stairs=0.3")) as stairs:
        before = picture_of(*drawn, camera, stairs)  # of another model: nothing of the last one is drawn
        assert np.abs(before - alone).mean() > 5.0
    assert drawn[0].failure is None


def test_half_the_speed_takes_twice_the_time_and_a_pause_is_not_caught_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock on which nothing but sleep takes time, whatever else the machine does."""
    now = 100.0

    def sleep(duration: float) -> None:
        nonlocal now
        now += duration

    monkeypatch.setattr("live.pace.time", SimpleNamespace(perf_counter=lambda: now, sleep=sleep))

    def seconds(pace: Pace, steps: int) -> float:
        begin = now
        for _ in range(steps):
            pace.wait()
        return now - begin

    assert seconds(Pace(0.01, speed=0.5), 21) == pytest.approx(0.4)
    quick = Pace(0.01, speed=4.0)
    assert seconds(quick, 21) == pytest.approx(0.05)
    sleep(0.2)
    quick.resume()
    assert seconds(quick, 21) == pytest.approx(0.05)
