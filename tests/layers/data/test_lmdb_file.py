"""layers/data/lmdb_file.py: entries are read as by the package lmdb; damage raises a
one-line error.
"""

from __future__ import annotations

import os
import random
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from layers.data.lmdb_file import BRANCH, LEAF, OVERFLOW, Cursor, Database
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs

lmdb = pytest.importorskip(
    "lmdb", reason="the package lmdb, which writes the databases, is not installed"
)

Entries = dict[bytes, bytes]


def write(path: Path, *transactions: Entries, **options: Any) -> Path:
    """Write a database with the package lmdb; a value of None deletes an entry."""
    with lmdb.open(str(path), map_size=1 << 28, sync=False, **options) as database:
        for entries in transactions:
            with database.begin(write=True) as change:
                for key, value in entries.items():
                    change.delete(key) if value is None else change.put(key, value)
    return path


def walked(path: Path) -> Iterator[tuple[bytes, bytes]]:
    """Yield all entries in order."""
    cursor = Cursor(Database(path))
    there = cursor.first()
    while there:
        yield cursor.key, cursor.value()
        there = cursor.next()


def numbered(count: int, size: int = 20, key: int = 8) -> Entries:
    """Return this number of entries, with keys of this length."""
    keys = [f"{i:0{key}}".encode() for i in range(count)]
    return {name: bytes([i % 251]) * size for i, name in enumerate(keys)}


def only_file(path: Path) -> Path:
    """Return the data file of a database in a folder."""
    return path / "data.mdb"


@pytest.mark.parametrize(
    ("entries", "depth"),
    [
        ({}, 0),
        ({b"k": b""}, 1),
        ({b"k": b"v" * 100_000}, 1),
        (numbered(3, 0), 1),
        (numbered(3000), 2),
        (numbered(5000, 50, key=511), 5),
        ({b"%06d" % i: b"x" * (i * 37 % 9000) for i in range(1000)}, 2),
        ({bytes([i]) * (1 + i * 13 % 511): b"%d" % i for i in range(256)}, 3),
    ],
    ids=[
        "none",
        "of no bytes",
        "of many pages",
        "three",
        "thousands",
        "long keys",
        "values of all sizes",
        "any bytes",
    ],
)
@pytest.mark.parametrize("subdir", [True, False], ids=["folder", "file"])
def test_entries_in_the_order_of_their_keys(
    tmp_path: Path, entries: Entries, depth: int, subdir: bool
) -> None:
    """Entries are read in order for any depth, with values in leaves or in separate pages, from a
    folder or a file.
    """
    path = write(tmp_path / "a", entries, subdir=subdir)
    database = Database(path)
    assert (database.entries, database.depth) == (len(entries), depth)
    assert list(walked(path)) == sorted(entries.items())


@pytest.mark.parametrize("seed", range(6))
def test_databases_after_many_changes_are_read(tmp_path: Path, seed: int) -> None:
    """Databases with reused pages and changed values and trees are read correctly, and so are
    compact copies.
    """
    rng = random.Random(seed)
    path, kept = tmp_path / "a", Entries()
    few = rng.choice((20, 300, 3000))
    with lmdb.open(str(path), map_size=1 << 28, sync=False, writemap=seed % 3 == 0) as database:
        for _ in range(rng.randrange(1, 12)):
            with database.begin(write=True) as change:
                for _ in range(rng.randrange(few)):
                    key = rng.choice((b"%d", b"%0200d", b"%0511d")) % rng.randrange(few)
                    if rng.random() < 0.4:
                        kept.pop(key, None)
                        change.delete(key)
                    else:
                        kept[key] = rng.randbytes(
                            rng.choice((0, 1, 5, 100, 1000, 2030, 2040, 4080, 4081, 20_000))
                        )
                        change.put(key, kept[key])
            assert list(walked(path)) == sorted(kept.items())
        (tmp_path / "b").mkdir()
        database.copy(str(tmp_path / "b"), compact=True)
    assert list(walked(tmp_path / "b")) == sorted(kept.items())
    cursor = Cursor(Database(path))
    for key in rng.sample(sorted(kept), min(len(kept), 50)):
        assert cursor.set_key(key)
        assert (cursor.key, cursor.value()) == (key, kept[key])
        assert not cursor.set_key(key + b"\0")
        assert not cursor.set_key(key[:-1] + b"\xff")
        assert cursor.key == key


def test_several_cursors(tmp_path: Path) -> None:
    path = write(tmp_path / "a", numbered(500))
    database = Database(path)
    cursors = [Cursor(database), Cursor(database), Cursor(Database(path))]
    assert all(cursor.set_key(b"%08d" % (100 * i)) for i, cursor in enumerate(cursors))
    assert [cursor.next() and cursor.key for cursor in cursors] == [
        b"00000001",
        b"00000101",
        b"00000201",
    ]


def page(kind: int, number: int, nodes: list[bytes], size: int) -> bytes:
    """Return a page with these nodes."""
    nodes = [node + bytes(len(node) % 2) for node in nodes]
    places, at = [], size
    for node in nodes:
        at -= len(node)
        places.append(at)
    form, end = f"<QHHHH{len(nodes)}H", 16 + 2 * len(nodes)
    head = struct.pack(form, number, 0, kind, end, at, *places)
    return head.ljust(at, b"\0") + b"".join(reversed(nodes))


def node(key: bytes, value: bytes | tuple[int, int]) -> bytes:
    """Return a node of a leaf; a value in separate pages is given as (first page, size)."""
    if isinstance(value, tuple):
        return struct.pack("<IHH", value[1], 1, len(key)) + key + struct.pack("<Q", value[0])
    return struct.pack("<IHH", len(value), 0, len(key)) + key + value


def pointer(key: bytes, number: int) -> bytes:
    """Return a node of a branch."""
    return struct.pack("<IHH", number & 0xFFFFFFFF, number >> 32, len(key)) + key


def overflow(number: int, count: int, value: bytes, size: int) -> bytes:
    """Return a value that occupies this number of pages."""
    return (struct.pack("<QHHI", number, 0, OVERFLOW, count) + value).ljust(count * size, b"\0")


def database_of(
    path: Path, *pages: bytes, depth: int, entries: int, size: int = 512, **changes: int
) -> Path:
    """Write a database of these pages, numbered from 2; the first one is the root."""
    content = b""
    for number in (0, 1):
        meta = {
            "version": 1,
            "flags": 0,
            "counted": 0,
            "root": 2,
            "last": 1 << 40,
            "transaction": number,
            **changes,
        }
        free = struct.pack("<IHHQQQQQ", size, 8, 0, 0, 0, 0, 0, (1 << 64) - 1)
        tree = struct.pack(
            "<IHHQQQQQ", 0, meta["flags"], depth, 0, meta["counted"], 0, entries, meta["root"]
        )
        said = struct.pack("<4sIQQ", b"\xde\xc0\xef\xbe", meta["version"], 0, 1 << 30) + free + tree
        said += struct.pack("<QQ", meta["last"], meta["transaction"])
        content += (struct.pack("<QHHHH", number, 0, 8, 0, 0) + said).ljust(size, b"\0")
    path.write_bytes(content + b"".join(pages))
    return path


@pytest.mark.parametrize("size", [512, 1024, 4096, 16384, 32768])
def test_pages_of_any_size(tmp_path: Path, size: int) -> None:
    value = bytes(range(251)) * (3 * size // 251)
    pages = [
        page(BRANCH, 2, [pointer(b"", 3), pointer(b"m", 4)], size),
        page(LEAF, 3, [node(b"a", b"first"), node(b"b", (5, len(value)))], size),
        page(LEAF, 4, [node(b"m", b""), node(b"mm", b"last")], size),
        overflow(5, 3, value, size),
    ]
    path = database_of(tmp_path / "a", *pages, depth=2, entries=4, size=size)
    assert list(walked(path)) == [(b"a", b"first"), (b"b", value), (b"m", b""), (b"mm", b"last")]


WHOLE = page(LEAF, 2, [node(b"a", b"1"), node(b"b", b"2")], 512)


DAMAGED = "; the database is damaged"
UNSORTED = "its keys are out of order, or belong to another page"


@bad_inputs(
    DataError,
    {
        f"{i}: {line}": ((pages, header), f".../a: {line}")
        for i, (pages, header, line) in enumerate(
            (
                ([WHOLE], {"version": 999}, "version 999 of LMDB's format, expected 1"),
                (
                    [WHOLE],
                    {"flags": 4},
                    "a database with flags 0x4, expected none, as Caffe writes it: one value per key, ...",
                ),
                (
                    [WHOLE],
                    {"size": 12},
                    f"page 0: pages of 12 bytes, expected a power of two from 512 to 32768{DAMAGED}",
                ),
                ([WHOLE], {"depth": 33}, f"page 1: a depth of 33, expected at most 32{DAMAGED}"),
                (
                    [WHOLE],
                    {"depth": 2},
                    f"page 2: expected a branch, found page 2 of kind 0x2{DAMAGED}",
                ),
                ([WHOLE], {"entries": 3}, f"page 1: 3 entries, but there are 2{DAMAGED}"),
                (
                    [WHOLE],
                    {"root": 1 << 40},
                    f"page 1099511627776: the file ends at byte 1536{DAMAGED}",
                ),
                ([WHOLE], {"counted": 7}, "truncated: it has 1536 bytes, expected at least 4608"),
                (
                    [page(BRANCH, 2, [pointer(b"", 2)] * 2, 512)],
                    {"depth": 9},
                    f"page 2: {UNSORTED}{DAMAGED}",
                ),
                (
                    [page(BRANCH, 2, [pointer(b"", 2)], 512)],
                    {"depth": 32},
                    f"page 2: expected a leaf, found page 2 of kind 0x1{DAMAGED}",
                ),
                (
                    [
                        page(BRANCH, 2, [pointer(b"", 3), pointer(b"c", 3)], 512),
                        page(LEAF, 3, [node(b"b", b"")], 512),
                    ],
                    {"depth": 2},
                    f"page 3: {UNSORTED}{DAMAGED}",
                ),
                (
                    [page(LEAF, 2, [], 512)],
                    {},
                    f"page 2: offsets up to byte 16, nodes from byte 512 on{DAMAGED}",
                ),
                (
                    [WHOLE[:16] + b"\xff\xff" + WHOLE[18:]],
                    {},
                    f"page 2: its nodes are outside the page{DAMAGED}",
                ),
                (
                    [page(LEAF, 2, [node(b"b", b""), node(b"a", b"")], 512)],
                    {},
                    f"page 2: {UNSORTED}{DAMAGED}",
                ),
                (
                    [page(LEAF, 2, [node(b"a", b"")[:4] + b"\2\0\1\0a"], 512)],
                    {},
                    "page 2: b'a' is not an entry but a database "
                    "within this one (flags 0x2), which Caffe never writes, or the file is damaged",
                ),
                (
                    [page(LEAF, 2, [node(b"a", (3, 2**32 - 1))], 512)],
                    {},
                    f"page 3: the file ends at byte 1536{DAMAGED}",
                ),
                (
                    [page(LEAF, 2, [node(b"a", (2, 9))], 512)],
                    {},
                    f"page 2: expected a value of 9 bytes, found page 2 of kind 0x2{DAMAGED}",
                ),
                (
                    [page(LEAF, 2, [node(b"a", (3, 900))], 512), overflow(3, 1, b"", 512), WHOLE],
                    {},
                    f"page 3: expected a value of 900 bytes, found page 3 of kind 0x4{DAMAGED}",
                ),
            )
        )
    },
)
def test_inconsistent_pages_and_headers_are_rejected(
    tmp_path: Path, given: tuple[list[bytes], dict[str, int]], rejected: Any
) -> None:
    path = database_of(tmp_path / "a", *given[0], **{"depth": 1, "entries": 2, **given[1]})
    with rejected:
        list(walked(path))


def test_a_page_that_is_referenced_twice_is_rejected(tmp_path: Path) -> None:
    """A tree of such branches would have 2^31 leaves."""

    def branch(number: int) -> bytes:
        both = [pointer(key, number + 1) for key in (b"", b"%02d" % number)]
        return page(BRANCH, number, both, 512)

    leaf = page(LEAF, 33, [node(b"0", b"")], 512)
    pages = [*map(branch, range(2, 33)), leaf]
    path = database_of(tmp_path / "a", *pages, depth=32, entries=1 << 31)
    with pytest.raises(DataError, match="its keys are out of order, or belong to another page"):
        list(walked(path))


ORDER = (
    "...: written on a machine of 32 bits or of another byte order, expected 64 bits, little "
    "endian; copy it with ..."
)


@bad_inputs(
    DataError,
    {
        "empty": (b"", ".../a: not an LMDB database"),
        "text": (b"text" * 1000, ".../a: not an LMDB database"),
        "cut": (bytes(16) + b"\xde\xc0\xef\xbe", ".../a: ends at byte 20, expected 152"),
        "32 bits": (bytes(12) + b"\xde\xc0\xef\xbe" + bytes(9000), f".../a{ORDER[3:]}"),
        "byte order": (bytes(16) + b"\xbe\xef\xc0\xde" + bytes(9000), f".../a{ORDER[3:]}"),
    },
)
def test_files_of_other_formats_are_rejected(tmp_path: Path, given: bytes, rejected: Any) -> None:
    (tmp_path / "a").write_bytes(given)
    with rejected:
        Database(tmp_path / "a")


Damage = Callable[[bytearray, random.Random], int]


def flipped_bit(content: bytearray, rng: random.Random) -> int:
    """Flip any bit, every second time in the numbers at the start of a page; at most one
    entry may change.
    """
    head = 4096 * rng.randrange(len(content) // 4096) + rng.randrange(160)
    content[rng.choice((head, rng.randrange(len(content))))] ^= 1 << rng.randrange(8)
    return 1


def zeros(content: bytearray, rng: random.Random) -> int:
    """Set a few bytes to zero, which may affect two entries."""
    at, count = rng.randrange(len(content)), rng.randrange(1, 30)
    content[at : at + count] = bytes(len(content[at : at + count]))
    return 2


def swapped_pages(content: bytearray, rng: random.Random) -> int:
    """Swap two pages."""
    pages = [4096 * rng.randrange(len(content) // 4096) for _ in range(2)]
    one, other = (slice(at, at + 4096) for at in pages)
    content[one], content[other] = content[other], content[one]
    return 2  # the later pages of a value are not numbered


def cut(content: bytearray, rng: random.Random) -> int:
    """Truncate the file anywhere; entries that are read must be correct."""
    del content[rng.randrange(len(content)) :]
    return 0


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, Entries]:
    """A tree of three levels, with values of all sizes and free pages: its content
    and its entries.
    """
    counts = [20 if i % 5 else 400 * (1 + i % 4) for i in range(400)]
    entries = {b"%0200d" % i: b"%04d" % i * count for i, count in enumerate(counts)}
    gone = dict.fromkeys([*entries][100:200])
    path = write(tmp_path_factory.mktemp("good") / "a", entries, gone, {})  # type: ignore[arg-type]
    return only_file(path).read_bytes(), {
        key: value for key, value in entries.items() if key not in gone
    }


@pytest.mark.parametrize("damage", [flipped_bit, zeros, swapped_pages, cut])
def test_damage(tmp_path: Path, good: tuple[bytes, Entries], damage: Damage) -> None:
    """A damaged file raises a one-line error, or gives all entries with changes only at the
    damaged position.
    """
    content, entries = good
    rng, path, refused = random.Random(damage.__name__), tmp_path / "a", 0
    assert len(entries) == 300
    for case in range(100):
        changed = bytearray(content)
        allowed = damage(changed, rng)
        path.write_bytes(changed)
        try:
            found = list(walked(path))
        except DataError as error:
            assert str(error).startswith(f"{path}: ")
            assert str(error).isprintable()
            assert len(str(error)) < 500
            refused += 1
        else:
            assert len(found) == len(entries)
            wrong = [a for a, b in zip(found, sorted(entries.items())) if a != b]
            assert len(wrong) <= allowed, (case, wrong)
    assert refused >= 3


def test_a_database_that_is_cut_under_way(tmp_path: Path) -> None:
    """A file that is truncated or changed in use raises an error on the next access, even for
    pages in memory.
    """
    path = only_file(write(tmp_path / "a", numbered(300, 5000)))
    changes: dict[str, Callable[[], None]] = {
        "was cut to 20000 of": lambda: os.truncate(path, 20_000),
        "was changed": lambda: os.utime(path, ns=(0, 1)),
    }
    for message, change in changes.items():
        cursor = Cursor(Database(path))
        assert cursor.first()
        assert cursor.next()
        size = path.stat().st_size
        content = path.read_bytes()
        change()
        for act in (
            cursor.value,
            lambda cursor=cursor: cursor.set_key(b"00000299") and cursor.value(),
        ):
            with pytest.raises(
                DataError,
                match=rf"^{path}: {message}.* while in use; restore the file and run again",
            ):
                act()
        path.write_bytes(content)
        assert path.stat().st_size == size
