"""The loop of the live view: does what pages ask for, moves the robots in real time, shows them and their state."""

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

FRAME_RATE, STATE_RATE = 30.0, 10.0
MAX_PENDING_REQUESTS = 256
"""Requests that may be waiting; more are refused."""
HANDSHAKE = "hello"
"""What a page says first."""
EPISODE_STARTS = frozenset(("scenario", "policy", "alone", "reset", "next", "let_go"))
"""Requests that start an episode. A start takes up to 50 ms, so only the last of each kind is done."""
IDLE_PERIOD = 0.01
"""Time between two looks at what is to be done while paused, s."""

_REQUEST_ERRORS = (ValueError, UsageError, OSError, ImportError)
"""What comes of a request for a scenario or policy that is not there, or of a full disk."""


class LiveView:
    """Robots that walk where pages steer them, until Ctrl-C; see `Server` for the port and its error."""

    def __init__(self, driver: ViewController, port: int | None) -> None:
        self._driver, self._offer = driver, json.dumps({"kind": "offer", **driver.choices()})
        self._todo: queue.Queue[Request] = queue.Queue(MAX_PENDING_REQUESTS)
        self._frame_due = self._telling_due = 0.0
        self.server = Server(port, self.receive)
        self._painter = RenderThread(self.server.show)

    def receive(self, text: str) -> str | None:
        """What a page is to be answered to a text; what it asks for is done before the next control step."""
        if text == HANDSHAKE:
            return self._offer
        try:
            self._todo.put_nowait(parse(text))
        except RequestError as error:
            return _error(str(error))
        except queue.Full:
            return _error("too many requests at once")
        return None

    def run(self, seconds: float = float("inf")) -> None:
        """Go on for so many s of wall time. KeyboardInterrupt after Ctrl-C."""
        end = time.perf_counter() + seconds
        with Interrupt() as interrupt:
            while time.perf_counter() < end:
                interrupt.check()
                self._process_requests()
                if not self._driver.step():
                    time.sleep(IDLE_PERIOD)
                self._show(time.perf_counter())

    def _show(self, now: float) -> None:
        """Draw and report what is due."""
        if self.server.wanted.is_set() and self._painter.idle and now >= self._frame_due:
            self._painter.submit(self._driver.render_requests())
            self._frame_due = max(now, self._frame_due + 1.0 / FRAME_RATE)
        if now >= self._telling_due and self.server.has_clients:
            state = {"kind": "state", **self._driver.state(), "drawing": self._painter.failure or ""}
            self.server.broadcast(json.dumps(state))
            self._telling_due = now + 1.0 / STATE_RATE

    def close(self) -> None:
        """Take leave of the pages, and of the thread that draws."""
        self._painter.close()
        self.server.close()

    def _process_requests(self) -> None:
        waiting = [self._todo.get_nowait() for _ in range(self._todo.qsize())]  # not those that come meanwhile
        for request in drop_superseded(waiting):
            try:
                self._driver.handle(request)
            except _REQUEST_ERRORS as error:
                self.server.broadcast(_error(str(error)))


def drop_superseded(requests: Sequence[Request]) -> list[Request]:
    """Return the requests without superseded ones: only the last of each kind in BEGINNINGS stays."""
    kept: dict[object, Request] = {}
    for number, request in enumerate(requests):
        key = (request.do, request.values.get("robot")) if request.do in EPISODE_STARTS else number
        kept.pop(key, None)
        kept[key] = request
    return list(kept.values())


def _error(text: str) -> str:
    return json.dumps({"kind": "error", "text": text})
