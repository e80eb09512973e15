"""handpose/frames/json_fields.py: one-line errors for invalid JSON and invalid fields."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from handpose.frames.json_fields import Fields, parsed
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs


def fields() -> Fields:
    """An object with one field of each kind."""
    return Fields(
        {"n": 3, "x": -1.5, "no": None, "yes": True, "t": "text", "a": [[1, 2], [3, 4]], "o": {"b": 1}, "l": [{}]}, "f"
    )


def test_values() -> None:
    """Values are returned as in the file; null becomes NaN where a value may be unknown."""
    of = fields()
    assert (of.whole("n"), of.number("x"), of.truth("yes"), of.text("t")) == (3, -1.5, True, "text")
    assert of.numbers("a", 2, 2).tolist() == [[1, 2], [3, 4]] and of.part("o").whole("b") == 1
    assert len(list(of.parts("l"))) == 1 and math.isnan(of.known("no")) and of.known("x") == -1.5
    assert "n" in of and "m" not in of and of.positive("n") == 3


@bad_inputs(DataError, {
    line: (ask, line) for ask, line in (
        (lambda of: of.whole("m"), "f: there is no 'm'"),
        (lambda of: of.whole("x"), "f: 'x' is -1.5, expected a whole number"),
        (lambda of: of.whole("yes"), "f: 'yes' is True, expected a whole number of at least 0"),
        (lambda of: of.whole("n", 4), "f: 'n' is 3, expected a whole number of at least 4"),
        (lambda of: of.number("x", 0), "f: 'x' is -1.5, expected a number of at least 0"),
        (lambda of: of.number("n", 0, 1), "f: 'n' is 3, expected a number of at least 0, at most 1"),
        (lambda of: of.number("t"), "f: 't' is 'text', expected a number"),
        (lambda of: of.positive("x"), "f: 'x' is -1.5, expected a number above 0"),
        (lambda of: of.numbers("a", 3, 2), "f: 'a' is [[1, 2], [3, 4]], expected 3 x 2 numbers"),
        (lambda of: of.part("o").part("b"), "f: 'o': 'b': found 1, expected an object"),
        (lambda of: list(of.parts("t")), "f: 't' is 'text', expected a list"))
})
def test_what_is_not_what_it_should_be(given: Callable[[Fields], object], rejected: Any) -> None:
    """The error names the place, the field, what was found and what was expected."""
    with rejected:
        given(fields())


@bad_inputs(DataError, {
    "cut": ("{", "f: not whole JSON: ..."),
    "deep": ("[" * 100_000, "f: JSON of too many levels"),
    "twice": ('{"a": 1, "b": {"c": 1, "c": 2}}', "f: has 'c' twice"),
    "long": ("1" * 5000, "f: not whole JSON: ..."),
})
def test_what_is_no_json(given: str, rejected: Any) -> None:
    with rejected:
        parsed(given, "f")
