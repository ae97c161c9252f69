"""Only browsers of this machine on the server's own page reach it; malformed requests are refused."""

import http.client
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from live.view.server import FRAME_ACK, MAX_MESSAGE_SIZE, MAX_PAGES, Server
from quad_env.cli.command_line import UsageError
from tests.waiting import until


def echo(text: str) -> str | None:
    return None if text == "quiet" else f"heard {text}"


@pytest.fixture
def server() -> Iterator[Server]:
    with closing(Server(0, echo)) as found:
        yield found


def page(server: Server, **options: object) -> ClientConnection:
    return connect(f"ws://localhost:{server.port}/socket", **options)  # type: ignore[arg-type]


def status(server: Server, path: str = "/", **headers: str) -> int:
    with closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)) as connection:
        names = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request("GET", path, headers={"Host": f"localhost:{server.port}"} | names)
        return connection.getresponse().status


def test_nothing_but_the_page_and_its_files_is_served_and_it_may_load_nothing_from_elsewhere(server: Server) -> None:
    with closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)) as connection:
        connection.request("GET", "/", headers={"Host": f"localhost:{server.port}"})
        answer = connection.getresponse()
        assert answer.status == 200
        assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
        for nowhere in ("frame-ancestors", "base-uri", "form-action"):
            assert f"{nowhere} 'none'" in answer.headers["Content-Security-Policy"]
        assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"
        text = answer.read().decode()
    assert "view.js" in text
    assert "http://" not in text
    assert "https://" not in text
    for path in ("/view.js", "/view.css", "/curves.js", "/gamepads.js", "/icon.svg"):
        assert status(server, path) == 200

    for path in ("/../server.py", "/%2e%2e/server.py", "//etc/passwd", "/none.js"):
        assert status(server, path) == 404


@pytest.mark.parametrize(
    "text",
    [
        "GET / HTTP/1.1\r\nHost: HERE\r\nHost: rebound.example\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: HERE\r\nOrigin: http://HERE\r\nOrigin: http://elsewhere.example\r\n\r\n",
        "GET //[ HTTP/1.1\r\nHost: HERE\r\n\r\n",
        "\x16\x03\x01\r\n\r\n",
    ],
)
def test_what_is_no_request_opens_nothing_and_prints_nothing(
    server: Server, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as connection:
        connection.sendall(text.replace("HERE", f"localhost:{server.port}").encode())
        answer = connection.recv(100)
    assert answer[:12] in (b"", b"HTTP/1.1 400")
    assert caplog.records == []
    assert status(server) == 200


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "TRACE", "PATCH", "get"])
def test_only_get_and_head_are_answered(server: Server, method: str) -> None:
    for path in ("/", "/socket", "/none"):
        with closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)) as connection:
            connection.request(method, path, headers={"Host": f"localhost:{server.port}"})
            answer = connection.getresponse()
            assert answer.status in (405, 400)
            assert "only GET and HEAD" in answer.read().decode() or answer.status == 400


def test_a_head_has_the_headers_of_its_page_alone(server: Server) -> None:
    with closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)) as connection:
        connection.request("HEAD", "/", headers={"Host": f"localhost:{server.port}"})
        answer = connection.getresponse()
        assert (answer.status, answer.read()) == (200, b"")
        assert int(answer.headers["Content-Length"]) > 1000


def test_pages_from_elsewhere_and_other_names_are_refused(server: Server) -> None:
    for host in ("rebound.example", "", "user@localhost", "localhost@rebound.example", "localhost/rebound.example"):
        assert status(server, Host=host) == 403, host
    for origin in ("http://elsewhere.example", "null", "http://localhost:1"):
        assert status(server, Origin=origin) == 403, origin
    for site in ("cross-site", "same-site"):
        assert status(server, Sec_Fetch_Site=site) == 403, site
    assert status(server, Origin=f"http://localhost:{server.port}", Sec_Fetch_Site="same-origin") == 200


def test_a_socket_opened_by_another_page_is_refused_before_it_opens(server: Server) -> None:
    with pytest.raises(InvalidStatus) as refused:
        page(server, origin="http://elsewhere.example")
    assert refused.value.response.status_code == 403
    with page(server, origin=f"http://localhost:{server.port}") as own:
        own.send("hello")
        assert own.recv(timeout=30) == "heard hello"


def test_a_page_that_sends_too_much_is_disconnected_and_the_others_go_on(server: Server) -> None:
    with page(server) as good, page(server) as bad:
        bad.send("x" * (MAX_MESSAGE_SIZE + 1))
        with pytest.raises(ConnectionClosed):
            bad.recv(timeout=30)
        good.send(b"\xff\x00")  # binary data is ignored
        good.send("still here")
        assert good.recv(timeout=30) == "heard still here"


def test_frames_wait_for_a_page_that_is_slow_and_tellings_come_in_order(server: Server) -> None:
    with page(server) as slow:
        assert server.wanted.wait(5)
        server.show(b"first")
        assert slow.recv(timeout=30) == b"first"
        server.show(b"second")
        for number in range(3):
            server.broadcast(str(number))
        assert [slow.recv(timeout=30) for _ in range(3)] == ["0", "1", "2"]
        assert not server.wanted.is_set()
        slow.send(FRAME_ACK)
        assert server.wanted.wait(5)
        server.show(b"third")
        assert slow.recv(timeout=30) == b"third"


def test_more_pages_than_there_is_room_for_are_sent_away(server: Server) -> None:
    with ExitStack() as stack:
        first, *_ = [stack.enter_context(page(server)) for _ in range(MAX_PAGES)]
        with page(server) as one_more, pytest.raises(ConnectionClosed):
            one_more.recv(timeout=30)
        first.send("quiet")
        first.send("here")
        assert first.recv(timeout=30) == "heard here"


def test_it_listens_where_its_address_says_and_nowhere_else(server: Server) -> None:
    with pytest.raises(UsageError, match="--port 0"):
        Server(server.port, echo)
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", server.port), timeout=2)
    assert server.url == f"http://localhost:{server.port}/"


def test_closing_it_frees_its_thread_and_its_port() -> None:
    before = threading.active_count()
    server = Server(0, echo)
    with page(server) as left:
        server.close()
        with pytest.raises(ConnectionClosed):
            left.recv(timeout=30)
    until(lambda: threading.active_count() <= before, "a thread is left")  # the client's thread ends later
    with pytest.raises(OSError):  # noqa: PT011
        socket.create_connection(("127.0.0.1", server.port), timeout=2)
