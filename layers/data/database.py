"""Databases (LMDB) to be read: by the layer Data, and by tools. Each entry is a Datum (datum.py)."""

from __future__ import annotations

import weakref
from pathlib import Path
from typing import Any

from netlib.errors import DataError, reason_of

# The databases in use, by their file: LMDB may open each only once in a process, and several nets may read it.
_open: weakref.WeakValueDictionary[tuple[int, int], Any] = weakref.WeakValueDictionary()


def open_database(path: Path) -> Any:
    """An ``lmdb.Environment``. Raises DataError; ImportError without the package lmdb."""
    import lmdb

    try:
        file = path / "data.mdb" if path.is_dir() else path
        status = file.stat()
        key = (status.st_dev, status.st_ino)
        database = _open.get(key)
        if database is None:
            database = lmdb.open(str(path), subdir=path.is_dir(), readonly=True, lock=False)
            _open[key] = database
        used = database.stat()
    except (OSError, ValueError, lmdb.Error) as error:
        reason = reason_of(error).removeprefix(f"{path}: ")  # LMDB begins its messages with the path
        raise DataError(f"{path}: cannot open the database: {reason}") from error
    # To read what is gone would kill the process. A whole file may lack pages that were never used, so those that
    # hold something are counted, and two at the beginning.
    pages = 2 + used["branch_pages"] + used["leaf_pages"] + used["overflow_pages"]
    needed = pages * used["psize"]
    if status.st_size < needed:
        raise DataError(f"{file}: truncated: it has {status.st_size} bytes, expected at least {needed}")
    return database
