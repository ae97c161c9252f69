"""Painter: a thread that draws the shots it was handed, while the simulation goes on."""

import io
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from live.view.render_request import RenderRequest
from quad_env.physics.rendering import Camera

JPEG_QUALITY = 80
WIDTH, HEIGHT = 720, 360
"""Pixels that a processor draws fast enough."""
COLOURS = ((255, 200, 46), (88, 166, 255), (255, 140, 200), (160, 230, 120))
"""Of the robots' names, as of their curves in page/view.css."""
_EDGE = (30, 34, 38)


class RenderThread:
    """Draws in a thread of its own and hands on JPEG files.

    Args:
        show: given each file, in that thread.
    """

    def __init__(self, show: Callable[[bytes], None]) -> None:
        self._show = show
        self._cameras: list[Camera] = []
        self._models: list[Any] = []
        self.failure: str | None = None
        """Why nothing can be drawn, once that is known."""
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="painter")
        self._work: Future[None] | None = None

    @property
    def idle(self) -> bool:
        """Whether it can draw and has drawn what it was handed."""
        return self.failure is None and (self._work is None or self._work.done())

    def submit(self, shots: Sequence[RenderRequest]) -> None:
        """Have that drawn."""
        self._work = self._thread.submit(self._take, shots)

    def close(self) -> None:
        """End the thread and free what it draws with."""
        self._thread.submit(self._close_renderers)
        self._thread.shutdown()

    def _take(self, shots: Sequence[RenderRequest]) -> None:
        try:
            file = self._paint(shots)
        except Exception as error:  # whatever the graphics driver fails with
            self.failure = f"nothing can be drawn here ({type(error).__name__}: {error})"
            return
        self._show(file)

    def _paint(self, shots: Sequence[RenderRequest]) -> bytes:
        models = [shot.model for shot in shots]
        if models != self._models:
            self._close_renderers()
            self._cameras = [Camera(model, WIDTH // len(models), HEIGHT, None) for model in models]
            self._models = models
        frames = [
            camera.draw(shot.data, arrows=shot.arrows, viewpoint=shot.viewpoint)
            for camera, shot in zip(self._cameras, shots, strict=True)
        ]
        image, buffer = Image.fromarray(np.concatenate(frames, axis=1)), io.BytesIO()
        _label(image, shots)
        image.save(buffer, "jpeg", quality=JPEG_QUALITY)
        return buffer.getvalue()

    def _close_renderers(self) -> None:
        for camera in self._cameras:
            camera.close()
        self._cameras, self._models = [], []


def _label(image: Image.Image, shots: Sequence[RenderRequest]) -> None:
    """Name the robots where they are, in the colours of their curves."""
    draw, size = ImageDraw.Draw(image), image.height // 22
    for number, (shot, colour) in enumerate(zip(shots, COLOURS, strict=False)):
        place = number * image.width // len(shots) + size / 2, size / 2
        draw.text(place, shot.name, fill=colour, font_size=size, stroke_width=2, stroke_fill=_EDGE)
