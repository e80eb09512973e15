"""Tables of figures: rows with named cells, which are empty where there is no figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from tools.common.console import aligned


def tabulated(rows: Sequence[Mapping[str, str]]) -> str:
    """The rows as a table, with the names of their cells as heading."""
    names = dict.fromkeys(name for row in rows for name in row)
    return aligned([[*names], *([row.get(name, "") for name in names] for row in rows)])


def figure(form: str, value: float) -> str:
    """The text of a figure; empty for NaN."""
    return "" if np.isnan(value) else form.format(value)


def mean(form: str, values: ArrayLike) -> str:
    """The text of the mean of some values; empty without any."""
    numbers = np.asarray(values)
    return form.format(numbers.mean()) if numbers.size else ""
