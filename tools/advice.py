"""Advice that goes with an error: where the nets of this project find no data, how to make them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from netlib.errors import DataError

ADVICE = (
    "make synthetic hands with 'python tools/make_synthetic.py', or read the NYU data set with "
    "'python tools/prepare_nyu.py NYU_ROOT'"
)


@contextlib.contextmanager
def on_missing_data() -> Iterator[None]:
    """Within it, an error about a list of files that is missing in data/nyu says how to make one."""
    try:
        yield
    except DataError as error:
        text = str(error)
        if "cannot read the list" in text and "data/nyu" in text:
            text = f"{text}; {ADVICE}"
        raise DataError(text) from error
