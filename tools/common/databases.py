"""Caffe's databases, read entry by entry, and written whole or not at all. They are LMDB; every entry is a Datum."""

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

FIRST_SIZE = 1 << 26  # bytes that a database may have before it is made larger
ENTRIES, BYTES = 1000, 1 << 26  # whichever comes first is written in one transaction


def backend(text: str) -> str:
    """The backend of a database on the command line."""
    if text.lower() == "lmdb":
        return "lmdb"
    if text.lower() == "leveldb":
        raise argparse.ArgumentTypeError("leveldb is not supported; use lmdb, and in the net backend: LMDB")
    raise argparse.ArgumentTypeError(f"expected lmdb, found {text!r}")


def read_database(path: str | Path) -> tuple[int, Iterator[tuple[str, bytes]]]:
    """The number of entries, and all of them in the order of their keys: what to call each, and its bytes.

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
    """The package, which writes. Raises NetlibError."""
    try:
        import lmdb
    except ImportError:
        raise NetlibError("to write a database takes the package lmdb; install it: pip install lmdb") from None
    return lmdb


class Writer:
    """Writes entries to a new database.

    entries  how many there are
    """

    def __init__(self, lmdb: Any, folder: Path, check: Callable[[], None]) -> None:
        self._lmdb, self._check, self.entries = lmdb, check, 0
        self._waiting: list[tuple[bytes, bytes]] = []
        self._bytes = 0  # that wait
        self._database = lmdb.open(str(folder), map_size=FIRST_SIZE)

    def put(self, key: str, datum: Datum) -> None:
        """Add an entry. Raises StoppedError if a signal asked to stop, DataError if the key is too long."""
        self._check()
        name, value = key.encode("utf-8", "surrogateescape"), wire.encode(schema.to_tree(datum), Datum)
        if len(name) > self._database.max_key_size():
            raise DataError(f"the key {key!r} is too long; a database takes {self._database.max_key_size()} bytes")
        self._waiting.append((name, value))
        self._bytes += len(value)
        self.entries += 1
        if len(self._waiting) == ENTRIES or self._bytes > BYTES:
            self._commit()

    def _commit(self) -> None:
        """Write what waits; where the room is too small, make it larger and begin again."""
        while self._waiting:
            try:
                with self._database.begin(write=True) as change:
                    for key, value in self._waiting:
                        change.put(key, value)
                self._waiting, self._bytes = [], 0
            except self._lmdb.MapFullError:
                self._database.set_mapsize(2 * self._database.info()["map_size"])

    def close(self, whole: bool) -> None:
        """Write the rest if all of it is to be kept, and close."""
        try:
            if whole:
                self._commit()
        finally:
            self._database.close()


def write_databases(paths: Sequence[Path], fill: Callable[[Sequence[Writer]], object]) -> int:
    """Have new databases filled: afterwards all are there, or none. Returns the exit status: 0, 130 or 143.

    They are written under other names and renamed in the end. Raises NetlibError, also for a name that is taken.
    """
    lmdb = _lmdb()
    places = [os.path.realpath(path) for path in paths]
    for path, place in zip(paths, places):
        if path.exists() or places.count(place) > 1:
            what = "is there already" if path.exists() else "is named twice"
            raise NetlibError(f"{path}: {what}; a new database needs a name of its own")
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
    """Fill databases in these folders; returns how many entries each has."""
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
