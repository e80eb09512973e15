"""Live output of a track to browsers and programs, for the options --serve and --udp."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, TextIO

import numpy as np
from numpy.typing import NDArray

from handpose import Recording
from handpose.output.live.datagrams import DatagramSender
from handpose.output.live.messages import LINES, VIEWS, Messages
from handpose.tracking.track import TrackedFrame, TrackHeader
from netlib.errors import NetlibError, reason_of
from netlib.files import atomic
from tools.common.console import say

if TYPE_CHECKING:
    from handpose.output.live.server import LiveServer

TOKEN = "HANDPOSE_TOKEN"  # environment variable
_CHECK_S = 0.1  # interval between checks for a request to stop


class LiveOutput:
    """Sends the frames of a track to the clients of a server and as datagrams. Raises NetlibError."""

    def __init__(self, args: argparse.Namespace, header: TrackHeader, live: bool = False) -> None:
        self._messages = Messages(header, args.joints, args.gestures)
        self._server = self._server_at(args.serve, header, live) if args.serve else None
        self._sender = DatagramSender(args.udp) if args.udp else None
        self._addresses = Path(args.addresses) if args.addresses else None
        self._stack = contextlib.ExitStack()
        self._check: Callable[[], None] = lambda: None
        self._begun: float | None = None  # start by time.perf_counter; None for a live camera
        self._before = 0.0  # time of the frame before

    def __enter__(self) -> LiveOutput:
        with contextlib.ExitStack() as stack:
            for output in (self._server, self._sender):
                if output is not None:
                    stack.enter_context(output)
            if self._server is not None and self._addresses is not None:
                stack.enter_context(_written(self._addresses, self._server))
            self._stack = stack.pop_all()
        return self

    def begin(self, recording: Recording, check: Callable[[], None], file: TextIO | None) -> None:
        """Print the addresses; wait for the first client unless the source is a live camera."""
        self._check = check
        if self._server is not None:
            say(f"page: {self._server.page_url}", file=file)
            say(f"for programs: {self._server.lines_url}", file=file)
            if self._server.is_public:
                say("warning: other machines can watch, if they have these addresses", file=sys.stderr)
            if not recording.live:
                say("waiting for the first connection; Ctrl-C stops", file=file)
            print(end="", file=file, flush=True)  # not file.flush(): it is None if a shell closed standard output
            while not recording.live and not self._server.wait_for_client(_CHECK_S):
                check()
        if not recording.live:
            self._begun = time.perf_counter()

    def write(self, depth: NDArray[np.floating], frame: TrackedFrame) -> None:
        """Send a frame; frames of a recording are sent in real time, and wait while a page holds it."""
        self._hold()
        self._wait_until(frame.time)
        server, sender = self._server, self._sender
        has_lines, has_views = (server is not None and server.has_clients(path) for path in (LINES, VIEWS))
        if not (has_lines or has_views or sender):
            return
        record = self._messages.record(frame)
        if server is not None and has_lines:
            server.put(LINES, self._messages.line(record))
        if server is not None and has_views:
            server.put(VIEWS, self._messages.view(record, depth, frame))
        if sender is not None:
            sender.send(self._messages.datagram(record))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, where)
        if self._sender is not None and self._sender.dropped:
            say(f"warning: --udp: {self._sender.dropped} datagrams were not sent: {self._sender.reason}",
                file=sys.stderr)

    def _server_at(self, address: tuple[str, int], header: TrackHeader, live: bool) -> LiveServer:
        from handpose.output.live.page import page
        from handpose.output.live.server import (  # imports asyncio, which other runs do not need
            LiveServer,
            checked_token,
        )

        host, port = address
        token = checked_token(os.environ[TOKEN], TOKEN) if TOKEN in os.environ else None
        return LiveServer(host, port, self._messages.header, page(header, live), token)

    def _hold(self) -> None:
        if self._begun is None or self._server is None:
            return
        held = time.perf_counter()
        while not self._server.pace.wait(_CHECK_S):
            self._check()
        self._begun += time.perf_counter() - held

    def _wait_until(self, seconds: float) -> None:
        if self._begun is None:
            return
        # At most as long as from the frame before, whatever the clock says: it may stand still, or have been set back.
        early, self._before = min(self._begun + seconds - time.perf_counter(), seconds - self._before), seconds
        while early > 0:
            pause = min(early, _CHECK_S)
            time.sleep(pause)
            self._check()
            early = min(early - pause, self._begun + seconds - time.perf_counter())


@contextlib.contextmanager
def _written(path: Path, server: LiveServer) -> Iterator[None]:
    """A file with the addresses of a server within the block. Raises NetlibError."""
    addresses = {"page": server.page_url, "frames": server.lines_url, "token": server.token}
    try:
        with atomic.replacing(path) as fresh:
            fresh.chmod(0o600)
            fresh.write_text(json.dumps(addresses, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise NetlibError(f"{path}: cannot write the addresses: {reason_of(error)}") from error
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
