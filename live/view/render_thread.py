"""Thread that draws images of the robots while the main thread continues the simulation."""

import io
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from live.view.render_request import RenderRequest
from quad_env.physics.rendering import Camera

JPEG_QUALITY = 80
"""Quality of the JPEG images, from 0 to 100; a larger value gives larger images in bytes."""
WIDTH = 720
"""Width of an image of all robots, pixels; small, so that a processor can draw it without a GPU in time."""
HEIGHT = 360
"""Height of an image of all robots, pixels."""
COLOURS = ((255, 200, 46), (88, 166, 255), (255, 140, 200), (160, 230, 120))
"""Colour of each robot's policy name, RGB from 0 to 255; view.css has the same colours for the robots' curves."""
_OUTLINE = (30, 34, 38)
"""Colour of the outline of the policy names, RGB from 0 to 255."""


class RenderThread:
    """Draws JPEG images of the robots in a separate thread.

    Args:
        show: Function that is called with each JPEG image, in the render thread.

    Attributes:
        failure: Text about the reason if images cannot be drawn on this machine; otherwise None.
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
        """True if images can be drawn on this machine and the last image is finished."""
        return self.failure is None and (self._work is None or self._work.done())

    def submit(self, requests: Sequence[RenderRequest]) -> None:
        """Start to draw an image of all robots in the render thread; there is one request per robot."""
        self._work = self._thread.submit(self._draw_and_show, requests)

    def close(self) -> None:
        """End the render thread, and free its renderers."""
        self._thread.submit(self._close_renderers)
        self._thread.shutdown()

    def _draw_and_show(self, requests: Sequence[RenderRequest]) -> None:
        """Draw an image and pass it to `show`; store the reason in `failure` if the image cannot be drawn."""
        try:
            frame = self._draw(requests)
        except Exception as error:  # Graphics drivers raise many kinds of exceptions.
            self.failure = f"nothing can be drawn here ({type(error).__name__}: {error})"
            return
        self._show(frame)

    def _draw(self, requests: Sequence[RenderRequest]) -> bytes:
        """Draw the robots of all requests side by side, and return the image as JPEG."""
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
        """Free the renderers of all robots."""
        for camera in self._cameras:
            camera.close()
        self._cameras = []
        self._models = []


def _draw_names(image: Image.Image, requests: Sequence[RenderRequest]) -> None:
    """Write the name of each robot's policy into the image, in the colour of the robot's curves.

    Args:
        image: Image with all robots side by side, which is changed in place.
        requests: Render requests, one per robot.
    """
    draw = ImageDraw.Draw(image)
    size = image.height // 22
    for index, (request, colour) in enumerate(zip(requests, COLOURS, strict=False)):
        position = (index * image.width // len(requests) + size / 2, size / 2)
        draw.text(position, request.name, fill=colour, font_size=size, stroke_width=2, stroke_fill=_OUTLINE)
