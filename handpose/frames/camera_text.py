"""Plain values of the texts in which programs write the parameters of a camera.

A text is JSON, a table of numbers, or lines: the YAML in which programs write parameters, keys and
values in sections, and what Python, NumPy, pyrealsense2 and pyorbbecsdk print.
"""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from handpose.frames.camera_keys import is_known
from netlib.errors import DataError

# Parts of patterns
NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
# in any brackets, as print writes them
NUMBERS = rf"[\[\](),;\s]*{NUMBER}(?:[\[\](),;\s]+{NUMBER})*[\[\](),;\s]*"
KEY = r"""("[^"]+"|'[^']+'|(?<!\w)[A-Za-z_][\w./ \t]{0,60}?(?:\([^)]*\))?)\s*"""
TEXT = r"""("[^"]*"|'[^']*'|(?![^,;]*[:=])[^\s\[{"'!,;][^,;{}\[\]<>()]*)"""

# The beginnings of texts of each form
TABLE = re.compile(NUMBERS)
JSON = re.compile(r'\s*(\{\s*["}]|\[\s*[\[{"]|$)')
PYTHON = re.compile(r"\s*\{'")  # a dictionary as Python prints it
XML = re.compile(r"\s*<([?!]|\w+>)")

# What lines contain. KEY: VALUE or KEY = VALUE; a line may have several
PAIR = re.compile(rf"{KEY}[:=]\s*(?:(?:array)?({NUMBERS})(?![\w.])|{TEXT})")
# KEY VALUE, or KEY, VALUE: a whole line
COLUMNS = re.compile(rf"^\s*{KEY}(?:[\s,]\s*({NUMBERS})(?:px|pixels)?|,\s*{TEXT})\s*$")
NAME_EDGES = " \t<({[]\"'"  # characters around the name of a section

COMMENT = re.compile(r"(?:^|(?<=\s))#.*|^%.*")
DASH = re.compile(r"(?<!\S)-(?!\S)")  # of an element of a list
PRODUCT = re.compile(r"(?<=\d)[ \t]*x[ \t]*(?=\d)")  # 64x48
# [ 64x48  p[31.5 23.5]  f[60 61]  Brown Conrady [0 0 0 0 0] ]
PYREALSENSE = re.compile(
    rf"\[\s*({NUMBER})\s*x\s*({NUMBER})"
    rf"\s+p\[({NUMBER}) ({NUMBER})\]\s+f\[({NUMBER}) ({NUMBER})\]"
    r"\s+([\w ]+?) *\[([^\]]*)\]\s*\]"
)
PYREALSENSE_KEYS = (
    r" width: \1, height: \2, u0: \3, v0: \4, fx: \5, fy: \6, model: \7, coefficients: [\8]"
)
# <OBCameraIntrinsic fx=60 fy=61 ...>
PYORBBECSDK = re.compile(r"^([<\t ]*\w+) (?=\w+[:=].*[:=])")
# a line of numbers, or one that begins with them in brackets, continues the one before
CONTINUATION = re.compile(r"[\[(]+[ \t]*[-+.\d]|[-+.\d][-+\d.eE,;\t \])]*$")
END_OF_DOCUMENT = ("---", "...")


def parse_document(text: str, where: str) -> Any:
    """The value of a text whose form is recognised by its content: of a table the list of its
    numbers, otherwise an object. Raises DataError.

    where  begins errors
    """
    plain = _plain(text)
    if TABLE.fullmatch(plain):
        return value_of(f"[{plain}]")
    if JSON.match(text):
        return parse_json(text, where)
    if PYTHON.match(text):
        with contextlib.suppress(DataError):
            return parse_json(text.replace("'", '"'), where)
    if XML.match(text):
        expected = "expected JSON or YAML, which OpenCV's FileStorage writes, too"
        raise DataError(f"{where}: XML; {expected}")
    return _parse_lines(plain, where)


def parse_json(text: str, where: str) -> Any:
    """The value of a JSON text without repeated keys. Raises DataError."""

    def object_of(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for key, value in pairs:
            if key in values:
                raise DataError(f"{where}: has {key!r} twice")
            values[key] = value
        return values

    try:
        return json.loads(text, object_pairs_hook=object_of)
    except RecursionError:
        raise DataError(f"{where}: JSON of too many levels") from None
    # The text is cut, or an integer has thousands of digits.
    except ValueError as error:
        raise DataError(f"{where}: not whole JSON: {error}") from None


def _plain(text: str) -> str:
    """The first document of a text, each list of numbers in one line."""
    first = DASH.sub(" ", "\n".join(_first_document(text)))
    lines: list[str] = []
    for line in PYREALSENSE.sub(PYREALSENSE_KEYS, first).split("\n"):
        stripped = line.lstrip(" \t")
        if lines and CONTINUATION.match(stripped):
            lines[-1] += f" {stripped}"
        else:
            lines.append(PYORBBECSDK.sub(r"\1: ", line))
    return PRODUCT.sub(", ", "\n".join(lines))


def _first_document(text: str) -> Iterator[str]:
    """The lines of the first of several YAML documents, without comments and blank lines."""
    is_begun = False
    for line in text.split("\n"):
        line = COMMENT.sub("", line).rstrip()
        if line in END_OF_DOCUMENT and is_begun:
            return
        if line and line != "---":
            is_begun = True
            yield line


class _Item(NamedTuple):
    """A name in a line, and its value; None for a name without one, such as that of a section."""

    column: int  # -1 for a section, which contains all lines up to the next one
    name: str
    value: Any


def _parse_lines(text: str, where: str) -> dict[str, Any]:
    """The keys and values in lines. Raises DataError for a known key given twice.

    A name without a value is the key of an object: of the items that begin in a later column.
    Spaces are added to the keys of objects of the same name.
    """
    document: dict[str, Any] = {}
    # For each item that may contain the next one: its column, the object that it is in, its key.
    open_items = [(-2, {"": document}, "")]
    for item in _items(text):
        while open_items[-1][0] >= item.column:
            open_items.pop()
        _, parent, parent_key = open_items[-1]
        if parent[parent_key] is None:
            parent[parent_key] = {}
        if isinstance(parent[parent_key], dict):
            parent = parent[parent_key]
        key = item.name
        while key in parent:
            if item.value is not None and is_known(item.name):
                raise DataError(f"{where}: has {item.name!r} twice")
            key += " "
        parent[key] = item.value
        open_items.append((item.column, parent, key))
    if not document:
        raise DataError(f"{where}: not the parameters of a camera")
    return document


def _items(text: str) -> Iterator[_Item]:
    """The items of each line: the name before all keys, if there is one; then keys and values."""
    for line in text.splitlines():
        pairs = list(PAIR.finditer(line)) or list(COLUMNS.finditer(line))
        head = line[: pairs[0].start(1)] if pairs else line
        name = re.split("[:=]", head)[0].strip(NAME_EDGES)
        if name and not TABLE.fullmatch(name):
            indent = len(head) - len(head.lstrip())
            yield _Item(-1 if head.startswith("[") else indent, name, None)
        for pair in pairs:
            yield _Item(pair.start(1), pair[1].strip("\"'"), value_of(pair[2] or pair[3]))


def value_of(text: str) -> Any:
    """A number, the list of several numbers or of those in brackets, or a text. A size such as
    640x480 is two numbers.
    """
    text = PRODUCT.sub(", ", text)
    if not TABLE.fullmatch(text):
        return text.strip(" \t\"'")
    numbers = [float(number) for number in re.findall(NUMBER, text)]
    return numbers if len(numbers) > 1 or "[" in text else numbers[0]
