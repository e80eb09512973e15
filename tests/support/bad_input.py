"""Tables of bad input: a row is what is given and the line of the error that it causes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import pytest


def whole_line(line: str) -> str:
    """Return the regular expression of a line in which ``...`` stands for any text,
    as in doctest.
    """
    return rf"\A{'.*'.join(re.escape(part) for part in line.split('...'))}\Z"


def bad_inputs(
    error: type[Exception], rows: Mapping[str, str | tuple[Any, ...]]
) -> pytest.MarkDecorator:
    """Parametrize a test by ``given`` and ``rejected``, a context that requires the
    error of the row.

    rows  {id: (given, line)}, {id: (given, error, line)} for another class of errors, or {given:
          line}. The error's message is the line, in which ``...`` stands for any text
    """
    params = []
    for name, row in rows.items():
        given, *others, line = (name, row) if isinstance(row, str) else row
        rejected = pytest.raises(others[0] if others else error, match=whole_line(line))
        params.append(pytest.param(given, rejected, id=name))
    return pytest.mark.parametrize(("given", "rejected"), params)
