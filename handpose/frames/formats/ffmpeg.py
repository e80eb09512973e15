"""FFmpeg's containers and decoders through PyAV, restricted to one file and without hidden errors.

FFmpeg only logs some errors: a decoder fills a damaged part of a frame from the previous frame, and a truncated file
just ends.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from netlib import files
from netlib.errors import DataError, NetlibError, reason_of, system_error_of
from netlib.files import pictures

SEGMENT = b"\x18\x53\x80\x67"  # the element of Matroska that holds all others
CONTAINERS = ((0, b"\x1a\x45\xdf\xa3", "matroska"), (0, b"RIFF", "avi"), (4, b"ftyp", "mov"))


def library() -> Any:
    """The package av. Raises NetlibError if it is missing."""
    try:
        import av
    except ImportError as error:
        raise NetlibError(f"PyAV is missing: pip install av ({reason_of(error)})") from error
    return av


@contextlib.contextmanager
def complaints() -> Iterator[list[str]]:
    """The errors that FFmpeg logs within the block in this thread, one line each."""
    logging = library().logging
    before, skips, lines = logging.get_level(), logging.get_skip_repeated(), list[str]()
    logging.set_level(logging.ERROR)
    logging.set_skip_repeated(False)  # the same error of an earlier file counts, too
    try:
        with logging.Capture(True) as logs:
            yield lines
    finally:
        logging.set_level(before)
        logging.set_skip_repeated(skips)
        lines.extend(" ".join(message.split()) for _, _, message in logs)


@contextlib.contextmanager
def opened(path: Path) -> Iterator[Any]:
    """A container, open for reading. Raises DataError; within the block it raises what FFmpeg raises."""
    av = library()
    with files.opened(path, "the video") as stream:
        try:
            head = stream.read(16)
        except OSError as error:
            raise DataError(f"{path}: cannot read the video: {reason_of(error)}") from error
        stream.seek(0)
        kind = next((kind for at, magic, kind in CONTAINERS if head[at:].startswith(magic)), None)
        if kind is None:  # the format is not guessed, because some formats refer to other files or addresses
            raise DataError(f"{path}: no video in Matroska, AVI or MP4; expected FFV1 of 16 bits in Matroska (.mkv)")
        container: Any = None
        try:
            with complaints() as said:
                # PyAV 19 has no such option any more.
                names = {"metadata_errors": "replace"} if int(av.__version__.split(".")[0]) < 19 else {}
                container = av.open(stream, format=kind, **names)
        except (av.FFmpegError, OSError, ValueError, MemoryError) as error:
            if system := system_error_of(error):
                raise DataError(f"{path}: cannot read the video: {reason_of(system)}") from error
            reason = "; ".join(said[:1]) or reason_of(error)
            raise DataError(f"{path}: cannot read the video: damaged or cut: {reason}") from error
        with contextlib.closing(container):
            yield container


def missing(path: Path) -> str:
    """A description of what a container lacks at its end, by its header; empty if nothing, or if unknown."""
    with files.opened(path, "the video") as stream:
        head, size = stream.read(4096), path.stat().st_size
    end = _end(head)
    if end is None or size >= end:
        return ""
    return "its writer was interrupted" if end == math.inf else f"the file ends at byte {size} of {end:.0f}"


def _end(head: bytes) -> float | None:
    """The byte at which a container ends; infinity if its writer did not fill it in, None if it has no such field."""
    if head.startswith(b"RIFF"):
        return 8 + int.from_bytes(head[4:8], "little")
    at = sum(_vint(head, 4)) if head.startswith(CONTAINERS[0][1]) else math.inf
    if at > len(head) or head[int(at) :][:4] != SEGMENT:
        return None
    return sum(_vint(head, int(at) + 4))


def _vint(data: bytes, at: int) -> tuple[float, int]:
    """A variable-length EBML integer, and where it ends; all ones mean unknown."""
    first = data[at] if at < len(data) else 0
    length = 9 - first.bit_length()
    number = int.from_bytes(data[at : at + length], "big") & ((1 << 7 * length) - 1)
    return (math.inf if number == (1 << 7 * length) - 1 else number), at + length


def packets(container: Any, stream: Any) -> Iterator[Any]:
    """The packets of a stream. Raises EOFError where the file ends before they do."""
    source = container.demux(stream)
    while True:
        with complaints() as said:
            packet = next(source, None)
        if said:
            raise EOFError(said[0])
        if packet is None:
            return
        yield packet


def frames(container: Any, stream: Any) -> Iterator[Any]:
    """The decoded frames of a stream. Raises FFmpeg's errors, and ValueError for those that FFmpeg only logs."""
    context = stream.codec_context
    context.thread_count = 1  # errors are collected per thread, and other cores are busy
    context.options = {"max_pixels": str(pictures.MAX_PIXELS)}
    for packet in packets(container, stream):
        with complaints() as said:
            decoded = packet.decode()
        if said:
            raise ValueError(said[0])
        yield from decoded
