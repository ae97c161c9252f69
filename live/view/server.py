"""The server of the page: HTTP and one WebSocket on one port, for this machine's own browsers alone."""

import asyncio
import contextlib
import http
import logging
import socket
import threading
import urllib.parse
from collections.abc import Callable
from pathlib import Path

from websockets.asyncio.server import ServerConnection, serve
from websockets.asyncio.server import broadcast as websocket_broadcast
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from quad_env.cli.command_line import UsageError

PAGE = Path(__file__).parent / "page"
CONTENT_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
}
_QUIET = logging.getLogger(__name__)
_QUIET.setLevel(logging.CRITICAL)  # invalid connections print nothing in the terminal of the view
MAX_MESSAGE_SIZE = 4096
"""Bytes; a page that sends more is disconnected."""
MAX_PAGES = 8
FRAME_ACK = "drawn"
"""What a page says when it has shown a frame and can take the next."""
_FILES = {f"/{file.name}": file for file in PAGE.iterdir() if file.suffix in CONTENT_TYPES} | {"/": PAGE / "index.html"}
Receive = Callable[[str], str | None]
"""Told every text that a page sends, in the server's thread; what it returns is sent back to that page."""
HOST, PORT = "127.0.0.1", 8080
_FOREIGN = "this page answers to itself alone: type its address, or paste it, where addresses are typed"
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'self'; connect-src 'self' ws:; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class Server:
    """Shows pages what is published and hands on what they send, from a thread of its own.

    It listens on `HOST`; only requests that name this machine as their host and come from its own page are answered.

    Args:
        port: 0 takes a free one; None takes `PORT`, or a free one where that is taken.
        receive: called with the texts of pages.

    Raises:
        UsageError: nothing can listen there.
    """

    def __init__(self, port: int | None, receive: Receive) -> None:
        self._receive = receive
        self._socket = _listening(port)
        self.port: int = self._socket.getsockname()[1]
        self._pages: dict[ServerConnection, bool] = {}
        """Whether each page waits for a frame."""
        self._stop: asyncio.Event | None = None
        self._ready = threading.Event()
        self.wanted = threading.Event()
        """Set while a page waits for a frame."""
        self._thread = threading.Thread(target=lambda: asyncio.run(self._run()), name="page", daemon=True)
        self._thread.start()
        self._ready.wait()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://localhost:{self.port}/"

    @property
    def has_clients(self) -> bool:
        """Whether there is a page."""
        return bool(self._pages)

    def broadcast(self, text: str) -> None:
        """Send a text to every page."""
        self._in_its_thread(lambda: websocket_broadcast(self._pages, text))

    def show(self, frame: bytes) -> None:
        """Send a frame to every page that waits for one."""
        self.wanted.clear()
        self._in_its_thread(lambda: self._show(frame))

    def close(self) -> None:
        """Take leave of the pages and free the port."""
        self._in_its_thread(lambda: self._stop.set() if self._stop else None)
        self._thread.join(timeout=5.0)

    def _show(self, frame: bytes) -> None:
        waiting = [page for page, waits in self._pages.items() if waits]
        self._pages |= dict.fromkeys(waiting, False)
        websocket_broadcast(waiting, frame)

    def _in_its_thread(self, call: Callable[[], object]) -> None:
        with contextlib.suppress(RuntimeError):  # it has ended
            self._loop.call_soon_threadsafe(call)

    async def _run(self) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        server = await serve(
            self._connected,
            sock=self._socket,
            process_request=self._answer,
            max_size=MAX_MESSAGE_SIZE,
            compression=None,
            ping_interval=20.0,
            close_timeout=1.0,
            logger=_QUIET,
        )
        self._ready.set()
        async with server:
            await self._stop.wait()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The answer to a request, or None where a WebSocket is to be opened."""
        try:
            path, refusal = urllib.parse.urlsplit(request.path).path, _refusal(request)
        except (ValueError, LookupError):  # no address, or a header twice
            return connection.respond(http.HTTPStatus.BAD_REQUEST, "that is no request\n")
        if refusal is not None:
            return connection.respond(http.HTTPStatus.FORBIDDEN, f"{refusal}\n")
        method = getattr(request, "method", "GET")  # older versions of websockets refuse all others by themselves
        if method not in ("GET", "HEAD") or (method == "HEAD" and path == "/socket"):
            refused = connection.respond(http.HTTPStatus.METHOD_NOT_ALLOWED, "only GET and HEAD are answered\n")
            refused.headers["Allow"] = "GET, HEAD"
            return refused
        if path == "/socket":
            return None
        file = _FILES.get(path)
        if file is None:
            return connection.respond(http.HTTPStatus.NOT_FOUND, "there is no such file\n")
        body = file.read_bytes()
        headers = Headers({"Content-Type": CONTENT_TYPES[file.suffix], "Content-Length": str(len(body)), **_HEADERS})
        return Response(200, "OK", headers, b"" if method == "HEAD" else body)

    async def _connected(self, connection: ServerConnection) -> None:
        if len(self._pages) >= MAX_PAGES:
            await connection.close(1013, "too many pages")
            return
        self._waits(connection)
        try:
            async for message in connection:
                if message == FRAME_ACK:
                    self._waits(connection)
                elif isinstance(message, str) and (answer := self._receive(message)) is not None:
                    await connection.send(answer)
        except ConnectionClosed:
            pass
        finally:
            del self._pages[connection]

    def _waits(self, page: ServerConnection) -> None:
        self._pages[page] = True
        self.wanted.set()


def _listening(port: int | None) -> socket.socket:
    try:
        return socket.create_server((HOST, PORT if port is None else port))
    except OSError as error:
        if port is None:
            return _listening(0)
        raise UsageError(f"cannot listen on {HOST} port {port} ({error}): --port 0 takes a free one") from None


def _refusal(request: Request) -> str | None:
    """Why a request is refused, None where it is not."""
    host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
    named = urllib.parse.urlsplit(f"//{host}")
    if "@" in host or named.netloc != host:
        return "a host is a name or an address, and perhaps a port"
    if named.hostname not in ("localhost", HOST):
        return "this page is for browsers on its own machine: open it as localhost"
    if origin is not None and origin != f"http://{host}":
        return _FOREIGN
    site = request.headers.get("Sec-Fetch-Site", "none")
    return None if site in ("none", "same-origin") else _FOREIGN
