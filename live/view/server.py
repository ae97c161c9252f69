"""Server of the live view for browsers on the same machine.

The server sends the page by HTTP, and exchanges messages and images with the page over a WebSocket, on one port.
"""

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
"""Folder with the HTML, script and style files of the web page."""
CONTENT_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
}
_LOGGER = logging.getLogger(__name__)
# The logger is silent, so that invalid connections do not print errors in the user's terminal.
_LOGGER.setLevel(logging.CRITICAL)
MAX_MESSAGE_SIZE = 4096
"""Maximum size of a message from a page, bytes; the server closes the connection after a larger message."""
MAX_PAGES = 8
"""Maximum number of pages that are connected at the same time."""
FRAME_ACK = "drawn"
"""Message with which a page reports that it has shown an image and is ready for the next image."""
_FILES = {f"/{file.name}": file for file in PAGE.iterdir() if file.suffix in CONTENT_TYPES} | {"/": PAGE / "index.html"}
Receive = Callable[[str], str | None]
"""Type of the function that is called in the server's thread with every text message from a page.

The function returns the answer that the server sends back to the same page, or None for no answer.
"""
HOST = "127.0.0.1"
PORT = 8080
"""Default port of the server, which the user can change by the option --port."""
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
    """Server that exchanges texts and images with web pages, in a separate thread.

    The server listens only on the loopback address HOST. The server refuses requests to other host names, and requests
    that other web sites send. The constructor raises UsageError if `port` is in use.

    Args:
        port: Port of the server, 0 for any free port. None for PORT, or any free port if PORT is in use.
        receive: Function that is called with every text message from a page, and returns the answer or None.

    Attributes:
        port: Port on which the server listens.
        wanted: Event that is set while a page waits for an image.
    """

    def __init__(self, port: int | None, receive: Receive) -> None:
        self._receive = receive
        self._socket = _listen(port)
        self.port: int = self._socket.getsockname()[1]
        self._pages: dict[ServerConnection, bool] = {}
        """Connection of a page -> True while the page waits for an image."""
        self._stop: asyncio.Event | None = None
        self._ready = threading.Event()
        self.wanted = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._run()), name="page", daemon=True)
        self._thread.start()
        self._ready.wait()

    @property
    def url(self) -> str:
        """URL of the web page on this machine."""
        return f"http://localhost:{self.port}/"

    @property
    def has_clients(self) -> bool:
        """True if at least one page is connected."""
        return bool(self._pages)

    def broadcast(self, text: str) -> None:
        """Send a text message to every connected page."""
        self._call_in_thread(lambda: websocket_broadcast(self._pages, text))

    def show(self, frame: bytes) -> None:
        """Send an image, JPEG, to every page that waits for an image."""
        self.wanted.clear()
        self._call_in_thread(lambda: self._show(frame))

    def close(self) -> None:
        """Disconnect all pages, end the thread of the server and free the port."""
        self._call_in_thread(lambda: self._stop.set() if self._stop else None)
        self._thread.join(timeout=5.0)

    def _show(self, frame: bytes) -> None:
        """Send an image to the pages that wait for an image; must be called in the server's thread."""
        waiting = [page for page, waits in self._pages.items() if waits]
        self._pages |= dict.fromkeys(waiting, False)
        websocket_broadcast(waiting, frame)

    def _call_in_thread(self, call: Callable[[], object]) -> None:
        """Let the server's thread call the function `call`; the result is ignored."""
        with contextlib.suppress(RuntimeError):  # The server's thread may have ended.
            self._loop.call_soon_threadsafe(call)

    async def _run(self) -> None:
        """Run the server until `close` is called; the main function of the server's thread."""
        self._loop = asyncio.get_running_loop()
        self._stop = asyncio.Event()
        server = await serve(
            self._connected,
            sock=self._socket,
            process_request=self._answer,
            max_size=MAX_MESSAGE_SIZE,
            compression=None,
            ping_interval=20.0,
            close_timeout=1.0,
            logger=_LOGGER,
        )
        self._ready.set()
        async with server:
            await self._stop.wait()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the answer to an HTTP request, for example a file of the page.

        Args:
            connection: Connection to the browser.
            request: Request of the browser.

        Returns:
            The answer; None to open a WebSocket, for a valid request of the path /socket.
        """
        try:
            path = urllib.parse.urlsplit(request.path).path
            refusal = _refusal(request)
        except (ValueError, LookupError):  # The URL is invalid, or a header is repeated.
            return connection.respond(http.HTTPStatus.BAD_REQUEST, "that is no request\n")
        if refusal is not None:
            return connection.respond(http.HTTPStatus.FORBIDDEN, f"{refusal}\n")
        method = getattr(request, "method", "GET")  # Older websockets accept only GET and have no `method`.
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
        """Receive and answer the messages of a page over a WebSocket, until the page disconnects."""
        if len(self._pages) >= MAX_PAGES:
            await connection.close(1013, "too many pages")
            return
        self._await_frame(connection)
        try:
            async for message in connection:
                if message == FRAME_ACK:
                    self._await_frame(connection)
                elif isinstance(message, str) and (answer := self._receive(message)) is not None:
                    await connection.send(answer)
        except ConnectionClosed:
            pass
        finally:
            del self._pages[connection]

    def _await_frame(self, page: ServerConnection) -> None:
        """Record that the connected page `page` waits for an image."""
        self._pages[page] = True
        self.wanted.set()


def _listen(port: int | None) -> socket.socket:
    """Return a socket that listens on the loopback address `HOST`.

    Args:
        port: Port, 0 for any free port. None for PORT, or any free port if PORT is in use.

    Returns:
        The socket.

    Raises:
        UsageError: The port is in use.
    """
    try:
        return socket.create_server((HOST, PORT if port is None else port))
    except OSError as error:
        if port is None:
            return _listen(0)
        raise UsageError(f"cannot listen on {HOST} port {port} ({error}): --port 0 takes a free one") from None


def _refusal(request: Request) -> str | None:
    """Return the reason as text if an HTTP request is refused; None if the request is accepted."""
    host = request.headers.get("Host", "")
    origin = request.headers.get("Origin")
    address = urllib.parse.urlsplit(f"//{host}")
    if "@" in host or address.netloc != host:
        return "a host is a name or an address, and perhaps a port"
    if address.hostname not in ("localhost", HOST):
        return "this page is for browsers on its own machine: open it as localhost"
    if origin is not None and origin != f"http://{host}":
        return _FOREIGN
    site = request.headers.get("Sec-Fetch-Site", "none")
    return None if site in ("none", "same-origin") else _FOREIGN
