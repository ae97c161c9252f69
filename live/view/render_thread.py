"""Render thread: draws frames of the robots while the main thread continues the simulation."""

import io
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from live.view.render_request import RenderRequest
from quad_env.physics.rendering import Camera

JPEG_QUALITY = 80
"""Quality of the JPEG frames, 0 to 100; a larger value gives larger files."""
WIDTH = 720
"""Width of a frame, pixels; small enough that a processor without a GPU draws frames in time."""
HEIGHT = 360
"""Height of a frame, pixels."""
COLOURS = ((255, 200, 46), (88, 166, 255), (255, 140, 200), (160, 230, 120))
"""Colour of the policy name of each robot, RGB; page/view.css has the same colours for the curves."""
_OUTLINE = (30, 34, 38)
"""Colour of the outline of the policy names, RGB."""


class RenderThread:
    """Draws JPEG frames in a separate thread.

    Args:
        show: Function that is called with each JPEG frame, in the render thread.

    Attributes:
        failure: Reason why nothing can be drawn; None while drawing works.
    """

    def __init__(self, show: Callable[[bytes], None]) -> None:
        self._show = show
        self._cameras: list[Camera] = []
        self._models: list[Any] = []
        self.failure: str | None = None
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="render")
        self._work: Future[None] | None = None

    @property
    def idle(self) -> bool:
        """True if the thread can draw and has finished the last frame."""
        return self.failure is None and (self._work is None or self._work.done())

    def submit(self, requests: Sequence[RenderRequest]) -> None:
        """Start drawing a frame of the `requests`, one per robot, in the render thread."""
        self._work = self._thread.submit(self._draw_and_show, requests)

    def close(self) -> None:
        """End the render thread and free the renderers."""
        self._thread.submit(self._close_renderers)
        self._thread.shutdown()

    def _draw_and_show(self, requests: Sequence[RenderRequest]) -> None:
        """Draw a frame and call `show` with the frame; store the failure if the frame cannot be drawn."""
        try:
            frame = self._draw(requests)
        except Exception as error:  # because graphics drivers raise many kinds of errors
            self.failure = f"nothing can be drawn here ({type(error).__name__}: {error})"
            return
        self._show(frame)

    def _draw(self, requests: Sequence[RenderRequest]) -> bytes:
        """Return a JPEG frame with the robots side by side."""
        models = [request.model for request in requests]
        if models != self._models:
            self._close_renderers()
            self._cameras = [Camera(model, WIDTH // len(models), HEIGHT, None) for model in models]
            self._models = models
        frames = [
            camera.draw(request.data, arrows=request.arrows, viewpoint=request.viewpoint)
            for camera, request in zip(self._cameras, requests, strict=True)
        ]
        image = Image.fromarray(np.concatenate(frames, axis=1))
        _draw_names(image, requests)
        buffer = io.BytesIO()
        image.save(buffer, "jpeg", quality=JPEG_QUALITY)
        return buffer.getvalue()

    def _close_renderers(self) -> None:
        """Free the renderers."""
        for camera in self._cameras:
            camera.close()
        self._cameras = []
        self._models = []


def _draw_names(image: Image.Image, requests: Sequence[RenderRequest]) -> None:
    """Write the name of each robot's policy into the robot's tile, in the colour of the robot's curves."""
    draw = ImageDraw.Draw(image)
    size = image.height // 22
    for index, (request, colour) in enumerate(zip(requests, COLOURS, strict=False)):
        position = (index * image.width // len(requests) + size / 2, size / 2)
        draw.text(position, request.name, fill=colour, font_size=size, stroke_width=2, stroke_fill=_OUTLINE)
