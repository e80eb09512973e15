"""What an error says of its cause, and of names that nearly are right."""

from __future__ import annotations

import errno
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from netlib.errors import NetlibError, PrototxtError, did_you_mean, printable, reason_of

ANY_TEXT = st.text(st.characters(exclude_categories=()))  # surrogates, too: bytes of a file that are no UTF-8


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), "No space left on device"),
        (OSError("unable to open\n  the file"), "unable to open the file"),
        (
            OSError(
                "Unable to synchronously create (file = 'a', errno = 28, error message = 'No space left', buf = 0x5)"
            ),
            "No space left",
        ),
        (UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"), "not a text file"),
        (ValueError("a number"), "a number"),
        (EOFError(), "EOFError"),
    ],
)
def test_reasons_are_one_line(error: Exception, reason: str) -> None:
    """Without numbers and addresses."""
    assert reason_of(error) == reason


def test_the_nearest_name() -> None:
    """Or nothing, if none is near."""
    assert did_you_mean("Convolutoin", ["Convolution", "Pooling"]) == " (did you mean 'Convolution'?)"
    assert did_you_mean("abc", ["Convolution"]) == ""


def test_a_message_is_one_line() -> None:
    """Whatever the names in it hold."""
    assert str(NetlibError("unknown bottom 'a\n\rb'")) == "unknown bottom 'a\\n\\rb'"


@given(ANY_TEXT)
def test_an_error_can_be_shown_whatever_it_names(name: str) -> None:
    """On one line, without commands to the terminal or marks that turn the direction of writing."""
    assert str(NetlibError(f"no layer {name}")).isprintable()
    assert str(PrototxtError(f"{name}:1:2", name)).isprintable()
    assert printable(printable(name)) == printable(name)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Größe 手 λ², a\\b", "Größe 手 λ², a\\b"),
        ("a\n\x1b[2Jb", "a\\n\\x1b[2Jb"),
        ("\u202egnp.exe", "\\u202egnp.exe"),
        ("\udcff\u2028\x7f", "\\udcff\\u2028\\x7f"),
    ],
    ids=ascii,
)
def test_what_is_escaped(text: str, shown: str) -> None:
    """Letters of all languages are not; what no font has a picture of is, as in Python's repr."""
    assert printable(text) == shown


def test_a_message_of_any_length_is_a_line_that_can_be_read() -> None:
    """Its begin, which says where, and its end, which says what to do."""
    found = str(NetlibError(f"net.prototxt:1:7: unknown layer type '{'x' * 150_000}'; known types: ..."))
    assert len(found) < 2000
    assert found.startswith("net.prototxt:1:7: unknown layer type 'xxx")
    assert " ... (150057 characters) ... xxx" in found
    assert len(str(NetlibError("\0" * 1900))) <= 2000  # each is shown as four characters
    assert found.endswith("x'; known types: ...")
