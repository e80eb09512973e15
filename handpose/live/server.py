"""A server of one track, for browsers and programs. Needs websockets (extra ``live``).

with LiveServer("127.0.0.1", 0, messages.header, page) as server:    # port 0: any that is free
    print(server.page_url, server.lines_url)
    server.put(LINES, line)
    server.put(VIEWS, view)

It answers three paths, each with the query token=TOKEN, which is random:

    /        the page
    /frames  WebSocket: the header, then a text message for each frame
    /view    WebSocket: a binary message for each frame; the client requests the next one by a message of any kind

No frame waits for another one: each client has a slot for the newest frame, which replaces one that was not sent yet.
The page requests each frame, so that none waits in the buffers between them either.

At the end of the block, clients get the last frame, and the connection is closed with a reason in words: with code 1000
at the end of the recording, 1001 when the tracker was stopped.
"""

from __future__ import annotations

import asyncio
import errno
import hmac
import logging
import secrets
import socket
import threading
from http import HTTPStatus
from types import ModuleType, TracebackType
from typing import Any
from urllib.parse import parse_qs, urlencode, urlsplit

from handpose.live.messages import LINES, VIEWS
from netlib.errors import NetlibError, reason_of

GRACE_S = 5.0  # time for clients to receive the last frame and to close
ENDED, STOPPED = (1000, "the recording has ended"), (1001, "the tracker was stopped")
_MAX_RECEIVED = 1024  # maximum bytes of a message from a client
_SEND_BUFFER = 1 << 17  # bytes that the system keeps for a slow client
_LOOPBACK = ("127.0.0.1", "::1", "localhost")


class _Slot:
    """The newest message for one client."""

    def __init__(self) -> None:
        self._message: str | bytes | None = None
        self._ended = False
        self._changed = asyncio.Event()

    def put(self, message: str | bytes) -> None:
        """Replace a message that was not sent."""
        self._message = message
        self._changed.set()

    def end(self) -> None:
        """Mark the end of the messages."""
        self._ended = True
        self._changed.set()

    async def take(self) -> str | bytes | None:
        """Wait for the next message; None after the last one."""
        await self._changed.wait()
        message, self._message = self._message, None
        if not self._ended:
            self._changed.clear()
        return message


class LiveServer:
    """Serves one track in a separate thread, which is ready when the block begins.

    host, port  where it listens; port 0: any that is free
    header      of the track as JSON, the first message to programs
    page        the page as HTML

    Raises NetlibError without websockets, and in ``__enter__`` if it cannot listen there.
    """

    def __init__(self, host: str, port: int, header: str, page: str) -> None:
        self._websockets = _package()
        self.host, self.port, self._header, self._page = host, port, header, page.encode()
        self.token = secrets.token_urlsafe(16)
        self._clients: dict[str, set[_Slot]] = {LINES: set(), VIEWS: set()}
        self._handlers: dict[asyncio.Task[Any], Any] = {}  # with the connection of each
        self._was_asked = threading.Event()
        self._ready = threading.Event()
        self._failure: Exception | None = None

    def __enter__(self) -> LiveServer:
        self._thread = threading.Thread(target=asyncio.run, args=(self._serve(),), name="live", daemon=True)
        self._thread.start()
        self._ready.wait()
        if self._failure is not None:
            self._thread.join()
            raise NetlibError(f"{_joined(self.host, self.port)}: {_why_not(self._failure)}") from self._failure
        return self

    @property
    def page_url(self) -> str:
        """The address for a browser."""
        return f"http://{self._place()}/?{self._query()}"

    @property
    def lines_url(self) -> str:
        """The address for programs."""
        return f"ws://{self._place()}{LINES}?{self._query()}"

    @property
    def is_public(self) -> bool:
        """True if other machines can connect."""
        return self.host not in _LOOPBACK

    def has_clients(self, path: str) -> bool:
        """True if this path has a client; otherwise messages for it are dropped."""
        return bool(self._clients[path])

    def wait_for_client(self, seconds: float) -> bool:
        """Wait for the first client, at most this long; True if one has connected."""
        return self._was_asked.wait(seconds)

    def put(self, path: str, message: str | bytes) -> None:
        """Send the message of a frame to all clients of this path."""
        self._loop.call_soon_threadsafe(self._put, path, message)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._close_with = ENDED if kind is None else STOPPED
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join()

    # ------------------------------------------------------------------------------------- in the thread

    async def _serve(self) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        try:
            server = await self._websockets.asyncio.server.serve(
                self._client, self.host, self.port, process_request=self._answer, compression=None, server_header=None,
                max_size=_MAX_RECEIVED, close_timeout=GRACE_S, logger=_silent_logger(),
            )  # fmt: skip
        except Exception as error:
            self._failure = error
            self._ready.set()
            return
        self.port = server.sockets[0].getsockname()[1]
        self._ready.set()
        await self._end.wait()
        for slots in self._clients.values():
            for slot in slots:
                slot.end()
        if self._handlers:
            _, late = await asyncio.wait(self._handlers, timeout=GRACE_S)
            for handler in late:
                self._handlers[handler].transport.abort()
        server.close()
        await server.wait_closed()

    def _put(self, path: str, message: str | bytes) -> None:
        for slot in self._clients[path]:
            slot.put(message)

    async def _client(self, connection: Any) -> None:
        """Serve one client until it leaves or the track ends."""
        path, slot = urlsplit(connection.request.path).path, _Slot()
        if self._end.is_set():
            slot.end()
        connection.transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        task = asyncio.current_task()
        assert task is not None
        self._handlers[task] = connection
        self._clients[path].add(slot)
        try:
            if path == LINES:
                await connection.send(self._header)
            self._was_asked.set()
            while (message := await slot.take()) is not None:
                await connection.send(message)
                if path == VIEWS:
                    await connection.recv()  # it has the frame and requests the next one
            await connection.close(*self._close_with)
        except self._websockets.exceptions.ConnectionClosed:
            pass
        finally:
            self._clients[path].discard(slot)
            self._handlers.pop(task)

    def _answer(self, connection: Any, request: Any) -> Any:
        """The page, a refusal, or None to continue with a WebSocket."""
        asked = urlsplit(request.path)
        given = parse_qs(asked.query).get("token", [""])[0]
        if not hmac.compare_digest(given.encode(), self.token.encode()):
            return self._response(HTTPStatus.FORBIDDEN, "Wrong token. Open the address that the tracker has printed.")
        if asked.path == "/":
            return self._response(HTTPStatus.OK, self._page, "text/html")
        if asked.path not in self._clients:
            return self._response(HTTPStatus.NOT_FOUND, f"Expected /, {LINES} or {VIEWS}.")
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if any(urlsplit(origin).netloc not in hosts for origin in origins):
            return self._response(HTTPStatus.FORBIDDEN, "Pages of other sites get no frames.")
        return None

    def _response(self, status: HTTPStatus, body: str | bytes, kind: str = "text/plain") -> Any:
        content = body if isinstance(body, bytes) else f"{body}\n".encode()
        headers = self._websockets.datastructures.Headers({
            "Content-Type": f"{kind}; charset=utf-8", "Content-Length": str(len(content)), "Connection": "close",
            "Cache-Control": "no-store", "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff",
        })  # fmt: skip
        return self._websockets.http11.Response(status.value, status.phrase, headers, content)

    def _place(self) -> str:
        """Host and port for other machines."""
        return _joined(socket.gethostname() if self.host in ("", "0.0.0.0", "::") else self.host, self.port)

    def _query(self) -> str:
        return urlencode({"token": self.token})


def _joined(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _why_not(error: Exception) -> str:
    """The reason why a server cannot listen."""
    if isinstance(error, socket.gaierror | UnicodeError):  # no host has a name that cannot be encoded
        return "unknown host"
    if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
        return "the port is in use; choose another one, or 0 for any that is free"
    return f"cannot listen: {reason_of(error)}"


def _silent_logger() -> logging.Logger:
    """A client's error, which is sent to the client."""
    logger = logging.getLogger("handpose.live")
    logger.disabled = True
    return logger


def _package() -> ModuleType:
    """The used parts of websockets, imported on first use."""
    try:
        import websockets
        import websockets.asyncio.server
        import websockets.datastructures
        import websockets.exceptions
        import websockets.http11
    except ImportError as error:
        raise NetlibError("websockets is missing: pip install 'websockets>=13'") from error
    return websockets
