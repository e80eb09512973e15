"""LMDB: a reader of database files, page by page. The file is not trusted; damage raises DataError.

The file is a sequence of pages of one size. Numbers are little endian, as on 64-bit machines. Each
field is followed by its size in bytes; "-" is a field that is not read:

    page      page number 8 | - 2 | kind 2 | lower 2 | upper 2 | offset of each node 2, up to
              lower | unused | the nodes, from upper to the end of the page

    meta      pages 0 and 1, from byte 16 on: magic 4 | version 4 | - 16 | tree of free pages 48 |
              tree of entries 48 | number of the last page 8 | transaction number 8

              A transaction writes new pages and then one of these two; the one with the higher
              number is current.

    tree      page size 4 (in the tree of free pages) | flags 2 | depth 2 | branch, leaf and
              overflow pages 8 each | entries 8 | number of the root page 8

    branch    per node: number of a child page, low 4 and high 2 | length of the key 2 | key

              The child holds the keys from this one up to that of the next node. The key of the
              first node is ignored.

    leaf      per node: length of the value 4 | flags 2 | length of the key 2 | key | value

              With flag 1, the number of the first overflow page 8 takes the place of the value.

    overflow  page number 8 | - 2 | kind 2 | number of consecutive pages 4 | value

Offsets are sorted by key. All leaves are at the depth of the tree. A page must contain its own
number, be of the kind that its depth requires, and hold only keys between those that lead to it.
Therefore no page can be visited twice, and every walk through the database ends.

The file is read, not memory-mapped, so a file truncated while in use causes an error instead of a
crash. Reference: LMDB 0.9, mdb.c.
"""

from __future__ import annotations

import struct
from bisect import bisect_right
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from netlib.errors import DataError
from netlib.files import Source
from netlib.files.paths import exists

HEADER = struct.Struct("<QHHHH")
OVERFLOW_HEADER = struct.Struct("<QHHI")
META = struct.Struct("<4sI16x48s48sQQ")
TREE = struct.Struct("<IHHQQQQQ")
NODE = struct.Struct("<IHH")
PAGE_NUMBER = struct.Struct("<Q")
# Kinds of pages. The mask removes bits without a meaning in files.
BRANCH, LEAF, OVERFLOW, META_PAGE = 1, 2, 4, 8
KIND_MASK = 0x6F
ON_OVERFLOW_PAGES = 1  # flag of a node in a leaf
MAGIC, VERSION = b"\xde\xc0\xef\xbe", 1
PAGE_SIZES = [1 << n for n in range(9, 16)]  # up to LMDB's maximum, 32768 bytes
MAX_DEPTH = 32  # same limit as LMDB


class Meta(NamedTuple):
    """What a meta page states of the database after a transaction."""

    transaction: int
    page_size: int
    flags: int  # of the tree of entries
    depth: int
    used_pages: int
    entries: int
    root: int  # number of the root page


class OverflowValue(NamedTuple):
    """The place of a value on overflow pages."""

    page: int
    size: int


Value = bytes | OverflowValue


class Database:
    """An open database for any number of cursors. Reading can raise DataError.

    path            path of the file
    entries, depth  number of entries, and depth of their tree
    """

    def __init__(self, path: Path) -> None:
        self.path = path / "data.mdb" if exists(path) and path.is_dir() else path
        self.source = Source(self.path, "the database")
        self._check_magic()
        older = self._read_meta(0, 0)
        meta = max(older, self._read_meta(1, older.page_size))
        self.depth, self.entries = meta.depth, meta.entries
        self._page_size, self._root = meta.page_size, meta.root
        self._meta_page = meta.transaction % 2
        if meta.flags:
            raise DataError(
                f"{self.path}: a database with flags {meta.flags:#x}, expected none, as Caffe writes it: "
                "one value per key, keys in byte order"
            )
        if self.depth > MAX_DEPTH:
            raise self.damaged(
                self._meta_page, f"a depth of {self.depth}, expected at most {MAX_DEPTH}"
            )
        needed = meta.used_pages * self._page_size  # pages that were never used may be missing
        if self.source.size < needed:
            raise DataError(
                f"{self.path}: truncated: it has {self.source.size} bytes, expected at least {needed}"
            )

    def _check_magic(self) -> None:
        """Raise DataError if the file does not begin as an LMDB database."""
        head = self.source.read(0, min(self.source.size, HEADER.size + len(MAGIC)))
        if head[HEADER.size :] == MAGIC:
            return
        if MAGIC in head or MAGIC[::-1] in head:
            raise DataError(
                f"{self.path}: written on a machine of 32 bits or of another byte order, expected "
                "64 bits, little endian; copy it with mdb_dump there and mdb_load here"
            )
        raise DataError(f"{self.path}: not an LMDB database")

    def damaged(self, number: int, what: str) -> DataError:
        """Return the error for a damaged page.

        Raises DataError if the file was changed while in use.
        """
        self.source.check()
        return DataError(f"{self.path}: page {number}: {what}; the database is damaged")

    def _read_meta(self, number: int, offset: int) -> Meta:
        """Read meta page ``number``, which begins at byte ``offset`` of the file."""
        raw = self.source.read(offset, HEADER.size + META.size)
        found, _, kind, _, _ = HEADER.unpack_from(raw)
        magic, version, free, entries, _, transaction = META.unpack_from(raw, HEADER.size)
        if found != number or kind & KIND_MASK != META_PAGE or magic != MAGIC:
            raise self.damaged(
                number, f"expected a meta page, found page {found} of kind {kind:#x}"
            )
        if version != VERSION:
            raise DataError(f"{self.path}: version {version} of LMDB's format, expected {VERSION}")
        page_size, *_ = TREE.unpack(free)
        if page_size not in PAGE_SIZES:
            raise self.damaged(
                number, f"pages of {page_size} bytes, expected a power of two from 512 to 32768"
            )
        _, flags, depth, *tree_pages, count, root = TREE.unpack(entries)
        return Meta(transaction, page_size, flags, depth, 2 + sum(tree_pages), count, root)

    def entries_from(self, start: bytes) -> Iterator[tuple[bytes, Value]]:
        """Yield the entries with keys from ``start`` on, in order.

        If ``start`` is empty, their number is checked.
        """
        count = 0
        if self.depth:
            for entry in self._entries_below(self._root, self.depth - 1, b"", None, start):
                count += 1
                yield entry
        if not start and count != self.entries:
            raise self.damaged(self._meta_page, f"{self.entries} entries, but there are {count}")

    def _entries_below(
        self, number: int, level: int, min_key: bytes, end_key: bytes | None, start: bytes
    ) -> Iterator[tuple[bytes, Value]]:
        """Yield the entries with keys from ``start`` on in the subtree of page ``number``.

        level             levels between this page and the leaves
        min_key, end_key  the keys in the subtree are at least ``min_key`` and below ``end_key``
        """
        keys, values = self._page(number, level, min_key, end_key)
        first = max(bisect_right(keys, start) - 1, 0)
        keys, values = keys[first:], values[first:]
        for key, next_key, value in zip(keys, [*keys[1:], end_key], values):
            if level:
                yield from self._entries_below(value, level - 1, key, next_key, start)
            elif key >= start:
                yield key, value

    def _page(
        self, number: int, level: int, min_key: bytes, end_key: bytes | None
    ) -> tuple[list[bytes], list[Any]]:
        """Read the keys of a branch and the numbers of its child pages, or the keys and
        values of a leaf (level 0).
        """
        raw = self._read(number, 1, 0, self._page_size)
        offsets = self._node_offsets(number, level, raw)
        nodes = [NODE.unpack_from(raw, min(offset, len(raw) - NODE.size)) for offset in offsets]
        key_starts = [offset + NODE.size for offset in offsets]
        key_ends = [start + length for start, (_, _, length) in zip(key_starts, nodes)]
        value_sizes = [0 if level else _size_in_leaf(size, flags) for size, flags, _ in nodes]
        ends = [key_end + size for key_end, size in zip(key_ends, value_sizes)]
        if min(offsets) < HEADER.size + 2 * len(offsets) or max(ends) > len(raw):
            raise self.damaged(number, "its nodes are outside the page")
        keys = [raw[start:end] for start, end in zip(key_starts, key_ends)]
        if level:
            keys[0] = min_key
        is_sorted = all(a < b for a, b in pairwise(keys))
        is_below_end = end_key is None or keys[-1] < end_key
        if not is_sorted or keys[0] < min_key or not is_below_end:
            raise self.damaged(number, "its keys are out of order, or belong to another page")
        if level:
            return keys, [low | high << 32 for low, high, _ in nodes]
        values: list[Value] = []
        for key, (size, flags, _), key_end, end in zip(keys, nodes, key_ends, ends):
            if flags & ~ON_OVERFLOW_PAGES:
                raise DataError(
                    f"{self.path}: page {number}: {key!r} is not an entry but a database within this one "
                    f"(flags {flags:#x}), which Caffe never writes, or the file is damaged"
                )
            value = raw[key_end:end]
            if flags:
                [first_page] = PAGE_NUMBER.unpack(value)
                values.append(OverflowValue(first_page, size))
            else:
                values.append(value)
        return keys, values

    def _node_offsets(self, number: int, level: int, raw: bytes) -> tuple[int, ...]:
        """Check the header of a branch or leaf; returns the offset of each node in the page."""
        found, _, kind, lower, upper = HEADER.unpack_from(raw)
        name, expected = ("branch", BRANCH) if level else ("leaf", LEAF)
        if found != number or kind & KIND_MASK != expected:
            raise self.damaged(number, f"expected a {name}, found page {found} of kind {kind:#x}")
        if not HEADER.size < lower <= upper <= len(raw) or lower % 2:
            raise self.damaged(number, f"offsets up to byte {lower}, nodes from byte {upper} on")
        return struct.unpack_from(f"<{(lower - HEADER.size) // 2}H", raw, HEADER.size)

    def value(self, place: OverflowValue) -> bytes:
        """Read a value from its overflow pages."""
        number, size = place
        pages = (HEADER.size - 1 + size) // self._page_size + 1
        header = self._read(number, pages, 0, HEADER.size)
        found, _, kind, available = OVERFLOW_HEADER.unpack(header)
        if found != number or kind & KIND_MASK != OVERFLOW or available < pages:
            raise self.damaged(
                number, f"expected a value of {size} bytes, found page {found} of kind {kind:#x}"
            )
        return self._read(number, pages, HEADER.size, size)

    def _read(self, number: int, pages: int, offset: int, size: int) -> bytes:
        """Read ``size`` bytes at ``offset`` in ``pages`` consecutive pages, the first
        of which is page ``number``.
        """
        begin = number * self._page_size
        if begin + pages * self._page_size > self.source.size:
            raise self.damaged(number, f"the file ends at byte {self.source.size}")
        return self.source.read(begin + offset, size)


def _size_in_leaf(size: int, flags: int) -> int:
    """Bytes that a value takes in its leaf."""
    return PAGE_NUMBER.size if flags & ON_OVERFLOW_PAGES else size


class Cursor:
    """A position in a database; undefined before the first move and after an error.

    Reading can raise DataError.

    key  key of the current entry
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._following = database.entries_from(b"")  # the entries after the current one
        self.key = b""
        self._value: Value = b""

    def value(self) -> bytes:
        """Value of the current entry.

        Raises DataError, also if the file was changed since it was opened.
        """
        value = self._value
        if isinstance(value, OverflowValue):
            value = self._database.value(value)
        self._database.source.check()
        return value

    def first(self) -> bool:
        """Move to the first entry; returns False if there is none."""
        self._following = self._database.entries_from(b"")
        return self.next()

    def next(self) -> bool:
        """Move to the next entry; returns False, without moving, after the last."""
        key, self.key = self.key, b""  # b"" remains if reading raises
        entry = next(self._following, None)
        self.key, self._value = entry or (key, self._value)
        return entry is not None

    def set_key(self, key: bytes) -> bool:
        """Move to the entry with this key; returns False, without moving, if there is none."""
        entries = self._database.entries_from(key)
        entry = next(entries, None)
        if entry is None or entry[0] != key:
            return False
        self.key, self._value = entry
        self._following = entries
        return True
