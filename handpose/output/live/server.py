"""A server of one track, for browsers and programs. Needs websockets (extra ``live``).

with LiveServer("127.0.0.1", 0, messages.header, page) as server:    # port 0: any that is free
    print(server.page_url, server.lines_url)
    server.put(LINES_PATH, line)
    server.put(VIEWS_PATH, view)

It answers three paths, each with the query token=TOKEN, which is random:

    /        the page
    /frames  WebSocket: the header, then a text message for each frame
    /view    WebSocket: a binary message for each frame; the client requests the next one
             by any message

No frame waits for another one: each client has a queue of one frame, where the newest
replaces one that was not sent. The page requests each frame, so that none waits in the
buffers between them either.

A connection must show the token within HANDSHAKE_S. What is no HTTP request is refused by
websockets, the rest by ``_answer``, before a WebSocket is opened.

At the end of the block, clients get the last frame, and the connection is closed with a reason in
words: with code 1000 at the end of the recording, 1001 when the tracker was stopped.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import functools
import hmac
import ipaddress
import itertools
import logging
import re
import secrets
import socket
import threading
from concurrent.futures import Future
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, urlsplit

from handpose.output.live.messages import LINES_PATH, VIEWS_PATH
from handpose.output.live.page import page_without_token
from netlib.errors import NetlibError, reason_of

HANDSHAKE_S = 5.0  # time for a connection to show the token
GRACE_S = 4.0  # time for clients to receive the last frame and to close
CLOSE_S = 0.5  # time for the server to close
ENDED, STOPPED = (1000, "the recording has ended"), (1001, "the tracker was stopped")
_MAX_RECEIVED = 1024  # maximum bytes of a message from a client
_SEND_BUFFER = 1 << 17  # bytes that the system keeps for a slow client
_TOKEN = re.compile(r"[A-Za-z0-9_-]{16,200}")
_LOOPBACK = ("127.0.0.1", "::1", "localhost")
_ANYWHERE = ("", "0.0.0.0", "::")
_HOST = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(?::\d{1,5})?")
_FIELDS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
_SILENT = logging.getLogger("handpose.output.live")
_SILENT.disabled = True  # a client's error is sent to the client
# the newest message for one client; None ends its messages
_Newest = asyncio.Queue[str | bytes | None]


class LiveServer:
    """Serves one track in a separate thread, which is ready when the block begins.

    host, port  where it listens; port 0: any that is free
    header      of the track as JSON, the first message to programs
    page        the page as HTML
    token       that clients must have; by default a random one

    Raises NetlibError without websockets and for a short token, and in ``__enter__`` if it
    cannot listen there.
    """

    def __init__(
        self, host: str, port: int, header: str, page: str, token: str | None = None
    ) -> None:
        try:
            import websockets.asyncio.server  # here, because it is an extra
            import websockets.exceptions
        except ImportError as error:
            raise NetlibError("websockets is missing: pip install 'websockets>=13'") from error
        self._websockets = websockets
        self.host, self.port, self._header, self._page = host, port, header, page
        self.token = secrets.token_urlsafe(16) if token is None else checked_token(token)
        self._clients: dict[str, set[_Newest]] = {LINES_PATH: set(), VIEWS_PATH: set()}
        self._handlers: dict[asyncio.Task[Any], Any] = {}  # with the connection of each
        self._has_client = threading.Event()
        self._ready: Future[None] = Future()

    def __enter__(self) -> LiveServer:
        self._thread = threading.Thread(target=self._run, name="live", daemon=True)
        self._thread.start()
        try:
            self._ready.result()
        except Exception as error:
            self._thread.join()
            raise NetlibError(f"{_joined(self.host, self.port)}: {_why_not(error)}") from error
        return self

    @property
    def page_url(self) -> str:
        """The address for a browser."""
        return self._address("http", "/")

    @property
    def lines_url(self) -> str:
        """The address for programs."""
        return self._address("ws", LINES_PATH)

    @property
    def is_public(self) -> bool:
        """True if other machines can connect."""
        return self.host not in _LOOPBACK

    def has_clients(self, path: str) -> bool:
        """True if this path has a client; otherwise messages for it are dropped."""
        return bool(self._clients[path])

    def wait_for_client(self, seconds: float) -> bool:
        """Wait for the first client, at most this long; True if one has connected."""
        return self._has_client.wait(seconds)

    def put(self, path: str, message: str | bytes) -> None:
        """Send the message of a frame to all clients of this path."""
        self._loop.call_soon_threadsafe(self._put, path, message)

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        self._close_with = ENDED if kind is None else STOPPED
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join()

    # -------------------------------------------------------------------------------- in the thread

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:
            if self._ready.done():
                raise
            self._ready.set_exception(error)

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._end = asyncio.Event()
        self._loop.set_exception_handler(_ignore_connection_errors)
        server = await self._websockets.asyncio.server.serve(
            self._client,
            self.host,
            self.port,
            process_request=self._answer,
            compression=None,
            server_header=None,
            max_size=_MAX_RECEIVED,
            open_timeout=HANDSHAKE_S,
            close_timeout=GRACE_S,
            logger=_SILENT,
        )
        self.port = server.sockets[0].getsockname()[1]
        self._ready.set_result(None)
        await self._end.wait()
        for queue in itertools.chain(*self._clients.values()):
            queue.put_nowait(None)
        if self._handlers:
            await asyncio.wait(self._handlers, timeout=GRACE_S)
        server.close()
        for connection in self._handlers.values():
            connection.transport.abort()
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(server.wait_closed(), CLOSE_S)

    def _put(self, path: str, message: str | bytes) -> None:
        for queue in self._clients[path]:
            while not queue.empty():
                queue.get_nowait()
            queue.put_nowait(message)

    async def _client(self, connection: Any) -> None:
        """Serve one client until it leaves or the track ends."""
        path = urlsplit(connection.request.path).path
        queue = _Newest()
        if self._end.is_set():
            queue.put_nowait(None)
        connection.transport.get_extra_info("socket").setsockopt(
            socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER
        )
        task = asyncio.current_task()
        assert task is not None
        self._handlers[task] = connection
        self._clients[path].add(queue)
        try:
            if path == LINES_PATH:
                await connection.send(self._header)
            self._has_client.set()
            while (message := await queue.get()) is not None:
                await connection.send(message)
                if path == VIEWS_PATH:
                    await connection.recv()  # it has the frame, and requests the next one
            await connection.close(*self._close_with)
        except self._websockets.exceptions.ConnectionClosed:
            pass
        finally:
            self._clients[path].discard(queue)
            self._handlers.pop(task)

    def _answer(self, connection: Any, request: Any) -> Any:
        """The response to a request: the page, a refusal, or None to open a WebSocket."""
        refused = functools.partial(_response, connection)
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        try:
            url = urlsplit(request.path)
            sites = [urlsplit(origin).netloc for origin in origins]
        except ValueError:
            return refused(HTTPStatus.BAD_REQUEST, "Expected a valid address.\n")
        # websockets before version 17 refuses others itself
        if getattr(request, "method", "GET") != "GET":
            return refused(HTTPStatus.METHOD_NOT_ALLOWED, "Expected GET.\n")
        if len(hosts) != 1 or _HOST.fullmatch(hosts[0]) is None:
            return refused(
                HTTPStatus.BAD_REQUEST, "Expected one Host field with a name or an IP address.\n"
            )
        if not is_named(hosts[0], self.host):
            return refused(
                HTTPStatus.FORBIDDEN, "Wrong host. Open the address that the tracker has printed.\n"
            )
        token = parse_qs(url.query).get("token", [""])[0]
        if not hmac.compare_digest(token.encode(), self.token.encode()):
            if url.path == "/" and not token:
                return _response(
                    connection, HTTPStatus.FORBIDDEN, page_without_token(), "text/html"
                )
            return refused(
                HTTPStatus.FORBIDDEN,
                "Wrong token. Open the address that the tracker has printed.\n",
            )
        if url.path == "/":
            return _response(connection, HTTPStatus.OK, self._page, "text/html")
        if url.path not in self._clients:
            return refused(HTTPStatus.NOT_FOUND, f"Expected /, {LINES_PATH} or {VIEWS_PATH}.\n")
        if any(site != hosts[0] for site in sites):  # programs send no origin
            return refused(HTTPStatus.FORBIDDEN, "Pages of other sites get no frames.\n")
        return None

    def _address(self, scheme: str, path: str) -> str:
        """The address of a path; it has the name of this machine if the server listens at all of
        its addresses.
        """
        host = socket.gethostname() if self.host in _ANYWHERE else self.host
        return f"{scheme}://{_joined(host, self.port)}{path}?token={self.token}"


def is_named(host: str, listening: str) -> bool:
    """Whether a request's Host field names this server, which listens at ``listening``.

    A page of another site can give its own name the address of this machine (DNS rebinding), but it
    cannot change the Host field. Ports are not compared, because tunnels change them.
    """
    match = _HOST.fullmatch(host)
    name = match[1].strip("[]").removesuffix(".").lower() if match else ""
    if name in ("localhost", listening.lower()) or name.endswith(".localhost"):
        return True
    try:
        return ipaddress.ip_address(name).is_loopback or listening in _ANYWHERE
    except ValueError:
        own = socket.gethostname().lower()
        return listening in _ANYWHERE and name in (own, f"{own}.local")


def _response(connection: Any, status: HTTPStatus, text: str, kind: str = "text/plain") -> Any:
    """An HTTP response that ends the connection."""
    response = connection.respond(status, text)
    del response.headers["Content-Type"]
    response.headers["Content-Type"] = f"{kind}; charset=utf-8"
    for name, value in _FIELDS.items():
        response.headers[name] = value
    return response


def checked_token(token: str, where: str = "token") -> str:
    """The token.

    Raises NetlibError, without the token itself, for one that could be guessed or is no
    part of a URL.
    """
    if _TOKEN.fullmatch(token) is None:
        raise NetlibError(
            f"{where}: found {len(token)} characters; expected 16 to 200 of A-Z, a-z, 0-9, - and _"
        )
    return token


def _joined(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _why_not(error: Exception) -> str:
    """The reason why a server cannot listen."""
    # no host has a name that cannot be encoded
    if isinstance(error, socket.gaierror | UnicodeError):
        return "unknown host"
    if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
        return "the port is in use; choose another one, or 0 for any that is free"
    return f"cannot listen: {reason_of(error)}"


def _ignore_connection_errors(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Handle an exception outside of all tasks; errors of the system concern one connection,
    which is closed.
    """
    if not isinstance(context.get("exception"), OSError):
        loop.default_exception_handler(context)
