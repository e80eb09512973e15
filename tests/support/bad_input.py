"""Tables of bad input: a row is what is given and the line of the error that it causes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.support.tables import pairs_of


def whole_line(line: str) -> str:
    """Return the regular expression of a line in which ``...`` stands for any text,
    as in doctest.
    """
    return rf"\A{'.*'.join(re.escape(part) for part in line.split('...'))}\Z"


def in_table(table: Path, before: str = "") -> dict[str, tuple[Any, str]]:
    """Return the rows of a file, for ``bad_inputs``: what is given, and the line, which follows
    ``before``. Several fields are given as a tuple, and ``\\n`` is a line end.
    """
    rows = {}
    for fields, line in pairs_of(table):
        given = tuple(field.replace(r"\n", "\n") for field in fields)
        rows[" -> ".join(fields)] = given if len(given) > 1 else given[0], before + line
    return rows


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
