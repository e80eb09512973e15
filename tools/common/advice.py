"""Advice about the next command, added to errors and results."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from netlib.errors import DataError
from netlib.files.paths import command

ADVICE = (
    f"generate synthetic hands with '{command('make_synthetic')}', or read the NYU data set with "
    f"'{command('prepare_nyu')} NYU_ROOT'"
)


@contextlib.contextmanager
def on_missing_data() -> Iterator[None]:
    """Context manager that adds advice to errors about missing lists in data/nyu."""
    try:
        yield
    except DataError as error:
        text = str(error)
        if "cannot read the list" in text and "data/nyu" in text:
            text = f"{text}; {ADVICE}"
        raise DataError(text) from error
