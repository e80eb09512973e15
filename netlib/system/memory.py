"""Memory checks before allocation, with error messages that name the purpose of the memory.

Operating systems overcommit memory and kill processes that use it. Requests that certainly cannot fit are therefore
rejected: more than the machine has, free or not, or more than this process may use. Other requests are tried.
"""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from netlib.errors import LayerError

CGROUPS = Path("/sys/fs/cgroup")
PROC = Path("/proc")


class OutOfMemoryError(LayerError, MemoryError):
    """A request for more memory than is available.

    blob       the blob that needed the memory, or None
    in_layer   whether the message names the layer
    """

    def __init__(self, message: str, blob: object = None, in_layer: bool = False) -> None:
        super().__init__(message)
        self.blob, self.in_layer = blob, in_layer


def check(size: int, what: str, blob: object = None) -> None:
    """Raise OutOfMemoryError if ``size`` bytes cannot fit. ``what`` is their purpose, for example "for parameters"."""
    limit, owner = available()
    if size > limit:
        message = f"{format_bytes(size)} {what}; {owner} {format_bytes(int(limit))}"
        raise OutOfMemoryError(message, blob)


def zeros(shape: tuple[int, ...], dtype: DTypeLike, blob: object = None) -> NDArray[Any]:
    """Allocate an array of zeros for a blob. Raises OutOfMemoryError."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    what = f"for an array {shape}"
    check(size, what, blob)
    try:
        return np.zeros(shape, dtype)
    except MemoryError as error:
        message = f"{format_bytes(size)} {what}; the system did not provide it"
        raise OutOfMemoryError(message, blob) from error


def is_lacking(error: Exception) -> bool:
    """Whether an error reports a lack of memory; NumPy raises ValueError for arrays beyond any address space, OpenCV
    its own error.
    """
    begins = ("array is too big", "Maximum allowed dimension", "std::bad_alloc")
    return isinstance(error, MemoryError) or str(error).startswith(begins) or "Insufficient memory" in str(error)


def format_bytes(size: int) -> str:
    """Format as ``20 GB`` or ``8.6 TB``: two significant digits, or whole numbers from 10 on."""
    number, unit = float(size), 0
    while round(number) >= 1000 and unit < 6:
        number, unit = number / 1000, unit + 1
    return f"{number:.{0 if number >= 9.95 or not unit else 1}f} {('bytes', 'kB', 'MB', 'GB', 'TB', 'PB', 'EB')[unit]}"


def blocks(count: int, size: int) -> list[slice]:
    """Split ``range(count)`` into slices of ``size``, the last one shorter, for processing that limits memory."""
    return [slice(start, min(start + size, count)) for start in range(0, count, size)]


# ---------------------------------------------------------------------------------------------- limits


@functools.cache
def available() -> tuple[float, str]:
    """The smallest memory limit in bytes, and what imposes it as the start of a phrase; infinite if unknown."""
    limits = [(math.inf, ""), *((size, "this machine has") for size in _machine())]
    swap = next((size for size in _numbers(PROC / "meminfo", "SwapTotal:")), 0) * 1024
    limits += [(size, "this process may use") for size in [*_cgroups(swap), *_address_space()]]
    return min(limits, key=lambda limit: limit[0])


def _machine() -> Iterator[int]:
    """Memory plus swap space of the machine, on Linux."""
    memory, swap = (list(_numbers(PROC / "meminfo", name)) for name in ("MemTotal:", "SwapTotal:"))
    if memory:
        yield (memory[0] + sum(swap)) * 1024


def _cgroups(swap: int) -> Iterator[int]:
    """Limits of the control groups of this process, as set for containers; version 2, then 1."""
    with contextlib.suppress(OSError, ValueError):
        for line in (PROC / "self" / "cgroup").read_text(encoding="utf-8").splitlines():
            _, kinds, name = line.split(":", 2)
            if kinds not in ("", "memory"):
                continue
            root = CGROUPS / kinds
            group = root / name.lstrip("/")
            for folder in [group, *group.parents]:
                for size in _numbers(folder / ("memory.limit_in_bytes" if kinds else "memory.max")):
                    more = [] if kinds else list(_numbers(folder / "memory.swap.max"))
                    yield size + (more[0] if more else swap)
                if folder == root:
                    break


def _address_space() -> Iterator[int]:
    """The limit of ``ulimit -v``, where supported."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        size = resource.getrlimit(resource.RLIMIT_AS)[0]
        if size != resource.RLIM_INFINITY:
            yield size


def _numbers(path: Path, name: str = "") -> Iterator[int]:
    """The number after ``name`` in a file, or the only one; nothing if there is none."""
    with contextlib.suppress(OSError, ValueError):
        words = path.read_text(encoding="utf-8").split()
        at = words.index(name) + 1 if name else 0
        if at < len(words) and words[at].isdecimal():
            yield int(words[at])
