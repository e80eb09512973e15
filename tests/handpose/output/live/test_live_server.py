"""handpose/output/live/server.py, with programs as clients; test_live_page.py tests the browser page."""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

import pytest

from handpose.output.live import server as module
from handpose.output.live.handshake import is_named
from handpose.output.live.messages import LINES, VIEWS
from handpose.output.live.server import LiveServer
from handpose.output.tracks.json_values import header_values
from netlib.errors import NetlibError
from tests.support.running import run_python
from tests.support.tracked_hands import HEADER

Serve = Callable[..., LiveServer]


class Clients:
    """Clients of a server; ``connect(server, path)`` adds one."""

    def __init__(self, stack: contextlib.ExitStack) -> None:
        self._stack = stack

    def connect(self, server: LiveServer, path: str = LINES, **options: Any) -> Any:
        """A client connected to a path; for the path of lines the header has been received."""
        from websockets.sync.client import connect

        client = self._stack.enter_context(connect(server.lines_url.replace(LINES, path), **options))
        if path == LINES:
            assert json.loads(client.recv(timeout=60))["format"] == "handpose"
        assert server.wait_for_client(60)
        return client

    def status(self, server: LiveServer, **options: Any) -> int:
        """The HTTP status of a WebSocket request: 101 if it is accepted."""
        from websockets.exceptions import InvalidStatus

        try:
            self.connect(server, **options)
        except InvalidStatus as error:
            return int(error.response.status_code)
        return 101


@pytest.fixture
def clients() -> Iterator[Clients]:
    """Clients that are closed after the test."""
    with contextlib.ExitStack() as stack:
        yield Clients(stack)


def answer(server: LiveServer, path: str, **headers: str) -> tuple[int, str]:
    """Status and text of an HTTP response."""
    place = urlsplit(server.page_url)
    connection = http.client.HTTPConnection(str(place.hostname), place.port, timeout=60)
    with contextlib.closing(connection):
        connection.request("GET", path, headers=headers)
        found = connection.getresponse()
        return found.status, found.read().decode()


# ------------------------------------------------------------------------------------------------ frames


def test_lines(clients: Clients, serve: Serve) -> None:
    """A client receives the header, every frame if it keeps up, and the recording's end as the end of the stream."""
    with serve() as server:
        client = clients.connect(server)
        for number in range(3):
            server.put(LINES, f'{{"number":{number}}}')
            assert json.loads(client.recv(timeout=60)) == {"number": number}
        server.put(LINES, "last")
    assert list(client) == ["last"]
    assert (client.protocol.close_code, client.protocol.close_reason) == (1000, "the recording has ended")


def test_the_header_is_that_of_a_track(server: LiveServer) -> None:
    """The header equals the first line of a track as JSON lines."""
    from websockets.sync.client import connect

    with connect(server.lines_url) as client:
        assert json.loads(client.recv(timeout=60)) == json.loads(json.dumps(header_values(HEADER)))


def test_two_clients(clients: Clients, serve: Serve) -> None:
    """Two clients receive the same frames; a client that has left is no longer served."""
    with serve() as server:
        one, other = clients.connect(server), clients.connect(server)
        server.put(LINES, "a")
        assert [client.recv(timeout=60) for client in (one, other)] == ["a", "a"]
        one.close()
        server.put(LINES, "b")
        assert other.recv(timeout=60) == "b"
        server.put(LINES, "c")
    assert list(other) == ["c"] and not server.has_clients(LINES)


def test_a_viewer_gets_the_newest_frame_when_it_asks(clients: Clients, server: LiveServer) -> None:
    """Frames that arrived in between are dropped, and ``put`` does not block."""
    viewer = clients.connect(server, VIEWS)
    server.put(VIEWS, b"0")
    assert viewer.recv(timeout=60) == b"0"
    for number in range(1, 100):
        server.put(VIEWS, b"%d" % number)
    viewer.send("next")
    assert viewer.recv(timeout=60) == b"99"
    viewer.close()


def test_a_slow_program_misses_frames(clients: Clients, server: LiveServer) -> None:
    """A slow client receives some frames in order, and the last one; sending does not wait for it."""
    count, size = 300, 1 << 18
    client, found = clients.connect(server), [-1]
    for number in range(count):
        server.put(LINES, f"{number}".rjust(size))
    while found[-1] < count - 1:
        found.append(int(client.recv(timeout=60)))
    assert found == sorted(found) and len(found) < count / 2


def test_a_client_that_leaves_in_the_middle_of_a_frame(clients: Clients, serve: Serve) -> None:
    """If one client disconnects without a close frame, the others still receive their frames."""
    with serve() as server:
        gone, other = (clients.connect(server, max_size=None) for _ in range(2))
        gone.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # close by a reset
        server.put(LINES, "x" * (1 << 20) * 8)
        gone.socket.shutdown(socket.SHUT_RDWR)
        server.put(LINES, "after")
    assert list(other)[-1] == "after"


def test_without_clients(serve: Serve) -> None:
    """The server does not wait for clients, and stores nothing for them."""
    with serve() as server:
        assert not server.wait_for_client(0) and not server.has_clients(LINES) and not server.has_clients(VIEWS)
        server.put(LINES, "a")


# ------------------------------------------------------------------------------------------------ the end


def test_a_run_that_is_stopped(clients: Clients, serve: Serve) -> None:
    """Stopping is reported as the close reason, and the stream ends normally."""
    with contextlib.suppress(KeyboardInterrupt), serve() as server:
        client = clients.connect(server)
        raise KeyboardInterrupt
    assert list(client) == []
    assert (client.protocol.close_code, client.protocol.close_reason) == (1001, "the tracker was stopped")


def test_a_client_that_does_not_answer_does_not_hold_up_the_end(
    clients: Clients, serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The server ends despite a viewer that requests no next frame, and a client that reads nothing."""
    monkeypatch.setattr(module, "GRACE_S", 0.05)
    with serve() as server:
        viewer, place = clients.connect(server, VIEWS), urlsplit(server.lines_url)
        silent = socket.create_connection((str(place.hostname), place.port))
        silent.sendall(f"GET {place.path}?{place.query} HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n"
                       "Connection: Upgrade\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n"
                       "Sec-WebSocket-Version: 13\r\n\r\n".encode())
        assert silent.recv(12) == b"HTTP/1.1 101"
        server.put(VIEWS, b"a")
        server.put(LINES, "x" * (1 << 25))
        assert viewer.recv(timeout=60) == b"a"
    assert not any(thread.name == "live" for thread in threading.enumerate())
    silent.close()


# ------------------------------------------------------------------------------------------------ access control


def test_the_page_needs_the_token(server: LiveServer) -> None:
    """The page is served only with the token, which is long and different for each server."""
    place = urlsplit(server.page_url)
    status, text = answer(server, f"/?{place.query}")
    assert status == 200 and text.startswith("<!DOCTYPE html>") and "connect-src 'self'" in text
    assert len(server.token) >= 20 and server.token != LiveServer("127.0.0.1", 0, "", "").token
    line = "Wrong token. Open the address that the tracker has printed."
    for wrong in (f"/?{place.query}x", f"/?token={server.token[:-1]}", "/?token=%ff", LINES):
        assert answer(server, wrong) == (403, f"{line}\n")
    for absent in ("/", "/?token=", "/?x=1"):
        status, text = answer(server, absent)
        assert status == 403 and line in text and server.token not in text
    assert answer(server, f"/other?{place.query}") == (404, "Expected /, /frames or /view.\n")
    assert answer(server, f"{LINES}?{place.query}")[0] == 426  # not a WebSocket


@pytest.mark.parametrize("path", [LINES, VIEWS])
def test_streams_need_the_token(clients: Clients, serve: Serve, path: str) -> None:
    """Without the right token the handshake is rejected."""
    with serve() as server:
        server.token, own = "another", server.token
        url = server.lines_url
        server.token = own
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(LiveServer, "lines_url", url)
            assert clients.status(server, path=path) == 403
        assert clients.status(server, path=path) == 101


@pytest.mark.parametrize(
    ("origin", "status"),
    [(None, 101), ("http://{}", 101), ("https://{}", 101), ("http://evil.example", 403),
     ("http://{}.evil.example", 403), ("http://127.0.0.1", 403), ("null", 403)],
)
def test_pages_of_other_sites_are_refused(
    clients: Clients, server: LiveServer, origin: str | None, status: int
) -> None:
    """The page's own origin has the requested host; programs send no origin."""
    own = urlsplit(server.page_url).netloc
    assert clients.status(server, origin=origin and origin.format(own)) == status


@pytest.mark.parametrize(
    ("host", "listening", "named"),
    [("127.0.0.1:80", "127.0.0.1", True), ("LOCALHOST:9", "127.0.0.1", True), ("[::1]:80", "127.0.0.1", True),
     ("evil.example", "127.0.0.1", False), ("localhost.evil.example", "127.0.0.1", False),
     ("192.168.0.7", "127.0.0.1", False), ("192.168.0.7", "0.0.0.0", True), ("evil.example:80", "0.0.0.0", False),
     (socket.gethostname(), "0.0.0.0", True), (socket.gethostname(), "127.0.0.1", False),
     ("Camera.lab:80", "camera.lab", True), ("192.168.0.7", "192.168.0.7", True),
     ("192.168.0.8", "192.168.0.7", False)],
)
def test_hosts(host: str, listening: str, named: bool) -> None:
    """A request must name this server: its own address, or any IP address if it listens on all of them."""
    assert is_named(host, listening) == named


def exchange(server: LiveServer, *pieces: bytes) -> bytes:
    """All that the server sends for these bytes, and for the end after them."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=60) as connection:
        for piece in pieces:
            connection.sendall(piece)
        connection.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: connection.recv(1 << 16), b""))


@pytest.mark.parametrize(
    ("received", "status"),
    [(b"\xff", 400), (b"\x16\x03\x01\x02", 400), (b"GET / HTTP/2.0\r\n", 400), (b"GET\r\n", 400), (b"GET / HT", 400),
     (b"POST / HTTP/1.1\r\n", 405), (b"GET / HTTP/1.1\r\nHost: localhost\r\n: x\r\n\r\n", 400),
     (b"GET / HTTP/1.1\r\n\r\n", 400), (b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: localhost\r\n\r\n", 400),
     (b"GET / HTTP/1.1\r\nHost: a b\r\n\r\n", 400), (b"GET //[x HTTP/1.1\r\nHost: localhost\r\n\r\n", 400),
     (b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n", 403),
     (b"GET / HTTP/1.1\r\nX: " + b"x" * (1 << 16), 431),
     (b"GET /frames?token=TOKEN HTTP/1.1\r\nHost: localhost\r\nOrigin: http://[\r\n\r\n", 400)],
)
def test_malformed_requests(server: LiveServer, received: bytes, status: int) -> None:
    """A request that is not valid is answered with its status, at once or with the end of the request."""
    received = received.replace(b"TOKEN", server.token.encode())
    assert exchange(server, received).startswith(b"HTTP/1.1 %d " % status)
    half = len(received) // 2
    assert exchange(server, received[:half], received[half:]).startswith(b"HTTP/1.1 %d " % status)


def test_a_token_of_the_user(serve: Serve) -> None:
    """The user can choose the token; a short one raises an error that does not contain it."""
    assert LiveServer("127.0.0.1", 0, "", "", "0123456789abcdef").token == "0123456789abcdef"
    with pytest.raises(NetlibError, match=r"^token: found 5 characters; expected 16 to 200 of A-Z"):
        LiveServer("127.0.0.1", 0, "", "", "guess")


# ------------------------------------------------------------------------------------------------ hostile connections


def test_connections_without_the_token_are_limited(
    clients: Clients, server: LiveServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of more silent connections than the limit the oldest are closed, and a client with the token connects."""
    monkeypatch.setattr(module, "MAX_WAITING", 3)
    with contextlib.ExitStack() as stack:
        silent = [stack.enter_context(socket.create_connection(("127.0.0.1", server.port), 60)) for _ in range(8)]
        client = clients.connect(server)
        for connection in silent[:5]:
            with contextlib.suppress(ConnectionResetError):
                assert connection.recv(1) == b""
        server.put(LINES, "a")
        assert client.recv(timeout=60) == "a" and len(server._gates._waiting) <= 3


def test_a_connection_must_be_quick(server: LiveServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """A connection that shows no token in time is closed, also one whose request is incomplete."""
    monkeypatch.setattr(module, "HANDSHAKE_S", 0.01)
    for begun in (b"", b"GET / HTTP/1.1\r\nHost: "):
        connection = socket.create_connection(("127.0.0.1", server.port), 60)
        with connection, contextlib.suppress(ConnectionError):
            connection.sendall(begun)
            assert connection.recv(1) == b""


def test_the_end_does_not_wait_for_silent_connections(serve: Serve) -> None:
    """Connections without the token are closed at once when the server ends."""
    with contextlib.ExitStack() as stack, serve() as server:
        opened = [stack.enter_context(socket.create_connection(("127.0.0.1", server.port), 60)) for _ in range(5)]
        opened[0].sendall(b"GET / HTTP/1.1\r\n")
        opened[1].sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert opened[1].recv(12) == b"HTTP/1.1 403"
    assert not any(thread.name == "live" for thread in threading.enumerate())


def test_clients_are_limited(clients: Clients, server: LiveServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Clients with the token are limited, too."""
    monkeypatch.setattr(module, "MAX_CLIENTS", 1)
    assert [clients.status(server), clients.status(server)] == [101, 503]


# ------------------------------------------------------------------------------------------------ addresses


def test_other_machines(serve: Serve) -> None:
    """Other machines can connect only if requested; then the addresses contain this machine's name."""
    with serve() as server:
        assert not server.is_public and server.page_url.startswith(f"http://127.0.0.1:{server.port}/?token=")
    with serve("0.0.0.0") as server:
        assert server.is_public and urlsplit(server.page_url).hostname == socket.gethostname().lower()


@pytest.mark.skipif(not socket.has_ipv6, reason="no IPv6")
def test_an_address_of_ipv6(clients: Clients, serve: Serve) -> None:
    """An IPv6 address is written in brackets."""
    try:
        with serve("::1") as server:
            assert not server.is_public and server.lines_url.startswith(f"ws://[::1]:{server.port}/frames?token=")
            clients.connect(server)
    except NetlibError as error:
        pytest.skip(str(error))


def test_a_port_that_is_in_use(serve: Serve, server: LiveServer) -> None:
    """A port in use raises an error."""
    line = f"^127.0.0.1:{server.port}: the port is in use; choose another one, or 0 for any that is free$"
    with pytest.raises(NetlibError, match=line), serve(port=server.port):
        pass


@pytest.mark.parametrize("more", range(4))
def test_without_descriptors(more: int) -> None:
    """Without descriptors for the event loop and the socket an error is raised, and nothing printed."""
    pytest.importorskip("websockets")
    assert run_python("-c", WITHOUT_DESCRIPTORS, more).err == ""


WITHOUT_DESCRIPTORS = """
import itertools, os, resource, sys
import asyncio, websockets.asyncio.server
from handpose.output.live.server import LiveServer
from netlib.errors import NetlibError
server = LiveServer("127.0.0.1", 0, "{}", "page")
used = {int(name) for name in os.listdir("/proc/self/fd") if os.path.exists(f"/proc/self/fd/{name}")}
free = (number for number in itertools.count() if number not in used)
limit = next(itertools.islice(free, int(sys.argv[1]), None))
resource.setrlimit(resource.RLIMIT_NOFILE, (limit, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
try:
    server.__enter__()
except NetlibError as error:
    assert "cannot listen" in str(error) and "open files" in str(error), error
else:
    raise AssertionError("it runs")
"""


@pytest.mark.parametrize(("host", "why"), [("x" * 70, "unknown host"), ("192.0.2.1", "cannot listen: ")])
def test_an_address_that_is_not_of_this_machine(serve: Serve, host: str, why: str) -> None:
    """An unknown host, or an address of another machine, raises an error."""
    with pytest.raises(NetlibError, match=f"^{host}:0: {why}"), serve(host):
        pass


def test_without_websockets(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without websockets the constructor raises an error with the command that installs it."""
    monkeypatch.setitem(sys.modules, "websockets", None)
    with pytest.raises(NetlibError, match=r"^websockets is missing: pip install 'websockets>=13'$"):
        LiveServer("127.0.0.1", 0, "", "")
