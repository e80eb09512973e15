"""LMDB: a reader of database files, page by page. The file is not trusted; damage raises DataError.

The file is a sequence of pages of one size. Numbers are little endian, as on 64-bit machines; sizes in bytes:

    page      page number 8 | - 2 | kind 2 | lower 2 | upper 2 | offset of each node 2, up to lower |
              unused | the nodes, from upper to the end of the page
    meta      pages 0 and 1, from byte 16 on: magic 4 | version 4 | - 16 | tree of free pages 48 |
              tree of entries 48 | number of the last page 8 | transaction number 8
              A transaction writes new pages and then one of these two; the one with the higher number is current.
    tree      (in the first tree) page size 4 | flags 2 | depth 2 | branch, leaf, overflow pages 8 each |
              entries 8 | number of the root page 8
    branch    per node: page number, low 4 and high 2 | length of the key 2 | key
              Keys from this one up to that of the next node are below it. The key of the first node is ignored.
    leaf      per node: length of the value 4 | flags 2 | length of the key 2 | key | value
              With flag 1, instead of the value: number of the page where it starts 8
    overflow  page number 8 | - 2 | kind 2 | number of consecutive pages 4 | value

Offsets are sorted by key. All leaves are at the depth of the tree. A page must contain its own number, be of the kind
that its depth requires, and hold only keys between those that lead to it. Therefore no page can be visited twice, and
every walk through the database ends.

The file is read, not memory-mapped, so a file truncated while in use causes an error instead of a crash.
Reference: LMDB 0.9, mdb.c.
"""

from __future__ import annotations

import struct
from bisect import bisect_right
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from netlib.errors import DataError
from netlib.files import Source
from netlib.files.paths import exists

HEADER, OVERFLOW_HEADER = struct.Struct("<QHHHH"), struct.Struct("<QHHI")
META, TREE = struct.Struct("<4sI16x48s48sQQ"), struct.Struct("<IHHQQQQQ")
NODE, NUMBER = struct.Struct("<IHH"), struct.Struct("<Q")
BRANCH, LEAF, OVERFLOW, META_PAGE, KIND = 1, 2, 4, 8, 0x6F  # KIND masks bits without a meaning in files
ELSEWHERE = 1  # flag of a node in a leaf: the value is on separate pages
MAGIC, VERSION = b"\xde\xc0\xef\xbe", 1
PAGE_SIZES = [1 << n for n in range(9, 16)]  # up to LMDB's maximum, 32768 bytes
MAX_DEPTH = 32  # limit of LMDB


class Meta(NamedTuple):
    """Content of a meta page about the tree of entries."""

    transaction: int
    page_size: int
    flags: int
    depth: int
    pages: int  # number of pages in use
    entries: int
    root: int


class Page(NamedTuple):
    """A branch or a leaf.

    keys    keys of its nodes, in order; the first of a branch is the start of the page's range
    end     end of the page's range, exclusive; None if unbounded
    values  of a branch: page numbers; of a leaf: the bytes, or the page where they start and their number
    """

    keys: list[bytes]
    end: bytes | None
    values: list[Any]


class Database:
    """An open database for any number of cursors. Reading can raise DataError.

    path     path of the file
    meta     the current meta page
    entries  number of entries
    """

    def __init__(self, path: Path) -> None:
        self.path = path / "data.mdb" if exists(path) and path.is_dir() else path
        self.source = Source(self.path, "the database")
        self.meta = self._newest()
        self.entries = self.meta.entries
        needed = self.meta.pages * self.meta.page_size  # pages that were never used may be missing
        if self.source.size < needed:
            raise DataError(f"{self.path}: truncated: it has {self.source.size} bytes, expected at least {needed}")

    def damaged(self, number: int, what: str) -> DataError:
        """Return the error for a damaged page. Raises DataError if the file was changed while in use."""
        self.source.check()
        return DataError(f"{self.path}: page {number}: {what}; the database is damaged")

    def _newest(self) -> Meta:
        begin = self.source.read(0, min(self.source.size, 20))
        if begin[16:] != MAGIC:
            if MAGIC in begin or MAGIC[::-1] in begin:
                raise DataError(f"{self.path}: written on a machine of 32 bits or of another byte order, expected "
                                "64 bits, little endian; copy it with mdb_dump there and mdb_load here")
            raise DataError(f"{self.path}: not an LMDB database")
        first = self._meta_page(0, 0)
        newest = max(first, self._meta_page(1, first.page_size))
        if newest.flags:
            raise DataError(f"{self.path}: a database with flags {newest.flags:#x}, expected none, as Caffe writes it: "
                            "one value per key, keys in byte order")
        if newest.depth > MAX_DEPTH:
            raise self.damaged(newest.transaction % 2, f"a depth of {newest.depth}, expected at most {MAX_DEPTH}")
        return newest

    def _meta_page(self, number: int, offset: int) -> Meta:
        size = HEADER.size + META.size
        if offset + size > self.source.size:
            raise self.damaged(number, f"the file ends at byte {self.source.size}")
        raw = self.source.read(offset, size)
        own, _, kind, _, _ = HEADER.unpack_from(raw)
        magic, version, free, entries, _, transaction = META.unpack_from(raw, HEADER.size)
        if own != number or kind & KIND != META_PAGE or magic != MAGIC:
            raise self.damaged(number, f"expected a meta page, found page {own} of kind {kind:#x}")
        if version != VERSION:
            raise DataError(f"{self.path}: version {version} of LMDB's format, expected {VERSION}")
        page_size, *_ = TREE.unpack(free)
        if page_size not in PAGE_SIZES:
            raise self.damaged(number, f"pages of {page_size} bytes, expected a power of two from 512 to 32768")
        _, flags, depth, *pages, count, root = TREE.unpack(entries)
        return Meta(transaction, page_size, flags, depth, 2 + sum(pages), count, root)

    def page(self, number: int, level: int, begin: bytes, end: bytes | None) -> Page:
        """Read a page at a level above the leaves, with keys from ``begin`` up to ``end``."""
        raw = self._read(number, 1, 0, self.meta.page_size)
        own, _, kind, lower, upper = HEADER.unpack_from(raw)
        name, expected = ("branch", BRANCH) if level else ("leaf", LEAF)
        if own != number or kind & KIND != expected:
            raise self.damaged(number, f"expected a {name}, found page {own} of kind {kind:#x}")
        if not HEADER.size < lower <= upper <= len(raw) or lower % 2:
            raise self.damaged(number, f"offsets up to byte {lower}, nodes from byte {upper} on")
        offsets = struct.unpack_from(f"<{(lower - HEADER.size) // 2}H", raw, HEADER.size)
        if max(offsets) > len(raw) - NODE.size:
            raise self.damaged(number, f"a node at byte {max(offsets)}")
        nodes = [NODE.unpack_from(raw, at) for at in offsets]
        rests = [0 if level else NUMBER.size if flags & ELSEWHERE else size for size, flags, _ in nodes]
        stops = [at + NODE.size + length + rest for at, (_, _, length), rest in zip(offsets, nodes, rests)]
        if min(offsets) < lower or max(stops) > len(raw):
            raise self.damaged(number, "its nodes are outside the page")
        keys = [raw[at + NODE.size : stop - rest] for at, stop, rest in zip(offsets, stops, rests)]
        if level:
            keys[0] = begin
        if keys[0] < begin or any(a >= b for a, b in pairwise(keys)) or (end is not None and keys[-1] >= end):
            raise self.damaged(number, "its keys are out of order, or belong to another page")
        if level:
            return Page(keys, end, [low | high << 32 for low, high, _ in nodes])
        for key, (_, flags, _) in zip(keys, nodes):
            if flags & ~ELSEWHERE:
                what = f"{key!r} is not an entry but a database within this one (flags {flags:#x})"
                raise DataError(f"{self.path}: page {number}: {what}, which Caffe never writes, or the file is damaged")
        values = [(*NUMBER.unpack(raw[stop - rest : stop]), size) if flags else raw[stop - rest : stop]
                  for stop, rest, (size, flags, _) in zip(stops, rests, nodes)]
        return Page(keys, end, values)

    def value(self, number: int, size: int) -> bytes:
        """Read a value stored in overflow pages from this one on."""
        pages = (HEADER.size - 1 + size) // self.meta.page_size + 1
        own, _, kind, there = OVERFLOW_HEADER.unpack(self._read(number, pages, 0, HEADER.size))
        if own != number or kind & KIND != OVERFLOW or there < pages:
            raise self.damaged(number, f"expected a value of {size} bytes, found page {own} of kind {kind:#x}")
        return self._read(number, pages, HEADER.size, size)

    def _read(self, number: int, pages: int, begin: int, size: int) -> bytes:
        """Read ``size`` bytes from ``begin`` on in a number of consecutive pages."""
        first = number * self.meta.page_size
        if first + pages * self.meta.page_size > self.source.size:
            raise self.damaged(number, f"the file ends at byte {self.source.size}")
        return self.source.read(first + begin, size)


class Cursor:
    """A position in a database; undefined before the first move. Reading can raise DataError."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._path: list[tuple[Page, int]] = []  # pages from the root to a leaf, with the index of a node in each
        self._number: int | None = None  # number of this entry, if all before it were visited

    @property
    def key(self) -> bytes:
        """Key of the current entry."""
        page, index = self._path[-1]
        return page.keys[index]

    def value(self) -> bytes:
        """Value of the current entry. Raises DataError, also if the file was changed since it was opened."""
        page, index = self._path[-1]
        value: bytes = page.values[index]
        if isinstance(value, tuple):
            value = self._database.value(*value)
        self._database.source.check()
        return value

    def first(self) -> bool:
        """Move to the first entry; returns False if there is none."""
        self._path, self._number = self._down([], b""), 1
        return bool(self._path)

    def next(self) -> bool:
        """Move to the next entry; returns False, without moving, after the last."""
        path = list(self._path)
        while path:
            page, index = path.pop()
            if index + 1 < len(page.keys):
                self._path = self._down([*path, (page, index + 1)], b"")
                self._number = self._number and self._number + 1
                return True
        if self._number not in (None, self._database.entries):
            meta = self._database.meta
            raise self._database.damaged(meta.transaction % 2, f"{meta.entries} entries, but there are {self._number}")
        return False

    def set_key(self, key: bytes) -> bool:
        """Move to the entry with this key; returns False, without moving, if there is none."""
        path = self._down([], key)
        if not path or path[-1][0].keys[path[-1][1]] != key:
            return False
        self._path, self._number = path, None
        return True

    def _down(self, path: list[tuple[Page, int]], key: bytes) -> list[tuple[Page, int]]:
        """Extend a path down to a leaf, in each page through the last node with a key up to ``key``, or the first."""
        meta = self._database.meta
        number, begin, end = meta.root, b"", None
        while len(path) < meta.depth:
            if path:
                above, index = path[-1]
                number, begin = above.values[index], above.keys[index]
                end = above.keys[index + 1] if index + 1 < len(above.keys) else above.end
            page = self._database.page(number, meta.depth - len(path) - 1, begin, end)
            path.append((page, max(bisect_right(page.keys, key) - 1, 0)))
        return path
