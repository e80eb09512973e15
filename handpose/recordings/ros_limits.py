"""What keeps rosbags from waiting for ever and from filling the memory: it trusts whatever a bag says.

check_files(path)     # before a bag is opened
limit_unpacking()     # once, before the first
"""

from __future__ import annotations

import bz2
import functools
import importlib
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

from netlib import files
from netlib.errors import DataError
from netlib.paths import names_in

BEGINNINGS = {".bag": b"#ROSBAG V2.0\n", ".db3": b"SQLite format 3\0", ".mcap": b"\x89MCAP0\r\n"}
PACKED = ".zstd"  # the ending of files that are compressed as a whole
LARGEST_YAML = 1 << 20  # bytes; of a bag with hundreds of topics it has a tenth of them
LARGEST_CHUNK = 1 << 28  # bytes; recorders close a chunk below 1 MB, or after a single message that is larger


def check_files(path: Path) -> None:
    """Are a bag's files what they are called? A pipe or a device never ends. Raises DataError."""
    if not path.is_dir():
        _check_file(path)
        return
    files.read_bytes(path / "metadata.yaml", "the bag", limit=LARGEST_YAML)
    for name in sorted(names_in(path)):
        if Path(name).suffix.lower() in (*BEGINNINGS, PACKED):
            _check_file(path / name)


def _check_file(path: Path) -> None:
    beginning = BEGINNINGS.get(path.suffix.lower(), b"")
    if not files.read_bytes(path, "the bag", first=len(beginning)).startswith(beginning):
        raise DataError(f"{path}: cannot read the bag: it does not begin with {beginning!r}, as {path.suffix} does")


@functools.cache
def limit_unpacking() -> None:
    """Have rosbags unpack no chunk and no message to more than LARGEST_CHUNK bytes; it then raises ValueError."""
    import lz4.frame
    from rosbags.rosbag1 import reader as ros1
    from rosbags.rosbag2 import storage_mcap as mcap

    ros2: Any = importlib.import_module("rosbags.rosbag2.reader")
    zstd = ros2.zstd  # Python's own or its backport
    unpack_lz4, unpack_zstd = _limited(lz4.frame.LZ4FrameDecompressor), _limited(zstd.ZstdDecompressor)
    ros1.decompressors.update(bz2=_limited(bz2.BZ2Decompressor), lz4=unpack_lz4)
    mcap.DECOMPRESSORS.update(
        lz4=lambda packed, size: unpack_lz4(packed), zstd=lambda packed, size: unpack_zstd(packed)
    )
    ros2.zstd = types.SimpleNamespace(decompress=unpack_zstd, open=zstd.open)


def _limited(decompressor: Callable[[], Any]) -> Callable[[bytes], bytes]:
    def unpacked(packed: bytes) -> bytes:
        one = decompressor()
        content: bytes = one.decompress(packed, max_length=LARGEST_CHUNK)
        if not one.eof:
            what = f"unpacks to more than {LARGEST_CHUNK} bytes" if len(content) == LARGEST_CHUNK else "is cut"
            raise ValueError(f"a compressed part of the bag {what}")
        return content

    return unpacked
