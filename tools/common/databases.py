"""Reading Caffe's databases and writing them atomically. They are in LMDB's format; every entry is a Datum."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from layers.data.lmdb_file import Cursor, Database
from netlib.errors import DataError, NetlibError, reason_of
from netlib.files import atomic
from netlib.proto import schema, wire
from netlib.proto.messages import Datum
from tools.common.console import DONE, say
from tools.common.stopper import StoppedError, Stopper

INITIAL_SIZE = 1 << 26  # bytes of a new database before it is enlarged
ENTRIES, BYTES = 1000, 1 << 26  # limits of one transaction


def backend(text: str) -> str:
    """Parse the backend of a database."""
    if text.lower() == "lmdb":
        return "lmdb"
    if text.lower() == "leveldb":
        raise argparse.ArgumentTypeError("leveldb is not supported; use lmdb, and backend: LMDB in the net")
    raise argparse.ArgumentTypeError(f"expected lmdb, found {text!r}")


def read_database(path: str | Path) -> tuple[int, Iterator[tuple[str, bytes]]]:
    """Return the number of entries, and an iterator over their descriptions and bytes in the order of keys.

    Raises DataError.
    """
    database = Database(Path(path))
    if not database.entries:
        raise DataError(f"{path}: the database has no entries")
    return database.entries, _entries(Cursor(database), path)


def _entries(cursor: Cursor, path: str | Path) -> Iterator[tuple[str, bytes]]:
    there = cursor.first()
    while there:
        yield f"{path}: entry {cursor.key.decode(errors='backslashreplace')!r}", cursor.value()
        there = cursor.next()


def _lmdb() -> Any:
    """Import the package lmdb, used for writing. Raises NetlibError."""
    try:
        import lmdb
    except ImportError:
        raise NetlibError("writing a database needs the package lmdb: pip install lmdb") from None
    return lmdb


class Writer:
    """Writes entries to a new database.

    entries  number of entries so far
    """

    def __init__(self, lmdb: Any, folder: Path, check: Callable[[], None]) -> None:
        self._lmdb, self._check, self.entries = lmdb, check, 0
        self._waiting: list[tuple[bytes, bytes]] = []
        self._bytes = 0  # size of the values in ``_waiting``
        self._database = lmdb.open(str(folder), map_size=INITIAL_SIZE)

    def put(self, key: str, datum: Datum) -> None:
        """Add an entry. Raises StoppedError after a signal, DataError if the key is too long."""
        self._check()
        name, value = key.encode("utf-8", "surrogateescape"), wire.encode(schema.to_tree(datum), Datum)
        if len(name) > self._database.max_key_size():
            raise DataError(f"the key {key!r} is too long; the limit is {self._database.max_key_size()} bytes")
        self._waiting.append((name, value))
        self._bytes += len(value)
        self.entries += 1
        if len(self._waiting) == ENTRIES or self._bytes > BYTES:
            self._commit()

    def _commit(self) -> None:
        """Write the waiting entries; if the database is full, enlarge it and retry."""
        while self._waiting:
            try:
                with self._database.begin(write=True) as change:
                    for key, value in self._waiting:
                        change.put(key, value)
                self._waiting, self._bytes = [], 0
            except self._lmdb.MapFullError:
                self._database.set_mapsize(2 * self._database.info()["map_size"])

    def close(self, whole: bool) -> None:
        """Close the database, after writing the remaining entries if it is to be kept."""
        try:
            if whole:
                self._commit()
        finally:
            self._database.close()


def write_databases(paths: Sequence[Path], fill: Callable[[Sequence[Writer]], object]) -> int:
    """Create databases that ``fill`` writes: all, or none. Returns the exit status: 0, 130 or 143.

    They are written under temporary names and renamed at the end. Raises NetlibError, also if a name exists.
    """
    lmdb = _lmdb()
    places = [os.path.realpath(path) for path in paths]
    for path, place in zip(paths, places):
        if path.exists() or places.count(place) > 1:
            what = "exists already" if path.exists() else "is named twice"
            raise NetlibError(f"{path}: {what}; expected a new name for each database")
    try:
        with contextlib.ExitStack() as stack, Stopper() as stopper:
            for path in paths:
                path.parent.mkdir(parents=True, exist_ok=True)
            folders = [stack.enter_context(atomic.temporary_folder(path)) for path in paths]
            counts = _write(lmdb, folders, fill, stopper.check)
            for folder, path, count in zip(folders, paths, counts):
                folder.rename(path)
                atomic.sync_directory(path.parent)
                say(f"{path}: {count} entries")
    except StoppedError:
        print("stopped; no database was written", file=sys.stderr)
        return 128 + stopper.signum
    except lmdb.Error as error:
        raise DataError(f"{paths[0]}: cannot write the database: {reason_of(error)}") from error
    return DONE


def _write(
    lmdb: Any, folders: Sequence[Path], fill: Callable[[Sequence[Writer]], object], check: Callable[[], None]
) -> list[int]:
    """Fill databases in these folders; returns their numbers of entries."""
    writers: list[Writer] = []
    whole = False
    try:
        for folder in folders:
            writers.append(Writer(lmdb, folder, check))
        fill(writers)
        whole = True
    finally:
        for writer in writers:
            writer.close(whole)
    return [writer.entries for writer in writers]
