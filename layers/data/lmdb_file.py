"""LMDB: a reader of database files, page by page. The file is not trusted; damage raises DataError.

The file is a sequence of pages of one size. Numbers are little endian, as on 64-bit machines;
sizes in bytes:

    page      page number 8 | - 2 | kind 2 | lower 2 | upper 2 | offset of each node 2, up to
              lower | unused | the nodes, from upper to the end of the page
    meta      pages 0 and 1, from byte 16 on: magic 4 | version 4 | - 16 | tree of free pages 48 |
              tree of entries 48 | number of the last page 8 | transaction number 8 A transaction
              writes new pages and then one of these two; the one with the higher number is current.
    tree      (in the first tree) page size 4 | flags 2 | depth 2 | branch, leaf, overflow pages 8
              each | entries 8 | number of the root page 8
    branch    per node: page number, low 4 and high 2 | length of the key 2 | key Keys from this one
              up to that of the next node are below it. The key of the first node is ignored.
    leaf      per node: length of the value 4 | flags 2 | length of the key 2 | key | value
              With flag 1, instead of the value: number of the page where it starts 8
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
from typing import Any

from netlib.errors import DataError
from netlib.files import Source
from netlib.files.paths import exists

HEADER, OVERFLOW_HEADER = struct.Struct("<QHHHH"), struct.Struct("<QHHI")
META, TREE = struct.Struct("<4sI16x48s48sQQ"), struct.Struct("<IHHQQQQQ")
NODE, NUMBER = struct.Struct("<IHH"), struct.Struct("<Q")
# KIND masks bits without a meaning in files
BRANCH, LEAF, OVERFLOW, META_PAGE, KIND = 1, 2, 4, 8, 0x6F
ELSEWHERE = 1  # flag of a node in a leaf: the value is on separate pages
MAGIC, VERSION = b"\xde\xc0\xef\xbe", 1
PAGE_SIZES = [1 << n for n in range(9, 16)]  # up to LMDB's maximum, 32768 bytes
MAX_DEPTH = 32  # limit of LMDB


class Database:
    """An open database for any number of cursors. Reading can raise DataError.

    path            path of the file
    entries, depth  number of entries, and depth of their tree
    """

    def __init__(self, path: Path) -> None:
        self.path = path / "data.mdb" if exists(path) and path.is_dir() else path
        self.source = Source(self.path, "the database")
        begin = self.source.read(0, min(self.source.size, 20))
        if begin[16:] != MAGIC:
            if MAGIC in begin or MAGIC[::-1] in begin:
                raise DataError(
                    f"{self.path}: written on a machine of 32 bits or of another byte order, expected "
                    "64 bits, little endian; copy it with mdb_dump there and mdb_load here"
                )
            raise DataError(f"{self.path}: not an LMDB database")
        older = self._meta_page(0, 0)
        newer = max(older, self._meta_page(1, older[1]))
        transaction, self._page_size, flags, self.depth, pages, self.entries, self._root = newer
        self._current = transaction % 2  # number of the current meta page
        if flags:
            raise DataError(
                f"{self.path}: a database with flags {flags:#x}, expected none, as Caffe writes it: "
                "one value per key, keys in byte order"
            )
        if self.depth > MAX_DEPTH:
            raise self.damaged(
                self._current, f"a depth of {self.depth}, expected at most {MAX_DEPTH}"
            )
        needed = pages * self._page_size  # pages that were never used may be missing
        if self.source.size < needed:
            raise DataError(
                f"{self.path}: truncated: it has {self.source.size} bytes, expected at least {needed}"
            )

    def damaged(self, number: int, what: str) -> DataError:
        """Return the error for a damaged page.

        Raises DataError if the file was changed while in use.
        """
        self.source.check()
        return DataError(f"{self.path}: page {number}: {what}; the database is damaged")

    def _meta_page(self, number: int, offset: int) -> tuple[int, ...]:
        """Transaction, page size, flags, depth of the tree, number of pages in use, number of
        entries, and root.
        """
        raw = self.source.read(offset, HEADER.size + META.size)
        own, _, kind, _, _ = HEADER.unpack_from(raw)
        magic, version, free, entries, _, transaction = META.unpack_from(raw, HEADER.size)
        if own != number or kind & KIND != META_PAGE or magic != MAGIC:
            raise self.damaged(number, f"expected a meta page, found page {own} of kind {kind:#x}")
        if version != VERSION:
            raise DataError(f"{self.path}: version {version} of LMDB's format, expected {VERSION}")
        page_size, *_ = TREE.unpack(free)
        if page_size not in PAGE_SIZES:
            raise self.damaged(
                number, f"pages of {page_size} bytes, expected a power of two from 512 to 32768"
            )
        _, flags, depth, *pages, count, root = TREE.unpack(entries)
        return transaction, page_size, flags, depth, 2 + sum(pages), count, root

    def entries_from(self, start: bytes) -> Iterator[tuple[bytes, Any]]:
        """Yield the entries whose keys are not below ``start``, in order; with an empty one their
        number is checked.

        A value is the bytes, or the number of the page where they start and their number.
        """
        count = 0
        for entry in (
            self._below(start, self._root, self.depth - 1, b"", None) if self.depth else ()
        ):
            count += 1
            yield entry
        if not start and count != self.entries:
            raise self.damaged(self._current, f"{self.entries} entries, but there are {count}")

    def _below(
        self, start: bytes, number: int, level: int, begin: bytes, end: bytes | None
    ) -> Iterator[Any]:
        """Yield these entries of a page at a level above the leaves, with keys from ``begin``
        up to ``end``.
        """
        keys, values = self._page(number, level, begin, end)
        first = max(bisect_right(keys, start) - 1, 0)
        for key, after, value in zip(keys[first:], [*keys[first + 1 :], end], values[first:]):
            if level:
                yield from self._below(start, value, level - 1, key, after)
            elif key >= start:
                yield key, value

    def _page(
        self, number: int, level: int, begin: bytes, end: bytes | None
    ) -> tuple[list[bytes], list[Any]]:
        """Read a page: its keys, and the numbers of the pages below it, or the values
        of its entries.
        """
        raw = self._read(number, 1, 0, self._page_size)
        own, _, kind, lower, upper = HEADER.unpack_from(raw)
        name, expected = ("branch", BRANCH) if level else ("leaf", LEAF)
        if own != number or kind & KIND != expected:
            raise self.damaged(number, f"expected a {name}, found page {own} of kind {kind:#x}")
        if not HEADER.size < lower <= upper <= len(raw) or lower % 2:
            raise self.damaged(number, f"offsets up to byte {lower}, nodes from byte {upper} on")
        offsets = struct.unpack_from(f"<{(lower - HEADER.size) // 2}H", raw, HEADER.size)
        nodes = [NODE.unpack_from(raw, min(at, len(raw) - NODE.size)) for at in offsets]
        sizes = [0 if level else _size_in_leaf(size, flags) for size, flags, _ in nodes]
        key_ends = [at + NODE.size + length for at, (_, _, length) in zip(offsets, nodes)]
        ends = [key_end + size for key_end, size in zip(key_ends, sizes)]
        if min(offsets) < lower or max(ends) > len(raw):
            raise self.damaged(number, "its nodes are outside the page")
        keys = [raw[at + NODE.size : key_end] for at, key_end in zip(offsets, key_ends)]
        if level:
            keys[0] = begin
        is_sorted = all(a < b for a, b in pairwise(keys))
        if not is_sorted or keys[0] < begin or (end is not None and keys[-1] >= end):
            raise self.damaged(number, "its keys are out of order, or belong to another page")
        if level:
            return keys, [low | high << 32 for low, high, _ in nodes]
        for key, (_, flags, _) in zip(keys, nodes):
            if flags & ~ELSEWHERE:
                what = f"{key!r} is not an entry but a database within this one (flags {flags:#x})"
                raise DataError(
                    f"{self.path}: page {number}: {what}, which Caffe never writes, or the file is damaged"
                )
        values: list[Any] = [raw[key_end:end] for key_end, end in zip(key_ends, ends)]
        for i, (size, flags, _) in enumerate(nodes):
            if flags:
                values[i] = (*NUMBER.unpack(values[i]), size)
        return keys, values

    def value(self, number: int, size: int) -> bytes:
        """Read a value stored in overflow pages from this one on."""
        pages = (HEADER.size - 1 + size) // self._page_size + 1
        own, _, kind, there = OVERFLOW_HEADER.unpack(self._read(number, pages, 0, HEADER.size))
        if own != number or kind & KIND != OVERFLOW or there < pages:
            raise self.damaged(
                number, f"expected a value of {size} bytes, found page {own} of kind {kind:#x}"
            )
        return self._read(number, pages, HEADER.size, size)

    def _read(self, number: int, pages: int, begin: int, size: int) -> bytes:
        """Read ``size`` bytes from ``begin`` on in a number of consecutive pages."""
        first = number * self._page_size
        if first + pages * self._page_size > self.source.size:
            raise self.damaged(number, f"the file ends at byte {self.source.size}")
        return self.source.read(first + begin, size)


def _size_in_leaf(size: int, flags: int) -> int:
    """Bytes of a value in its node: those of a page number if it is elsewhere."""
    return NUMBER.size if flags & ELSEWHERE else size


class Cursor:
    """A position in a database; undefined before the first move and after an error.

    Reading can raise DataError.

    key  key of the current entry
    """

    def __init__(self, database: Database) -> None:
        # the entries after this one
        self._database, self._rest = database, database.entries_from(b"")
        self.key, self._value = b"", b""

    def value(self) -> bytes:
        """Value of the current entry.

        Raises DataError, also if the file was changed since it was opened.
        """
        value = (
            self._database.value(*self._value) if isinstance(self._value, tuple) else self._value
        )
        self._database.source.check()
        return value

    def first(self) -> bool:
        """Move to the first entry; returns False if there is none."""
        self._rest = self._database.entries_from(b"")
        return self.next()

    def next(self) -> bool:
        """Move to the next entry; returns False, without moving, after the last."""
        before, self.key = self.key, b""
        found = next(self._rest, None)
        self.key, self._value = found or (before, self._value)
        return found is not None

    def set_key(self, key: bytes) -> bool:
        """Move to the entry with this key; returns False, without moving, if there is none."""
        rest = self._database.entries_from(key)
        found = next(rest, None)
        if found is None or found[0] != key:
            return False
        (self.key, self._value), self._rest = found, rest
        return True
