"""Error messages: causes, and suggestions for misspelt names."""

from __future__ import annotations

import errno
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from netlib.errors import NetlibError, PrototxtError, did_you_mean, printable, reason_of

# including surrogates, for bytes that are not UTF-8
ANY_TEXT = st.text(st.characters(exclude_categories=()))


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
    assert reason_of(error) == reason


def test_the_nearest_name() -> None:
    assert (
        did_you_mean("Convolutoin", ["Convolution", "Pooling"]) == " (did you mean 'Convolution'?)"
    )
    assert did_you_mean("abc", ["Convolution"]) == ""
    assert (
        did_you_mean("batchnorm_param", ["batch_norm_param"])
        == " (did you mean 'batch_norm_param'?)"
    )


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("filter_param", "interp_param"),
        ("annotated_data_param", "image_data_param"),
        ("new_dim", "new_width"),
    ],
)
def test_options_of_forks_are_not_taken_for_misspellings(name: str, other: str) -> None:
    """Parts that many names have do not make two options similar; a wrong hint would hide the list
    of known names.
    """
    assert did_you_mean(name, [other]) == ""


def test_a_message_is_one_line() -> None:
    assert str(NetlibError("unknown bottom 'a\n\rb'")) == "unknown bottom 'a\\n\\rb'"


@given(ANY_TEXT)
def test_an_error_can_be_shown_whatever_it_names(name: str) -> None:
    """A message is printable on one line, without terminal control codes or marks that change the
    writing direction.
    """
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
def test_unprintable_characters_are_escaped(text: str, shown: str) -> None:
    assert printable(text) == shown
