"""Limits that keep rosbags from hanging and from exhausting the memory: it trusts the content of a bag.

check_files(path)             # before a bag is opened
limit_reading()               # once, before the first
with limited_rows(): ...      # while it is opened
with named_limits(): ...      # while its messages are read
check_message(content)        # of every message
"""

from __future__ import annotations

import bz2
import contextlib
import errno
import functools
import importlib
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from netlib import files
from netlib.errors import DataError, reason_of
from netlib.files.paths import names_in

BEGINNINGS = {".bag": b"#ROSBAG V2.0\n", ".db3": b"SQLite format 3\0", ".mcap": b"\x89MCAP0\r\n"}
PACKED = ".zstd"  # extension of completely compressed files
MAX_YAML_BYTES = 1 << 20  # ten times the size for hundreds of topics
MAX_CHUNK_BYTES = 1 << 28  # bytes; recorders close a chunk below 1 MB, or after a single message that is larger
MAX_MESSAGE_BYTES = 1 << 26  # bytes; an image of 4096 x 4096 depths of 32 bits


def check_files(path: Path) -> None:
    """Raise DataError unless a bag's files are regular files: a pipe or a device may never end."""
    if not path.is_dir():
        _check_file(path)
        return
    files.read_bytes(path / "metadata.yaml", "the bag", limit=MAX_YAML_BYTES)
    for name in sorted(names_in(path)):
        if Path(name).suffix.lower() in (*BEGINNINGS, PACKED):
            _check_file(path / name)


def _check_file(path: Path) -> None:
    beginning = BEGINNINGS.get(path.suffix.lower(), b"")
    if not files.read_bytes(path, "the bag", first=len(beginning)).startswith(beginning):
        raise DataError(f"{path}: cannot read the bag: it does not begin with {beginning!r}, as {path.suffix} does")


@functools.cache
def limit_reading() -> None:
    """Make rosbags raise ValueError for a chunk or message of more than MAX_CHUNK_BYTES bytes.

    ``limited_rows`` does the same for the rows of a .db3, which are single messages.
    """
    import lz4.frame

    ros1: Any = importlib.import_module("rosbags.rosbag1.reader")
    mcap: Any = importlib.import_module("rosbags.rosbag2.storage_mcap")
    ros2: Any = importlib.import_module("rosbags.rosbag2.reader")
    zstd = ros2.zstd  # the standard library's or its backport
    unpack_lz4, unpack_zstd = _limited(lz4.frame.LZ4FrameDecompressor), _limited(zstd.ZstdDecompressor)
    ros1.decompressors.update(bz2=_limited(bz2.BZ2Decompressor), lz4=unpack_lz4)
    mcap.DECOMPRESSORS.update(
        lz4=lambda packed, size: unpack_lz4(packed), zstd=lambda packed, size: unpack_zstd(packed)
    )
    ros1.read_bytes = _limited_read(ros1.read_bytes)
    mcap.read_exact = _limited_read(mcap.read_exact)
    ros2.zstd = types.SimpleNamespace(decompress=unpack_zstd, open=zstd.open)


def _limited_read(read: Callable[[Any, int], bytes]) -> Callable[[Any, int], bytes]:
    def limited(source: Any, size: int) -> bytes:
        if size > MAX_CHUNK_BYTES:
            raise ValueError(f"a part of the bag has {size} bytes; expected at most {MAX_CHUNK_BYTES}")
        return read(source, size)

    return limited


@contextlib.contextmanager
def limited_rows() -> Iterator[None]:
    """An SQLite database that is opened within it reads no row of more than MAX_MESSAGE_BYTES bytes."""
    import apsw

    def limit(connection: Any) -> None:
        connection.limit(apsw.SQLITE_LIMIT_LENGTH, MAX_MESSAGE_BYTES)

    apsw.connection_hooks.append(limit)
    try:
        yield
    finally:
        apsw.connection_hooks.remove(limit)


@contextlib.contextmanager
def named_limits() -> Iterator[None]:
    """Turn SQLite's errors into Python's: for a row that is too large a ValueError that names the limit, and those of
    the system, which apsw does not derive from OSError and MemoryError.
    """
    import apsw

    try:
        yield
    except apsw.TooBigError as error:
        raise ValueError(f"a message of more than {MAX_MESSAGE_BYTES} bytes") from error
    except apsw.NoMemError as error:
        raise MemoryError(reason_of(error)) from error
    except (apsw.CantOpenError, apsw.IOError, apsw.PermissionsError) as error:
        raise OSError(errno.EIO, reason_of(error)) from error


def check_message(content: bytes) -> None:
    """Raise ValueError for a message that is larger than any image of a depth camera."""
    if len(content) > MAX_MESSAGE_BYTES:
        raise ValueError(f"a message of {len(content)} bytes; expected at most {MAX_MESSAGE_BYTES}")


def _limited(decompressor: Callable[[], Any]) -> Callable[[bytes], bytes]:
    def unpacked(packed: bytes) -> bytes:
        one = decompressor()
        content: bytes = one.decompress(packed, max_length=MAX_CHUNK_BYTES)
        if not one.eof:
            what = f"unpacks to more than {MAX_CHUNK_BYTES} bytes" if len(content) == MAX_CHUNK_BYTES else "is cut"
            raise ValueError(f"a compressed part of the bag {what}")
        return content

    return unpacked
