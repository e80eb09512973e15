"""Two tracked hands, and a server of their track."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from handpose.output.live.messages import Messages
from handpose.output.live.page import page
from handpose.output.live.server import LiveServer
from handpose.tracking.track import TrackedFrame
from tests.support.tracked_hands import HEADER, lost, seen, tracked

RIGHT, LEFT = tracked("right", (-75, 0, 600), 1), tracked("left", (75, 0, 640), 2, 0.42)
DEPTH = seen([RIGHT, LEFT])
BOTH = TrackedFrame(0, 0.0, (RIGHT, LEFT))
ONE = TrackedFrame(1, 0.1, (RIGHT, lost(2, "left", reason="left the image")))


@pytest.fixture
def serve() -> Callable[..., LiveServer]:
    """``serve()`` makes a server at a free port of this machine."""
    pytest.importorskip("websockets")
    return lambda host="127.0.0.1", port=0: LiveServer(
        host, port, Messages(HEADER).header, page(HEADER)
    )


@pytest.fixture
def server(serve: Callable[..., LiveServer]) -> Iterator[LiveServer]:
    """A running server, which is stopped after the test."""
    with serve() as running:
        yield running
