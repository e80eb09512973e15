"""handpose/output/live/datagrams.py"""

from __future__ import annotations

import socket

import pytest

from handpose.output.live.datagrams import DatagramSender
from netlib.errors import NetlibError


def test_a_datagram_per_frame() -> None:
    """Each datagram arrives as it was sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(60)
        with DatagramSender(receiver.getsockname()) as sender:
            for text in (b"one", b"two"):
                sender.send(text)
                assert receiver.recv(100) == text
        assert sender.dropped == 0


def test_nobody_receives() -> None:
    """Without a receiver nothing is reported and no error is raised."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        address = taken.getsockname()
    with DatagramSender(address) as sender:
        for _ in range(3):
            sender.send(b"frame")
    assert sender.dropped == 0


def test_what_the_system_does_not_send() -> None:
    """A datagram that the system rejects is counted as dropped, with the reason."""
    with DatagramSender(("127.0.0.1", 9)) as sender:
        sender.send(bytes(1 << 17))
    assert (sender.dropped, sender.reason) == (1, "Message too long")


def test_an_unknown_host() -> None:
    """An unknown host raises an error at construction."""
    with pytest.raises(NetlibError, match=r"^x{70}:9: unknown host$"):
        DatagramSender(("x" * 70, 9))
