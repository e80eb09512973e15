"""Frames of a track over UDP, a datagram each."""

from __future__ import annotations

import socket
from types import TracebackType
from typing import Any

from netlib.errors import NetlibError, reason_of


class DatagramSender:
    """Sends datagrams to one address; those that cannot be sent at once are dropped and counted. Raises NetlibError.

    dropped  datagrams that were not sent
    reason   of the last failure
    """

    def __init__(self, address: tuple[str, int]) -> None:
        host, port = address
        self._name = f"{host}:{port}"
        self.dropped, self.reason = 0, ""
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        except (OSError, UnicodeError):  # no host has a name that cannot be encoded
            raise NetlibError(f"{self._name}: unknown host") from None
        self._kind: tuple[int, int, int] = found[0][:3]
        self._address: Any = found[0][4]

    def __enter__(self) -> DatagramSender:
        try:
            self._socket = socket.socket(*self._kind)
        except OSError as error:
            raise NetlibError(f"{self._name}: cannot send: {reason_of(error)}") from error
        self._socket.setblocking(False)
        return self

    def send(self, datagram: bytes) -> None:
        """Send a datagram."""
        try:
            self._socket.sendto(datagram, self._address)
        except OSError as error:
            self.dropped, self.reason = self.dropped + 1, reason_of(error)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._socket.close()
