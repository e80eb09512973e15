"""tools/common/databases.py: databases are written completely or not at all."""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

from layers.data.images import decode_datum
from netlib.errors import DataError, NetlibError
from netlib.proto.messages import Datum
from tests.support.bad_input import bad_inputs
from tools.common import databases
from tools.common.databases import read_database, write_databases


def put(count: int, label: int = 0):
    """Return a function that writes ``count`` entries of 4 x 5 pixels to each database."""

    def fill(writers):
        for writer in writers:
            for i in range(count):
                writer.put(f"{i:04d}", Datum(1, 4, 5, bytes(range(i, i + 20)), label))

    return fill


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_what_is_written_is_read(tmp_path, capsys):
    """Entries are read in the order of their keys, as they were written."""
    assert write_databases([tmp_path / "a", tmp_path / "deep" / "b"], put(3, label=-7)) == 0
    for path in (tmp_path / "a", tmp_path / "deep" / "b"):
        count, entries = read_database(path)
        found = list(entries)
        assert count == 3
        assert [what for what, _ in found] == [f"{path}: entry '000{i}'" for i in range(3)]
        image, label = decode_datum(found[2][1], None, "")
        assert (image.ravel() == np.arange(2, 22)).all() and label == -7
    assert capsys.readouterr().out == f"{tmp_path}/a: 3 entries\n{tmp_path}/deep/b: 3 entries\n"


@pytest.mark.parametrize(("entries", "size"), [(1, 1 << 26), (4, 1 << 26), (1000, 60)])
def test_many_transactions_in_a_room_that_grows(tmp_path, monkeypatch, entries, size):
    """The initial size of an LMDB database is doubled until all entries fit."""
    monkeypatch.setattr(databases, "ENTRIES", entries)
    monkeypatch.setattr(databases, "BYTES", size)
    monkeypatch.setattr(databases, "INITIAL_SIZE", 1 << 15)

    def fill(writers):
        for i in range(10):
            writers[0].put(f"{i}", Datum(1, 100, 100, bytes(10_000), i))

    assert write_databases([tmp_path / "a"], fill) == 0
    count, found = read_database(tmp_path / "a")
    assert [decode_datum(value, None, "")[1] for _, value in found] == list(range(10)) and count == 10


@pytest.mark.parametrize("error", [DataError("bad"), OSError("disk"), KeyboardInterrupt()])
def test_a_failure_leaves_nothing(tmp_path, error):
    """A failure leaves no database and no other file."""

    def fill(writers):
        put(2)(writers)
        raise error

    with pytest.raises(type(error)):
        write_databases([tmp_path / "a", tmp_path / "b"], fill)
    assert names(tmp_path) == []


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_leaves_nothing(tmp_path, capsys, number, status):
    """A signal ends the run at the next entry and leaves no database."""

    def fill(writers):
        put(2)(writers)
        signal.raise_signal(number)
        put(2)(writers)

    assert write_databases([tmp_path / "a"], fill) == status
    assert names(tmp_path) == []
    assert capsys.readouterr() == ("", "stopped; no database was written\n")


NEW = "expected a new name for each database"


@bad_inputs(NetlibError, {
    "there": (lambda at: write_databases([at / "b", at / "a"], put(1)), f".../a: exists already; {NEW}"),
    "twice": (lambda at: write_databases([at / "b", at / "b"], put(1)), f".../b: is named twice; {NEW}"),
    "twice, by another name": (lambda at: write_databases([at / "b", at / "sub" / ".." / "b"], put(1)),
                               f".../b: is named twice; {NEW}"),
    "long key": (lambda at: write_databases([at / "b"], lambda writers: writers[0].put("x" * 512, Datum())), DataError,
                 "the key 'xxx...xxx' is too long; the limit is 511 bytes"),
    "missing": (lambda at: read_database(at / "b"), DataError,
                ".../b: cannot read the database: No such file or directory"),
})
def test_what_cannot_be_written_or_read(tmp_path, given, rejected):
    """An existing database is never replaced or extended, and a key has at most 511 bytes, LMDB's limit."""
    (tmp_path / "a").mkdir()
    with rejected:
        given(tmp_path)
    assert names(tmp_path) == ["a"]


def test_an_empty_database(tmp_path):
    """An empty database raises an error when it is read."""
    write_databases([tmp_path / "a"], put(0))
    with pytest.raises(DataError, match=r"/a: the database has no entries$"):
        read_database(tmp_path / "a")


def test_without_the_package(tmp_path, monkeypatch):
    """Without the package lmdb databases can be read; writing raises an error that names the package."""
    write_databases([tmp_path / "a"], put(1))
    monkeypatch.setitem(sys.modules, "lmdb", None)
    assert read_database(tmp_path / "a")[0] == 1
    with pytest.raises(NetlibError) as error:
        write_databases([tmp_path / "b"], put(1))
    assert str(error.value) == "writing a database needs the package lmdb: pip install lmdb"


def test_backend():
    """Only LMDB is supported."""
    assert databases.backend("LMDB") == "lmdb"
    for text, message in (("leveldb", "leveldb is not supported; use lmdb"), ("sql", "expected lmdb, found 'sql'")):
        with pytest.raises(argparse.ArgumentTypeError, match=message):
            databases.backend(text)
