"""FFmpeg's containers and decoders, by PyAV: opened so that a file is all they read, and that no error is lost.

FFmpeg tells some errors to its log alone: a decoder fills a damaged part of a frame with that of the frame before, and
a file that is cut just ends.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from netlib import files, pictures
from netlib.errors import DataError, NetlibError, reason_of

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
    """What FFmpeg logs as an error within the block, by this thread: a line each."""
    logging = library().logging
    before, lines = logging.get_level(), list[str]()
    logging.set_level(logging.ERROR)
    try:
        with logging.Capture(True) as logs:
            yield lines
    finally:
        logging.set_level(before)
        lines.extend(" ".join(message.split()) for _, _, message in logs)


@contextlib.contextmanager
def opened(path: Path) -> Iterator[Any]:
    """A container, open for reading. Raises DataError; within the block it raises what FFmpeg raises."""
    av = library()
    with files.opened(path, "the video") as stream:
        head = stream.read(16)
        stream.seek(0)
        kind = next((kind for at, magic, kind in CONTAINERS if head[at:].startswith(magic)), None)
        if kind is None:  # nothing is guessed: some formats name other files, or addresses, to be read
            raise DataError(f"{path}: no video in Matroska, AVI or MP4; expected FFV1 of 16 bits in Matroska (.mkv)")
        container: Any = None
        try:
            with complaints() as said:
                container = av.open(stream, format=kind, metadata_errors="replace")
        except (av.FFmpegError, ValueError, MemoryError) as error:
            reason = "; ".join(said[:1]) or reason_of(error)
            raise DataError(f"{path}: cannot read the video: damaged or cut: {reason}") from error
        with contextlib.closing(container):
            yield container


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
    """The decoded frames of a stream. Raises what FFmpeg raises, and ValueError for what it would conceal."""
    context = stream.codec_context
    context.thread_count = 1  # its errors are those of this thread, and other cores have other work
    context.options = {"max_pixels": str(pictures.MOST_PIXELS)}
    for packet in packets(container, stream):
        with complaints() as said:
            decoded = packet.decode()
        if said:
            raise ValueError(said[0])
        yield from decoded
