"""Loop of the live view: handles requests, steps the robots in real time, and sends frames and states to pages."""

import json
import queue
import time
from collections.abc import Sequence

from live.view.controller import ViewController
from live.view.render_thread import RenderThread
from live.view.requests import Request, RequestError, parse
from live.view.server import Server
from quad_env.cli.command_line import UsageError
from quad_env.cli.interrupt import Interrupt

FRAME_RATE = 30.0
"""Hz. Maximum rate of frames."""
STATE_RATE = 10.0
"""Hz. Rate of state messages."""
MAX_PENDING_REQUESTS = 256
"""Maximum number of pending requests; more are refused."""
HANDSHAKE = "hello"
"""First message of a page."""
EPISODE_STARTS = frozenset(("scenario", "policy", "alone", "reset", "next", "let_go"))
"""Requests that start an episode. A start takes up to 50 ms, so only the last of each kind is carried out."""
IDLE_PERIOD = 0.01
"""s. Polling period of requests while paused."""

_REQUEST_ERRORS = (ValueError, UsageError, OSError, ImportError)
"""Errors of a request that are reported to pages: a missing scenario or policy, or a full disk."""


class LiveView:
    """Serves pages and steps the robots that they steer, until Ctrl-C.

    Args:
        controller: The robots.
        port: Port of the server, see `Server`.

    Attributes:
        server: Server of the pages.
    """

    def __init__(self, controller: ViewController, port: int | None) -> None:
        self._controller = controller
        self._choices = json.dumps({"kind": "offer", **controller.choices()})
        self._requests: queue.Queue[Request] = queue.Queue(MAX_PENDING_REQUESTS)
        self._next_frame_time = 0.0
        self._next_state_time = 0.0
        self.server = Server(port, self.receive)
        self._render_thread = RenderThread(self.server.show)

    def receive(self, text: str) -> str | None:
        """Return the answer to a page's `text`, or None; requests wait for the next control step."""
        if text == HANDSHAKE:
            return self._choices
        try:
            self._requests.put_nowait(parse(text))
        except RequestError as error:
            return _error(str(error))
        except queue.Full:
            return _error("too many requests at once")
        return None

    def run(self, seconds: float = float("inf")) -> None:
        """Run the view for `seconds` of wall time; KeyboardInterrupt after Ctrl-C."""
        end = time.perf_counter() + seconds
        with Interrupt() as interrupt:
            while time.perf_counter() < end:
                interrupt.check()
                self._process_requests()
                if not self._controller.step():
                    time.sleep(IDLE_PERIOD)
                self._show(time.perf_counter())

    def _show(self, now: float) -> None:
        """Draw a frame and send the state if they are due."""
        if self.server.wanted.is_set() and self._render_thread.idle and now >= self._next_frame_time:
            self._render_thread.submit(self._controller.render_requests())
            self._next_frame_time = max(now, self._next_frame_time + 1.0 / FRAME_RATE)
        if now >= self._next_state_time and self.server.has_clients:
            state = {"kind": "state", **self._controller.state(), "drawing": self._render_thread.failure or ""}
            self.server.broadcast(json.dumps(state))
            self._next_state_time = now + 1.0 / STATE_RATE

    def close(self) -> None:
        """End the render thread and the server."""
        self._render_thread.close()
        self.server.close()

    def _process_requests(self) -> None:
        """Carry out the pending requests and report their errors to the pages."""
        pending = [self._requests.get_nowait() for _ in range(self._requests.qsize())]  # without later ones
        for request in drop_superseded(pending):
            try:
                self._controller.handle(request)
            except _REQUEST_ERRORS as error:
                self.server.broadcast(_error(str(error)))


def drop_superseded(requests: Sequence[Request]) -> list[Request]:
    """Return the requests without superseded ones: only the last of each kind in EPISODE_STARTS stays."""
    latest: dict[object, Request] = {}
    for number, request in enumerate(requests):
        key = (request.do, request.values.get("robot")) if request.do in EPISODE_STARTS else number
        latest.pop(key, None)
        latest[key] = request
    return list(latest.values())


def _error(text: str) -> str:
    """Return an error message for a page."""
    return json.dumps({"kind": "error", "text": text})
