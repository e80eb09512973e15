"""Plain values of the texts in which programs write the parameters of a camera.

A text is JSON, a table of numbers, or lines: the YAML in which programs write parameters, keys and
values in sections, and what Python, NumPy, pyrealsense2 and pyorbbecsdk print.
"""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Iterator
from typing import Any

from handpose.frames.camera_keys import is_known
from netlib.errors import DataError

NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
# in any brackets, as print writes them
NUMBERS = rf"[\[\](),;\s]*{NUMBER}(?:[\[\](),;\s]+{NUMBER})*[\[\](),;\s]*"
KEY = r"""("[^"]+"|'[^']+'|(?<!\w)[A-Za-z_][\w./ \t]{0,60}?(?:\([^)]*\))?)\s*"""
TEXT = r"""("[^"]*"|'[^']*'|(?![^,;]*[:=])[^\s\[{"'!,;][^,;{}\[\]<>()]*)"""
TABLE = re.compile(NUMBERS)
# KEY: VALUE or KEY = VALUE; a line may have several
PAIR = re.compile(rf"{KEY}[:=]\s*(?:(?:array)?({NUMBERS})(?![\w.])|{TEXT})")
# KEY VALUE, or KEY, VALUE: a whole line
COLUMNS = re.compile(rf"^\s*{KEY}(?:[\s,]\s*({NUMBERS})(?:px|pixels)?|,\s*{TEXT})\s*$")
JSON = re.compile(r'\s*(\{\s*["}]|\[\s*[\[{"]|$)')
PYTHON = re.compile(r"\s*\{'")  # a dictionary as Python prints it
XML = re.compile(r"\s*<(\?xml|opencv)")
EDGES = " \t<({[]\"'"  # of a name

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
    """The value of a text, which its content decides: of a table the list of its numbers.

    ``where`` begins errors.

    Raises DataError.
    """
    plain = _plain(text)
    if TABLE.fullmatch(plain):
        return _value(f"[{plain}]")
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

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in pairs:
            if key in found:
                raise DataError(f"{where}: has {key!r} twice")
            found[key] = value
        return found

    try:
        return json.loads(text, object_pairs_hook=unique)
    except RecursionError:
        raise DataError(f"{where}: JSON of too many levels") from None
    # of a text that is cut, or of integers of thousands of digits
    except ValueError as error:
        raise DataError(f"{where}: not whole JSON: {error}") from None


def _plain(text: str) -> str:
    """The first document of a text, with numbers in the line that they continue."""
    plain = DASH.sub(" ", "\n".join(_first_document(text)))
    plain = PYREALSENSE.sub(PYREALSENSE_KEYS, plain)
    lines: list[str] = []
    for line in plain.split("\n"):
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


def _parse_lines(text: str, where: str) -> dict[str, Any]:
    """The keys and values in lines. Raises DataError for a known key given twice.

    A name without a value is that of the object of what begins in a later column, or of all lines
    of a section. Blocks of the same name differ by spaces.
    """
    document: dict[str, Any] = {}
    # the items around the next one: the column and the object of each, and its key there
    around = [(-2, {"": document}, "")]
    for column, name, value in _items(text):
        while around[-1][0] >= column:
            around.pop()
        _, inside, key = around[-1]
        above = inside[key]
        if above is None:
            above = inside[key] = {}
        if isinstance(above, dict):
            inside = above
        key = name
        while key in inside:
            if value is not None and is_known(name):
                raise DataError(f"{where}: has {name!r} twice")
            key += " "
        inside[key] = value
        around.append((column, inside, key))
    if not document:
        raise DataError(f"{where}: not the parameters of a camera")
    return document


def _items(text: str) -> Iterator[tuple[int, str, Any]]:
    """The column, name and value of what is in each line: a section or another name, with None;
    keys with their values, after the name before them.
    """
    for line in text.splitlines():
        found = list(PAIR.finditer(line)) or list(COLUMNS.finditer(line))
        head = line[: found[0].start(1)] if found else line
        name = re.split("[:=]", head)[0].strip(EDGES)
        if name and not TABLE.fullmatch(name):
            yield -1 if head.startswith("[") else len(head) - len(head.lstrip()), name, None
        for pair in found:
            yield pair.start(1), pair[1].strip("\"'"), _value(pair[2] or pair[3])


def _value(text: str) -> Any:
    """A number, the list of several numbers or of those in brackets, or a text."""
    if not TABLE.fullmatch(text):
        return text.strip(" \t\"'")
    numbers = [float(number) for number in re.findall(NUMBER, text)]
    return numbers if len(numbers) > 1 or "[" in text else numbers[0]
