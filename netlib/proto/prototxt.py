"""Parser and printer of protocol buffers' text format. It knows the grammar but no field names.

    text   = { field }
    field  = name [ ":" ] message(s) | name ":" value     then an optional "," or ";"
    message= "{" text "}" | "<" text ">"
    value  = scalar | "[" value { "," value } "]"
    scalar = one or more adjacent strings | number | word (an enum, true, inf ...)

Every node stores its line and column for error messages.
Reference: "Text Format Language Specification" of Protocol Buffers.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from numpy.typing import NDArray

from netlib import files
from netlib.errors import NetlibError, PrototxtError
from netlib.files.paths import find

# deeper than any net; keeps a malicious file from exceeding Python's recursion limit
MAX_DEPTH = 100


@dataclass(frozen=True)
class Place:
    """A place in a file; ``str(place)`` formats it for messages."""

    source: str


@dataclass(frozen=True)
class Position(Place):
    """A place in a text: line and column, both counted from 1."""

    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.source}:{self.line}:{self.column}"


@dataclass(frozen=True)
class Scalar:
    """A value without fields. ``text`` is the decoded string, or the literal as written."""

    kind: Literal["string", "number", "word"]
    text: str
    position: Place = field(compare=False)

    def __str__(self) -> str:
        return _quote(self.text) if self.kind == "string" else self.text

    def integer(self) -> int | None:
        """The value as a decimal, hexadecimal or octal number of 64 bits; None if it is not one."""
        text = self.text.lower()
        digits = text.removeprefix("-")
        base = 10
        if digits.startswith("0") and len(digits) > 1:
            base = 16 if digits.startswith("0x") else 8
        try:
            number = int(text, base)
        except ValueError:
            return None
        return number if -(2**63) <= number < 2**64 else None

    def truth(self) -> bool | None:
        """The value as true or false, or 1 or 0; None if it is neither."""
        if self.text in ("true", "t", "True"):
            return True
        if self.text in ("false", "f", "False"):
            return False
        number = self.integer()
        return bool(number) if number in (0, 1) else None


class Bytes(Scalar):
    """A string of a binary file that need not be text, such as an image; decoded on access."""

    content: bytes

    def __init__(self, content: bytes, position: Place) -> None:
        vars(self).update(kind="string", content=content, position=position)

    @functools.cached_property
    def text(self) -> str:
        """The content decoded as UTF-8; invalid bytes become surrogates."""
        return self.content.decode("utf-8", "surrogateescape")


@dataclass(frozen=True, eq=False)
class Numbers:
    """Many values of one field in an array, as read from binary files (netlib/proto/wire.py)."""

    array: NDArray[Any]
    position: Place


@dataclass(frozen=True)
class Unknown:
    """A field of a binary file that its message does not define, as encoded: key and value.

    As in protobuf, it is written to binary files unchanged, and not to text.
    """

    encoded: bytes


@dataclass(frozen=True)
class Field:
    """One ``name: value``.

    A repeated field is several fields with the same name; an unknown field has no name.

    ``number`` is that in its binary file, if it is not the number in the declaration
    of its message.
    """

    name: str
    value: Scalar | Numbers | Message | Unknown
    position: Place = field(compare=False)
    number: int | None = field(default=None, compare=False)


@dataclass
class Message:
    """An ordered list of fields: the content of a pair of braces or of a whole file."""

    fields: list[Field]
    position: Place = field(compare=False)

    def __str__(self) -> str:
        return "".join(_lines(self, ""))

    def values(self, name: str) -> list[Scalar | Numbers | Message]:
        """The values of all fields called ``name``, in the order of the file."""
        return [f.value for f in self.fields if f.name == name and not isinstance(f.value, Unknown)]

    def text(self, name: str) -> str:
        """The text of the last scalar called ``name``; empty if there is none."""
        last = self.scalar(name)
        return "" if last is None else last.text

    def truth(self, name: str) -> bool | None:
        """The last scalar called ``name`` as true or false; None if there is none, or a number."""
        last = self.scalar(name)
        return None if last is None else last.truth()

    def scalar(self, name: str) -> Scalar | None:
        """The last scalar called ``name``; None if there is none."""
        scalars = [value for value in self.values(name) if isinstance(value, Scalar)]
        return scalars[-1] if scalars else None

    def named(self, *names: str) -> list[Field]:
        """The fields with one of these names, in the order of the file."""
        return [f for f in self.fields if f.name in names]

    def without(self, *names: str) -> Message:
        """The message without the fields with one of these names."""
        return Message([f for f in self.fields if f.name not in names], self.position)

    def unknown(self) -> list[Field]:
        """The fields that the message does not define, from a binary file."""
        return [f for f in self.fields if isinstance(f.value, Unknown)]


def _lines(message: Message, indent: str) -> Iterator[str]:
    for item in message.fields:
        if isinstance(item.value, Message):
            yield f"{indent}{item.name} {{\n"
            yield from _lines(item.value, indent + "  ")
            yield f"{indent}}}\n"
        elif isinstance(item.value, Numbers):
            yield from (f"{indent}{item.name}: {number}\n" for number in item.value.array)
        elif isinstance(item.value, Scalar):
            yield f"{indent}{item.name}: {item.value}\n"


def parse_file(path: str | Path) -> Message:
    """Parse a file. Raises NetlibError if it cannot be read, PrototxtError if it is not valid.

    Files of this project are found from any working directory by a name such as
    ``prototxt/x.prototxt``.
    """
    path = find(str(path), None)
    if str(path).endswith((".caffemodel", ".caffemodel.h5")):
        raise NetlibError(
            f"{path}: found weights, expected a .prototxt; a net stands before its weights"
        )
    # As in Caffe, comments and strings can have any bytes.
    return parse(files.read_text(path, "the prototxt", NetlibError, "surrogateescape"), str(path))


def parse(text: str, source: str = "<text>") -> Message:
    """Parse a string; ``source`` is the file name used in positions. Raises PrototxtError."""
    return _Parser(text.removeprefix("\ufeff"), source).file()


# ------------------------------------------------------------------------------------------- tokens

_TOKEN = re.compile(
    r"""(?P<skip>[ \t\r\n\f\v]+|\#[^\n]*)
      | (?P<number>-?[ \t]*(?:0[xX][0-9a-fA-F]+|(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?[fF]?)(?![\w.]))
      | (?P<word>-?[A-Za-z_]\w*)
      | (?P<string>"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*')
      | (?P<mark>[{}<>\[\]:,;])""",
    re.VERBOSE,
)

_SIMPLE_ESCAPES = {
    "n": 10,
    "r": 13,
    "t": 9,
    "a": 7,
    "b": 8,
    "f": 12,
    "v": 11,
    "\\": 92,
    "'": 39,
    '"': 34,
    "?": 63,
}
_ESCAPE = re.compile(
    r"\\(?:([0-7]{1,3})|[xX]([0-9a-fA-F]{1,2})|u([0-9a-fA-F]{4})|U([0-9a-fA-F]{8})|(.))", re.DOTALL
)


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    position: Position


def _tokens(text: str, source: str) -> Iterator[_Token]:
    offset, line, line_start = 0, 1, 0
    while offset < len(text):
        position = Position(source, line, offset - line_start + 1)
        match = _TOKEN.match(text, offset)
        if match is None:
            raise PrototxtError(position, _lexical_fault(text[offset:].split("\n", 1)[0]))
        kind = str(match.lastgroup)
        found = match.group()
        if kind != "skip":
            yield _Token(kind, found, position)
        if "\n" in found:
            line += found.count("\n")
            line_start = offset + found.rindex("\n") + 1
        offset = match.end()
    yield _Token("end", "", Position(source, line, offset - line_start + 1))


def _lexical_fault(rest: str) -> str:
    if rest[0] in "\"'":
        return "string without a closing quote on this line"
    if rest[0].isdigit() or rest[0] in "-.":
        return f"malformed number {rest.split()[0]!r}"
    if "\udc80" <= rest[0] <= "\udcff":  # a byte that is not UTF-8, as surrogateescape decodes it
        return f"not a text file (byte {ord(rest[0]) - 0xDC00:#x} is not UTF-8)"
    return f"unexpected character {rest[0]!r}"


def _unquote(token: _Token) -> bytes:
    def replace(match: re.Match[str]) -> str:
        octal, hexa, short, long, simple = match.groups()
        if octal or hexa:
            return chr(int(octal, 8) & 255 if octal else int(hexa, 16))
        if short or long:
            code = int(short or long, 16)
            if code > 0x10FFFF or 0xD800 <= code <= 0xDFFF:
                raise PrototxtError(token.position, f"escape {match.group()} is not a character")
            return chr(code).encode("utf-8").decode("latin-1")
        if simple not in _SIMPLE_ESCAPES:
            raise PrototxtError(token.position, f"unknown escape '\\{simple}' in a string")
        return chr(_SIMPLE_ESCAPES[simple])

    # Escapes denote bytes, other characters denote themselves; in latin-1 both are one unit.
    return _ESCAPE.sub(
        replace, token.text[1:-1].encode("utf-8", "surrogateescape").decode("latin-1")
    ).encode("latin-1")


def _quote(text: str) -> str:
    named = {"\\": "\\\\", '"': '\\"', "\n": "\\n", "\r": "\\r", "\t": "\\t"}
    return (
        '"' + "".join(named.get(c, c if c.isprintable() else _escape_bytes(c)) for c in text) + '"'
    )


def _escape_bytes(character: str) -> str:
    # surrogateescape: the undecodable bytes of a file's name; other surrogates come
    # from callers only
    errors = "surrogateescape" if "\udc80" <= character <= "\udcff" else "surrogatepass"
    return "".join(f"\\{byte:03o}" for byte in character.encode("utf-8", errors))


# ------------------------------------------------------------------------------------------ grammar


class _Parser:
    def __init__(self, text: str, source: str) -> None:
        self.start = Position(source, 1, 1)
        self.tokens = _tokens(text, source)
        self.token = next(self.tokens)
        self.depth = 0

    def fail(self, expected: str) -> PrototxtError:
        found = "the end of the file" if self.token.kind == "end" else repr(self.token.text)
        return PrototxtError(self.token.position, f"expected {expected}, found {found}")

    def take(self) -> _Token:
        token = self.token
        self.token = next(self.tokens)
        return token

    def at(self, marks: str) -> bool:
        return self.token.kind == "mark" and self.token.text in marks

    def file(self) -> Message:
        fields = self.fields()
        if self.token.kind != "end":
            raise self.fail("a field name")
        return Message(fields, self.start)

    def fields(self) -> list[Field]:
        fields: list[Field] = []
        while self.token.kind == "word" and not self.token.text.startswith("-"):
            fields += self.field()
            if self.at(",;"):
                self.take()
        return fields

    def field(self) -> list[Field]:
        """Parse one field as written; a list gives one Field per element."""
        name = self.take()
        colon = self.at(":")
        if colon:
            self.take()
        elif not self.at("{<["):
            raise self.fail(f"':' or '{{' after {name.text!r}")
        if not self.at("["):
            return [Field(name.text, self.value(), name.position)]
        self.take()
        fields: list[Field] = []
        while not self.at("]"):
            position = self.token.position
            if not colon and not self.at("{<"):  # the colon is optional only for messages
                raise self.fail(f"'{{' in a list without ':' after {name.text!r}")
            fields.append(Field(name.text, self.value(), position))
            if not self.at(","):
                break
            self.take()
            if self.at("]"):
                raise self.fail("a value")
        self.close("]")
        return fields

    def value(self) -> Scalar | Message:
        if self.at("{<"):
            return self.message()
        token = self.token
        if token.kind == "string":
            return self.string()
        if token.kind in ("number", "word"):
            self.take()
            return Scalar(
                "number" if token.kind == "number" else "word",
                "".join(token.text.split()),
                token.position,
            )
        raise self.fail("a value")

    def string(self) -> Scalar:
        position = self.token.position
        parts: list[bytes] = []
        while self.token.kind == "string":
            parts.append(_unquote(self.take()))
        return Scalar("string", b"".join(parts).decode("utf-8", "surrogateescape"), position)

    def message(self) -> Message:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise PrototxtError(
                self.token.position, f"messages are nested more than {MAX_DEPTH} deep"
            )
        opening = self.take()
        fields = self.fields()
        self.close("}" if opening.text == "{" else ">", opening.position)
        self.depth -= 1
        return Message(fields, opening.position)

    def close(self, mark: str, opened: Position | None = None) -> None:
        if not self.at(mark):
            where = f" (opened at line {opened.line})" if opened else ""
            raise self.fail(f"a field name or {mark!r}{where}" if opened else f"',' or {mark!r}")
        self.take()
