"""What an error says of its cause, and of names that nearly are right."""

from __future__ import annotations

import errno
import os

import pytest

from netlib.errors import NetlibError, did_you_mean, reason_of


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
