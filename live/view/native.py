"""A native window beside the page: the same robots, marks and keys, where there is a display."""

from collections.abc import Callable
from typing import Any

from live.view.latest import Latest
from live.view.painter import Picture
from quad_env.cli.command_line import UsageError
from quad_env.physics.rendering import Window, shows_windows


class NativeWindow:
    """Shows pictures in a window of MuJoCo's own viewer.

    Args:
        on_key: told GLFW's code of every key that is pressed in it, in a thread of the viewer.

    Raises:
        UsageError: there is no display.
    """

    def __init__(self, on_key: Callable[[int], None]) -> None:
        if not shows_windows():
            raise UsageError("--window needs a display: without one, open the page")
        self._on_key = on_key
        self._window: Window | None = None
        self._model: Any = None
        self._thread: Latest[tuple[Picture, str]] = Latest("window", self._take, self._forget)

    @property
    def is_open(self) -> bool:
        """Whether nobody has closed it."""
        return self._window is None or self._window.is_open

    @property
    def idle(self) -> bool:
        """Whether it shows what it was handed."""
        return self._thread.idle

    def show(self, picture: Picture, text: str) -> None:
        """Show a picture, all robots in one, with a text in the corner, instead of what is not shown yet."""
        self._thread.hand((picture, text))

    def close(self) -> None:
        """Close the window."""
        self._thread.close()

    def _take(self, item: tuple[Picture, str]) -> bool:
        picture, text = item
        if picture.model is not self._model:
            self._forget()
            self._window, self._model = Window(picture.model, self._on_key), picture.model
        assert self._window is not None
        first, *others = picture.robots
        self._window.draw(first, others=others, marks=picture.marks, text=text)
        return True

    def _forget(self) -> None:
        if self._window is not None:
            self._window.close()
            self._window = None
