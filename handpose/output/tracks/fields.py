"""Typed access to fields of JSON objects from untrusted files; errors name the field and the
expected value.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterator, Sequence
from typing import Any, TypeVar

import numpy as np

from netlib.blob import Array
from netlib.errors import DataError

MAX_MAGNITUDE = 1e12  # maximum of a number; sums and products of larger ones may overflow
MIN_POSITIVE = 1e-6  # smaller numbers are no lengths, in px or mm

T = TypeVar("T", bound=str)


class Fields:
    """An object's fields. Every method raises DataError, which names the place and the field."""

    def __init__(self, value: Any, where: str) -> None:
        self.where = where
        if not isinstance(value, dict):
            raise DataError(f"{where}: found {reprlib.repr(value)}, expected an object")
        self._values: dict[str, Any] = value

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def has(self, name: str) -> bool:
        """True unless the field is null."""
        return self._value(name) is not None

    def part(self, name: str) -> Fields:
        """The field is an object."""
        return Fields(self._value(name), f"{self.where}: {name!r}")

    def parts(self, name: str) -> Iterator[Fields]:
        """The field is a list of objects."""
        for i, value in enumerate(self._checked(name, list, "a list")):
            yield Fields(value, f"{self.where}: {name!r} {i}")

    def text(self, name: str) -> str:
        """The field is a text."""
        return self._checked(name, str, "a text")

    def one_of(self, name: str, words: Sequence[T]) -> T:
        """The field is one of these words."""
        for word in words:
            if self._value(name) == word:
                return word
        raise self._wrong(name, " or ".join(map(repr, words)))

    def truth(self, name: str) -> bool:
        """The field is true or false."""
        return self._checked(name, bool, "true or false")

    def whole(self, name: str) -> int:
        """The field is a whole number of at least 0."""
        value = self._value(name)
        if type(value) is not int or not 0 <= value <= MAX_MAGNITUDE:
            raise self._wrong(name, "a whole number of at least 0")
        return value

    def number(self, name: str, least: float = -math.inf, most: float = math.inf) -> float:
        """The field is a number from ``least`` to ``most``."""
        value = float(self.numbers(name))
        if not least <= value <= most:
            upper = f", at most {most:g}" if most < math.inf else ""
            raise self._wrong(name, f"a number of at least {least:g}{upper}")
        return value

    def known(self, name: str) -> float:
        """The field is a number, or null, which is NaN."""
        return math.nan if self._value(name) is None else self.number(name)

    def positive(self, name: str) -> float:
        """The field is a number above ``MIN_POSITIVE``."""
        value = self.number(name)
        if value <= MIN_POSITIVE:
            raise self._wrong(name, f"a number above {MIN_POSITIVE:g}")
        return value

    def numbers(self, name: str, *shape: int) -> Array:
        """The field is an array of this shape: lists of lists of numbers."""
        expected = f"{' x '.join(map(str, shape))} numbers" if shape else "a number"
        flat = [self._value(name)]
        for size in shape:
            if not all(isinstance(row, list) and len(row) == size for row in flat):
                raise self._wrong(name, expected)
            flat = [item for row in flat for item in row]
        if not all(map(_is_number, flat)):
            raise self._wrong(name, expected)
        return np.array(flat, dtype=np.float64).reshape(shape)

    def _value(self, name: str) -> Any:
        if name not in self._values:
            raise DataError(f"{self.where}: there is no {name!r}")
        return self._values[name]

    def _checked(self, name: str, kind: type, expected: str) -> Any:
        value = self._value(name)
        if not isinstance(value, kind):
            raise self._wrong(name, expected)
        return value

    def _wrong(self, name: str, expected: str) -> DataError:
        return DataError(
            f"{self.where}: {name!r} is {reprlib.repr(self._value(name))}, expected {expected}"
        )


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and -MAX_MAGNITUDE <= value <= MAX_MAGNITUDE  # NaN is not
