"""Main loop of the live view: executes requests, simulates robots, and sends images to web pages."""

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
"""Maximum frame rate of the images on the page, Hz."""
STATE_RATE = 10.0
"""Maximum rate of state messages (telemetry) to the page, Hz."""
MAX_PENDING_REQUESTS = 256
"""Maximum number of requests that wait for the next control step; further requests are refused."""
HANDSHAKE = "hello"
"""First message that a page sends; the server answers with the policies and scenarios that the user can choose."""
EPISODE_STARTS = frozenset(("scenario", "policy", "alone", "reset", "next", "let_go"))
"""Names of the requests that start an episode.

Because the start of an episode takes up to 50 ms, only the last of several waiting requests of one kind is executed.
"""
IDLE_PERIOD = 0.01
"""Time between two checks for new requests while the simulation is paused, s."""

_REQUEST_ERRORS = (ValueError, UsageError, OSError, ImportError)
"""Exceptions of a request that are reported to the pages as messages, for example an unknown scenario."""


class LiveView:
    """Runs the live view until Ctrl-C: serves web pages, and simulates the robots that the pages steer.

    Args:
        controller: Controller of the robots.
        port: Port of the server, 0 for any free port. None for the default port 8080, or any free port if 8080 is in
            use.

    Attributes:
        server: Server of the web pages.
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
        """Handle a message from a page: answer the handshake, or queue a request for the next control step.

        Args:
            text: Message from the page.

        Returns:
            Answer to the page as JSON: the choices of policies and scenarios after the handshake, or an error. None if
            the request was queued.
        """
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
        """Run the live view for a wall time of `seconds`; raise KeyboardInterrupt after Ctrl-C."""
        end = time.perf_counter() + seconds
        with Interrupt() as interrupt:
            while time.perf_counter() < end:
                interrupt.check()
                self._process_requests()
                if not self._controller.step():
                    time.sleep(IDLE_PERIOD)
                self._show(time.perf_counter())

    def _show(self, now: float) -> None:
        """Start to draw an image, and send a state message (telemetry) to the pages, each if its period is over.

        The periods are 1 / FRAME_RATE and 1 / STATE_RATE.

        Args:
            now: Present time of `time.perf_counter`, s.
        """
        if self.server.wanted.is_set() and self._render_thread.idle and now >= self._next_frame_time:
            self._render_thread.submit(self._controller.render_requests())
            self._next_frame_time = max(now, self._next_frame_time + 1.0 / FRAME_RATE)
        if now >= self._next_state_time and self.server.has_clients:
            state = {"kind": "state", **self._controller.state(), "drawing": self._render_thread.failure or ""}
            self.server.broadcast(json.dumps(state))
            self._next_state_time = now + 1.0 / STATE_RATE

    def close(self) -> None:
        """End the live view: stop the render thread and the server."""
        self._render_thread.close()
        self.server.close()

    def _process_requests(self) -> None:
        """Execute the waiting requests of all pages, and report errors to the pages."""
        # The queue size is read only once, so that requests that arrive meanwhile wait for the next control step.
        pending = [self._requests.get_nowait() for _ in range(self._requests.qsize())]
        for request in drop_superseded(pending):
            try:
                self._controller.handle(request)
            except _REQUEST_ERRORS as error:
                self.server.broadcast(_error(str(error)))


def drop_superseded(requests: Sequence[Request]) -> list[Request]:
    """Return the requests in their order, but only the last one of each kind that starts an episode."""
    latest: dict[object, Request] = {}
    for number, request in enumerate(requests):
        key = (request.do, request.values.get("robot")) if request.do in EPISODE_STARTS else number
        latest.pop(key, None)
        latest[key] = request
    return list(latest.values())


def _error(text: str) -> str:
    """Return a message for a page, JSON, that reports the error `text`."""
    return json.dumps({"kind": "error", "text": text})
