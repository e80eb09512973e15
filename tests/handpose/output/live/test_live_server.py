"""handpose/output/live/server.py, with programs as clients; test_live_page.py tests
the browser page.
"""

from __future__ import annotations

import contextlib
import json
import logging
import re
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from handpose.output.live import server as module
from handpose.output.live.messages import LINES_PATH, VIEWS_PATH, Messages
from handpose.output.live.server import LiveServer, is_named
from netlib.errors import NetlibError
from netlib.files.paths import ROOT
from tests.handpose.output.live.conftest import BOTH
from tests.support.tracked_hands import HEADER

Serve, Connect = Callable[..., LiveServer], Callable[..., Any]


@pytest.fixture
def connect() -> Iterator[Connect]:
    """``connect(server, path)`` is a client; for the path of lines it has received the header."""
    client = pytest.importorskip("websockets.sync.client")
    with contextlib.ExitStack() as stack:

        def connected(server: LiveServer, path: str = LINES_PATH, **options: Any) -> Any:
            one = stack.enter_context(
                client.connect(server.lines_url.replace(LINES_PATH, path), **options)
            )
            if path == LINES_PATH:
                assert json.loads(one.recv(timeout=60))["format"] == "handpose"
            assert server.wait_for_client(60)
            return one

        yield connected


# ------------------------------------------------------------------------------------------- frames


def test_lines(connect: Connect, serve: Serve) -> None:
    """A client receives the header, every later frame if it keeps up, and the recording's end as
    that of the stream.
    """
    with serve() as server:
        server.put(LINES_PATH, "before")
        assert not server.wait_for_client(0) and not server.has_clients(LINES_PATH)
        client = connect(server)
        for number in range(3):
            server.put(LINES_PATH, f'{{"number":{number}}}')
            assert json.loads(client.recv(timeout=60)) == {"number": number}
        server.put(LINES_PATH, "last")
    assert list(client) == ["last"]
    assert (client.protocol.close_code, client.protocol.close_reason) == (
        1000,
        "the recording has ended",
    )


def test_two_clients(connect: Connect, serve: Serve) -> None:
    with serve() as server:
        one, other = connect(server), connect(server)
        server.put(LINES_PATH, "a")
        assert [client.recv(timeout=60) for client in (one, other)] == ["a", "a"]
        one.close()
        server.put(LINES_PATH, "b")
        assert other.recv(timeout=60) == "b"
        server.put(LINES_PATH, "c")
    assert list(other) == ["c"] and not server.has_clients(LINES_PATH)


def test_a_viewer_gets_the_newest_frame_when_it_asks(connect: Connect, server: LiveServer) -> None:
    """Frames that arrived in between are dropped, and ``put`` does not block."""
    viewer = connect(server, VIEWS_PATH)
    server.put(VIEWS_PATH, b"0")
    assert viewer.recv(timeout=60) == b"0"
    for number in range(1, 100):
        server.put(VIEWS_PATH, b"%d" % number)
    viewer.send("next")
    assert viewer.recv(timeout=60) == b"99"
    viewer.close()


def test_a_slow_program_misses_frames(connect: Connect, server: LiveServer) -> None:
    """A slow client receives some frames in order, and the last one; sending does
    not wait for it.
    """
    count = 300
    size = 1 << 18
    client = connect(server)
    found = [-1]
    for number in range(count):
        server.put(LINES_PATH, f"{number}".rjust(size))
    while found[-1] < count - 1:
        found.append(int(client.recv(timeout=60)))
    assert found == sorted(found) and len(found) < count / 2


def test_a_client_that_leaves_in_the_middle_of_a_frame(connect: Connect, serve: Serve) -> None:
    with serve() as server:
        gone, other = (connect(server, max_size=None) for _ in range(2))
        # close by a reset
        gone.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        server.put(LINES_PATH, "x" * (1 << 20) * 8)
        gone.socket.shutdown(socket.SHUT_RDWR)
        server.put(LINES_PATH, "after")
    assert list(other)[-1] == "after"


# ------------------------------------------------------------------------------------------ the end


def test_a_run_that_is_stopped(connect: Connect, serve: Serve) -> None:
    with contextlib.suppress(KeyboardInterrupt), serve() as server:
        client = connect(server)
        raise KeyboardInterrupt
    assert list(client) == []
    assert (client.protocol.close_code, client.protocol.close_reason) == (
        1001,
        "the tracker was stopped",
    )


def test_a_client_that_does_not_answer_does_not_hold_up_the_end(
    connect: Connect, serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The server ends despite a viewer that requests no next frame, and a client that
    reads nothing.
    """
    monkeypatch.setattr(module, "GRACE_S", 0.05)
    with contextlib.ExitStack() as stack, serve() as server:
        viewer = connect(server, VIEWS_PATH)
        stack.enter_context(reader(server))
        server.put(VIEWS_PATH, b"a")
        server.put(LINES_PATH, "x" * (1 << 25))
        assert viewer.recv(timeout=60) == b"a"
    assert not any(thread.name == "live" for thread in threading.enumerate())


# ----------------------------------------------------------------------------------- access control

UPGRADE = (
    "Upgrade: websocket",
    "Connection: Upgrade",
    "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==",
    "Sec-WebSocket-Version: 13",
)


def request(target: str, *fields: str, method: str = "GET", host: str = "localhost") -> bytes:
    """An HTTP request; TOKEN stands for the server's, and PORT for its port."""
    lines = [f"{method} {target} HTTP/1.1", *([f"Host: {host}"] if host else []), *fields, "", ""]
    return "\r\n".join(lines).encode()


def opening(*fields: str) -> bytes:
    """A request that opens a WebSocket."""
    return request("/frames?token=TOKEN", *UPGRADE, *fields, host="127.0.0.1:PORT")


def asked(server: LiveServer, sent: bytes) -> socket.socket:
    """A connection on which this request was sent."""
    connection = socket.create_connection(("127.0.0.1", server.port), timeout=60)
    connection.sendall(
        sent.replace(b"TOKEN", server.token.encode()).replace(b"PORT", b"%d" % server.port)
    )
    return connection


def reader(server: LiveServer) -> socket.socket:
    """A connection with an open WebSocket, from which nothing more is read."""
    silent = asked(server, opening())
    assert silent.recv(12) == b"HTTP/1.1 101"
    return silent


def exchange(server: LiveServer, sent: bytes) -> bytes:
    """What the server sends for a request: 13 bytes if it opens a WebSocket, otherwise everything
    until it closes.
    """
    with asked(server, sent) as connection:
        received = b""
        with contextlib.suppress(ConnectionError):
            while (piece := connection.recv(1 << 16)) and not received.startswith(b"HTTP/1.1 101"):
                received += piece
        return received


def serves(server: LiveServer) -> None:
    """The page is served to a browser with the token."""
    assert exchange(server, request("/?token=TOKEN")).startswith(b"HTTP/1.1 200")


def a_message_of_10_mb(server: LiveServer, connect: Connect) -> None:
    from websockets.exceptions import ConnectionClosed

    client, other = connect(server), connect(server)
    with contextlib.suppress(ConnectionClosed):  # while it is sent, or with the next message
        client.send("x" * 10_000_000)
        client.recv(timeout=60)
    server.put(LINES_PATH, "after")
    assert other.recv(timeout=60) == "after" and client.protocol.close_code in (1006, 1009)


def half_open_connections(server: LiveServer, connect: Connect) -> None:
    with contextlib.ExitStack() as stack:
        for number in range(300):
            stack.enter_context(asked(server, b"GET / HTTP/1.1\r\nHost: "[: number % 30]))
            if number % 100 == 99:
                serves(server)
        client = connect(server)
        server.put(LINES_PATH, "a")
        assert client.recv(timeout=60) == "a"


def readers_that_never_read(server: LiveServer, connect: Connect) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(80):
            stack.enter_context(reader(server)).setsockopt(
                socket.SOL_SOCKET, socket.SO_RCVBUF, 4096
            )
        client = connect(server)
        for number in range(100):
            server.put(LINES_PATH, f"{number}".rjust(1 << 16))
        while int(client.recv(timeout=60)) < 99:
            pass


# Requests with the statuses of their answers, and clients. A status of 0 is none: what websockets
# takes for no HTTP request is not answered, and versions before 17 answer less.
DEMANDS: dict[str, Any] = {
    "the page": (request("/?token=TOKEN"), 200),
    "no token": (request("/"), 403),
    "an empty token": (request("/?token="), 403),
    "a wrong token": (request("/?token=TOKENx"), 403),
    "no token for frames": (request("/frames"), 403),
    "another encoding": (request("/?token=%ff"), 403),
    "frames": (opening(), 101),
    "frames without a WebSocket": (request("/frames?token=TOKEN"), 426),
    "another host": (request("/?token=TOKEN", host="evil.example"), 403),
    "a host that begins alike": (request("/?token=TOKEN", host="localhost.evil.example"), 403),
    "no host": (request("/?token=TOKEN", host=""), 400),
    "no name": (request("/?token=TOKEN", host="a b"), 400),
    "two hosts": (request("/?token=TOKEN", "Host: localhost"), 400),
    "its own origin": (opening("Origin: http://127.0.0.1:PORT"), 101),
    "another origin": (opening("Origin: http://evil.example"), 403),
    "a null origin": (opening("Origin: null"), 403),
    "another port": (opening("Origin: http://127.0.0.1"), 403),
    "no origin": (opening("Origin: http://["), 400),
    "two origins": (opening("Origin: http://127.0.0.1:PORT", "Origin: http://evil.example"), 403),
    **{
        method: (request("/?token=TOKEN", method=method), (405, 400, 0))
        for method in ("POST", "PUT", "HEAD", "OPTIONS", "DELETE")
    },
    "a body": (
        request("/?token=TOKEN", "Content-Length: 5", method="POST") + b"hello",
        (405, 400, 0),
    ),
    "up": (request("/../server.py?token=TOKEN"), 404),
    "up, escaped": (request("/%2e%2e/server.py?token=TOKEN"), 404),
    "a file": (request("/etc/passwd?token=TOKEN"), 404),
    "no address": (request("//[x?token=TOKEN"), 400),
    "a long address": (request(f"/?token=TOKEN&x={'x' * 10_000}"), (414, 400, 0)),
    "a long field": (request("/?token=TOKEN", f"Cookie: {'x' * 10_000}"), (431, 400, 0)),
    "many fields": (request("/?token=TOKEN", *(f"X-{i}: y" for i in range(200))), (431, 400, 0)),
    "HTTPS": (b"\x16\x03\x01\x02\x00\r\n\r\n", (400, 0)),
    "noise": (b"\xff\r\n\r\n", (400, 0)),
    "HTTP/2": (b"GET / HTTP/2.0\r\n\r\n", (400, 0)),
    "a message of 10 MB": a_message_of_10_mb,
    "300 half-open connections": half_open_connections,
    "80 readers that never read": readers_that_never_read,
}


@pytest.mark.parametrize("demand", DEMANDS)
def test_the_server_withstands_invalid_requests_and_clients(
    demand: str,
    serve: Serve,
    connect: Connect,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After any of them the page is served, and no log has the token."""
    monkeypatch.setattr(module, "GRACE_S", 0.5)
    caplog.set_level(logging.DEBUG)
    with serve() as server:
        if callable(DEMANDS[demand]):
            DEMANDS[demand](server, connect)
        else:
            sent, status = DEMANDS[demand]
            answer = exchange(server, sent)
            assert (int(answer[9:12]) if answer else 0) in (
                status if isinstance(status, tuple) else (status,)
            )
            assert server.token.encode() not in answer or status == 200
        serves(server)
    logged = [
        record.getMessage() for record in caplog.records if record.name != "websockets.client"
    ]
    assert not any(server.token in text for text in (*logged, *capfd.readouterr()))


def test_the_page(server: LiveServer) -> None:
    page = exchange(server, request("/?token=TOKEN")).decode()
    assert "<!DOCTYPE html>" in page and "connect-src 'self'" in page
    assert "Content-Type: text/html; charset=utf-8" in page
    assert "Cache-Control: no-store" in page and "Referrer-Policy: no-referrer" in page
    assert len(server.token) >= 20 and server.token != LiveServer("127.0.0.1", 0, "", "").token
    line = "Wrong token. Open the address that the tracker has printed."
    assert exchange(server, request("/?token=x")).decode().endswith(f"\r\n\r\n{line}\n")
    absent = exchange(server, request("/")).decode()
    assert line in absent and "<script" in absent


@pytest.mark.parametrize(
    ("host", "listening", "named"),
    [
        ("127.0.0.1:80", "127.0.0.1", True),
        ("LOCALHOST:9", "127.0.0.1", True),
        ("[::1]:80", "127.0.0.1", True),
        ("evil.example", "127.0.0.1", False),
        ("localhost.evil.example", "127.0.0.1", False),
        ("192.168.0.7", "127.0.0.1", False),
        ("192.168.0.7", "0.0.0.0", True),
        ("evil.example:80", "0.0.0.0", False),
        (socket.gethostname(), "0.0.0.0", True),
        (socket.gethostname(), "127.0.0.1", False),
        ("Camera.lab:80", "camera.lab", True),
        ("192.168.0.7", "192.168.0.7", True),
        ("192.168.0.8", "192.168.0.7", False),
    ],
)
def test_hosts(host: str, listening: str, named: bool) -> None:
    """A request must name this server: its own address, or any IP address if it listens
    on all of them.
    """
    assert is_named(host, listening) == named


def test_a_token_of_the_user(serve: Serve) -> None:
    """The user can choose the token; a short one raises an error that does not contain it."""
    assert LiveServer("127.0.0.1", 0, "", "", "0123456789abcdef").token == "0123456789abcdef"
    with pytest.raises(NetlibError, match=r"^token: found 5 characters; expected 16 to 200 of A-Z"):
        LiveServer("127.0.0.1", 0, "", "", "guess")


# ---------------------------------------------------------------------------------------- addresses


def test_other_machines(serve: Serve) -> None:
    """Other machines can connect only if requested; then the addresses contain this
    machine's name.
    """
    with serve() as server:
        assert not server.is_public
        assert server.page_url.startswith(f"http://127.0.0.1:{server.port}/?token=")
    with serve("0.0.0.0") as server:
        assert server.is_public
        assert urlsplit(server.page_url).hostname == socket.gethostname().lower()


@pytest.mark.skipif(not socket.has_ipv6, reason="no IPv6")
def test_an_address_of_ipv6(connect: Connect, serve: Serve) -> None:
    try:
        with serve("::1") as server:
            assert not server.is_public
            assert server.lines_url.startswith(f"ws://[::1]:{server.port}/frames?token=")
            connect(server)
    except NetlibError as error:
        pytest.skip(str(error))


def test_a_port_that_is_in_use(serve: Serve, server: LiveServer) -> None:
    line = f"^127.0.0.1:{server.port}: the port is in use; choose another one, or 0 for any that is free$"
    with pytest.raises(NetlibError, match=line), serve(port=server.port):
        pass


@pytest.mark.parametrize(
    ("host", "why"), [("x" * 70, "unknown host"), ("192.0.2.1", "cannot listen: ")]
)
def test_an_address_of_another_machine_is_rejected(serve: Serve, host: str, why: str) -> None:
    with pytest.raises(NetlibError, match=f"^{host}:0: {why}"), serve(host):
        pass


def test_without_websockets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "websockets", None)
    with pytest.raises(NetlibError, match=r"^websockets is missing: pip install 'websockets>=13'$"):
        LiveServer("127.0.0.1", 0, "", "")


def test_the_example_for_programs(tmp_path: Path, serve: Serve) -> None:
    """docs/live.md: the example prints each hand's index fingertip in each frame, and ends with
    the recording.
    """
    text = (ROOT / "docs" / "live.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"<!-- file: watch.py -->\n```python\n(.*?)```", text, re.DOTALL)
    assert len(program.splitlines()) <= 10
    (tmp_path / "watch.py").write_text(program, encoding="utf-8")
    messages = Messages(HEADER)
    with serve() as server:
        (tmp_path / "live.json").write_text(
            json.dumps({"frames": server.lines_url}), encoding="utf-8"
        )
        process = subprocess.Popen(
            [sys.executable, "watch.py"], stdout=subprocess.PIPE, text=True, cwd=tmp_path
        )
        assert server.wait_for_client(60)
        server.put(LINES_PATH, messages.line(messages.record(BOTH)))
    out, _ = process.communicate(timeout=60)
    tip = HEADER.skeleton.joint_names.index("index_tip")
    expected = [
        f"{hand.hand} {[float(mm) for mm in hand.xyz[tip].round(2)]}" for hand in BOTH.hands
    ]
    assert process.returncode == 0 and out.splitlines() == expected
