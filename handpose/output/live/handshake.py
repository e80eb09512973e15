"""HTTP requests to the live server: parsing, checks of the host and the origin, and answers.

Everything here is applied before a client has shown its token, so it accepts only what browsers and WebSocket clients
send, and rejects the rest with a status.
"""

from __future__ import annotations

import ipaddress
import re
import socket
from dataclasses import dataclass
from http import HTTPStatus
from urllib.parse import parse_qs, urlsplit

MAX_HEAD = 1 << 15  # bytes of a request; browsers send the cookies of all servers of this host
_LINE = re.compile(rb"[ -~]*")
_REQUEST = re.compile(rb"([!#$%&'*+.^_`|~0-9A-Za-z-]+) ([!-~]+) HTTP/1\.[01]")
_FIELD = re.compile(rb"([!#$%&'*+.^_`|~0-9A-Za-z-]+):[ \t]*([\t -~\x80-\xff]*?)[ \t]*")
_HOST = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(?::\d{1,5})?")
_ANYWHERE = ("", "0.0.0.0", "::")
_LOCALHOST = "localhost"


class RefusedError(Exception):
    """A request that is answered with an error status, and with a text or a page."""

    def __init__(self, status: HTTPStatus, text: str, page: str | None = None) -> None:
        super().__init__(text)
        self.answer = answer(status, f"{text}\n") if page is None else answer(status, page, "text/html")


@dataclass(frozen=True)
class Request:
    """A GET request.

    target   path and query, or a whole URL, as sent
    headers  values of each field, by its name in lower case
    """

    target: str
    headers: dict[str, list[str]]

    @property
    def path(self) -> str:
        """The path of the target. Raises RefusedError."""
        return _split(self.target)[1]

    @property
    def token(self) -> str:
        """The token in the query; empty without one. Raises RefusedError."""
        return parse_qs(_split(self.target)[2]).get("token", [""])[0]

    @property
    def host(self) -> str:
        """The value of the only Host field. Raises RefusedError."""
        hosts = self.headers.get("host", [])
        if len(hosts) != 1 or _HOST.fullmatch(hosts[0]) is None:
            raise RefusedError(HTTPStatus.BAD_REQUEST, "Expected one Host field with a name or an IP address.")
        return hosts[0]

    def is_of_same_site(self) -> bool:
        """False if a page of another host or port has sent it; programs send no origin. Raises RefusedError."""
        return all(_split(origin)[0] == self.host for origin in self.headers.get("origin", []))


def parse(received: bytes) -> Request | None:
    """The request in these first bytes of a connection; None if it is incomplete. Raises RefusedError."""
    lines = received.replace(b"\r\n", b"\n").lstrip(b"\n").split(b"\n")
    begun = lines[0].removesuffix(b"\r") if len(lines) == 1 else lines[0]
    if not _LINE.fullmatch(begun):
        raise RefusedError(HTTPStatus.BAD_REQUEST, "Expected an HTTP request; HTTPS is not supported.")
    match = _REQUEST.fullmatch(begun)
    if len(lines) > 1 and match is None:
        raise RefusedError(HTTPStatus.BAD_REQUEST, "Expected GET, a path and HTTP/1.1.")
    if len(lines) > 1 and match and match[1] != b"GET":
        raise RefusedError(HTTPStatus.METHOD_NOT_ALLOWED, "Expected GET.")
    if match is None or b"" not in lines[1:-1]:
        if len(received) > MAX_HEAD:
            raise RefusedError(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, f"Expected at most {MAX_HEAD} bytes.")
        return None
    headers: dict[str, list[str]] = {}
    for line in lines[1 : lines.index(b"", 1)]:
        field = _FIELD.fullmatch(line)
        if field is None:
            raise RefusedError(HTTPStatus.BAD_REQUEST, "Expected header fields NAME: VALUE.")
        headers.setdefault(field[1].decode().lower(), []).append(field[2].decode("latin-1"))
    return Request(match[2].decode(), headers)


def is_named(host: str, listening: str) -> bool:
    """Whether a request's Host field names this server, which listens at ``listening``.

    A page of another site can give its own name the address of this machine (DNS rebinding), but it cannot change the
    Host field. Ports are not compared, because tunnels change them.
    """
    match = _HOST.fullmatch(host)
    name = match[1].strip("[]").removesuffix(".").lower() if match else ""
    if name in (_LOCALHOST, listening.lower()) or name.endswith(f".{_LOCALHOST}"):
        return True
    try:
        return ipaddress.ip_address(name).is_loopback or listening in _ANYWHERE
    except ValueError:
        own = socket.gethostname().lower()
        return listening in _ANYWHERE and name in (own, f"{own}.local")


def answer(status: HTTPStatus, text: str, kind: str = "text/plain") -> bytes:
    """The bytes of a response that ends the connection."""
    content = text.encode()
    fields = {
        "Content-Type": f"{kind}; charset=utf-8", "Content-Length": str(len(content)), "Connection": "close",
        "Cache-Control": "no-store", "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff",
    }
    if status == HTTPStatus.METHOD_NOT_ALLOWED:
        fields["Allow"] = "GET"
    lines = [f"HTTP/1.1 {status.value} {status.phrase}", *(f"{name}: {value}" for name, value in fields.items())]
    return "\r\n".join([*lines, "", ""]).encode() + content


def _split(url: str) -> tuple[str, str, str]:
    """Host with port, path and query. Raises RefusedError."""
    try:
        parts = urlsplit(url)
        return parts.netloc, parts.path, parts.query
    except ValueError:
        raise RefusedError(HTTPStatus.BAD_REQUEST, "Expected a valid address.") from None
