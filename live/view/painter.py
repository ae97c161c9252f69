"""Painter: a thread that draws the newest picture it was handed, while the simulation goes on."""

import io
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from live.view.camera import Picture
from live.view.last_value import LastValue
from live.view.quality import Level, Quality
from quad_env.physics.marks import COMPANIONS, Colour
from quad_env.physics.rendering import Camera

JPEG_QUALITY = 80
_INK, _EDGE = (255, 255, 255), (30, 34, 38)


class Painter:
    """Draws in a thread of its own and hands on JPEG files.

    Args:
        show: given each file, in that thread.
        quality: how finely it draws.
    """

    def __init__(self, show: Callable[[bytes], None], quality: Quality) -> None:
        self._show, self._quality = show, quality
        self._cameras: dict[tuple[int, Level], Camera] = {}
        self._model: Any = None
        self.failure: str | None = None
        """Why nothing can be drawn, once that is known."""
        self.drawn = 0
        """Frames so far."""
        self._thread: LastValue[Picture] = LastValue("painter", self._take, self._forget)

    @property
    def idle(self) -> bool:
        """Whether it has drawn all that it was handed."""
        return self._thread.idle

    def hand(self, picture: Picture) -> None:
        """Have that drawn next, instead of what was not begun yet."""
        self._thread.hand(picture)

    def close(self) -> None:
        """End the thread and free what it draws with."""
        self._thread.close()

    def _take(self, picture: Picture) -> bool:
        try:
            start = time.perf_counter()
            file = self._paint(picture)
            self._quality.took(time.perf_counter() - start)
        except Exception as error:  # whatever the graphics driver fails with
            self.failure = f"nothing can be drawn here ({type(error).__name__}: {error})"
            return False
        self.drawn += 1
        self._show(file)
        return True

    def _paint(self, picture: Picture) -> bytes:
        if picture.model is not self._model:
            self._forget()
            self._model = picture.model
        shown = [picture.robots] if picture.together else [[robot] for robot in picture.robots]
        level = self._quality.level
        part = Level(level.width // len(shown), level.height, level.fine)
        frames = []
        for number, robots in enumerate(shown):
            marks = picture.marks if number == 0 else ()
            orbit = picture.orbit
            target = picture.places[number] if orbit.follow else orbit.target
            distance = orbit.distance * len(shown) ** 0.5  # narrower pictures show as much
            frame = self._camera(number, part).draw(
                robots[0],
                marks=marks,
                others=robots[1:],
                viewpoint=replace(orbit, target=target, distance=distance),
                forces=picture.forces,
            )
            frames.append(frame)
        image = Image.fromarray(np.concatenate(frames, axis=1))
        if len(picture.robots) > 1:
            _label(image, picture)
        buffer = io.BytesIO()
        image.save(buffer, "jpeg", quality=JPEG_QUALITY)
        return buffer.getvalue()

    def _camera(self, number: int, level: Level) -> Camera:
        if (number, level) not in self._cameras:
            if any(known != level for _, known in self._cameras):
                self._forget()
            self._cameras[number, level] = Camera(self._model, level.width, level.height, None, fine=level.fine)
        return self._cameras[number, level]

    def _forget(self) -> None:
        for camera in self._cameras.values():
            camera.close()
        self._cameras.clear()


def _label(image: Image.Image, picture: Picture) -> None:
    """Name the robots where they are."""
    draw, size = ImageDraw.Draw(image), image.height // 25
    width = 0 if picture.together else image.width // len(picture.names)
    for number, name in enumerate(picture.names):
        place = (size / 2, size * (0.5 + 1.3 * number)) if picture.together else (number * width + size / 2, size / 2)
        fill = _rgb(COMPANIONS[number - 1]) if picture.together and number else _INK
        draw.text(place, name, fill=fill, font_size=size, stroke_width=2, stroke_fill=_EDGE)


def _rgb(colour: Colour) -> tuple[int, int, int]:
    red, green, blue, _ = (round(255 * part) for part in colour)
    return red, green, blue
