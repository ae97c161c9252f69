"""Painter: a thread that draws the picture it was handed, while the simulation goes on."""

import io
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from live.view.camera import Picture
from quad_env.physics.rendering import Camera

JPEG_QUALITY = 80
_INK, _EDGE = (255, 255, 255), (30, 34, 38)


WIDTH, HEIGHT = 640, 400
"""Pixels that a processor draws fast enough."""


class Painter:
    """Draws in a thread of its own and hands on JPEG files.

    Args:
        show: given each file, in that thread.
    """

    def __init__(self, show: Callable[[bytes], None]) -> None:
        self._show = show
        self._cameras: dict[tuple[int, int], Camera] = {}
        self._model: Any = None
        self.failure: str | None = None
        """Why nothing can be drawn, once that is known."""
        self.drawn = 0
        """Frames so far."""
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="painter")
        self._work: Future[None] | None = None

    @property
    def idle(self) -> bool:
        """Whether it can draw and has drawn what it was handed."""
        return self.failure is None and (self._work is None or self._work.done())

    def hand(self, picture: Picture) -> None:
        """Have that drawn."""
        self._work = self._thread.submit(self._take, picture)

    def close(self) -> None:
        """End the thread and free what it draws with."""
        self._thread.submit(self._forget)
        self._thread.shutdown()

    def _take(self, picture: Picture) -> None:
        try:
            file = self._paint(picture)
        except Exception as error:  # whatever the graphics driver fails with
            self.failure = f"nothing can be drawn here ({type(error).__name__}: {error})"
            return
        self.drawn += 1
        self._show(file)

    def _paint(self, picture: Picture) -> bytes:
        if picture.model is not self._model:
            self._forget()
            self._model = picture.model
        count, orbit = len(picture.robots), picture.orbit
        frames = []
        for number, robot in enumerate(picture.robots):
            target = picture.places[number] if orbit.follow else orbit.target
            distance = orbit.distance * count**0.5  # narrower pictures show as much
            frame = self._camera(number, count).draw(
                robot,
                arrows=picture.arrows if number == 0 else (),
                viewpoint=replace(orbit, target=target, distance=distance),
            )
            frames.append(frame)
        image = Image.fromarray(np.concatenate(frames, axis=1))
        if count > 1:
            _label(image, picture.names)
        buffer = io.BytesIO()
        image.save(buffer, "jpeg", quality=JPEG_QUALITY)
        return buffer.getvalue()

    def _camera(self, number: int, count: int) -> Camera:
        """That of one of so many pictures side by side."""
        if (number, count) not in self._cameras:
            if any(known != count for _, known in self._cameras):
                self._forget()
            self._cameras[number, count] = Camera(self._model, WIDTH // count, HEIGHT, None)
        return self._cameras[number, count]

    def _forget(self) -> None:
        for camera in self._cameras.values():
            camera.close()
        self._cameras.clear()


def _label(image: Image.Image, names: Sequence[str]) -> None:
    """Name the robots where they are."""
    draw, size = ImageDraw.Draw(image), image.height // 25
    for number, name in enumerate(names):
        place = number * image.width // len(names) + size / 2, size / 2
        draw.text(place, name, fill=_INK, font_size=size, stroke_width=2, stroke_fill=_EDGE)
