"""Memory is asked for before it is taken, and where there is not enough a line says what for.

Systems promise more memory than they have, and kill who uses it. So what certainly cannot fit is refused: more than the
machine has, used or not, or more than this process may use. What might fit is tried.
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
    """More memory than there is.

    blob       whose memory it is; None if it is no blob's
    in_layer   the message says which layer it is
    """

    def __init__(self, message: str, blob: object = None, in_layer: bool = False) -> None:
        super().__init__(message)
        self.blob, self.in_layer = blob, in_layer


def check(size: int, what: str, blob: object = None) -> None:
    """Raise OutOfMemoryError if so many bytes cannot fit; ``what`` they are follows their number."""
    most, who = available()
    if size > most:
        message = f"{written(size)} {what}; {who} {written(int(most))}"
        raise OutOfMemoryError(message, blob)


def zeros(shape: tuple[int, ...], dtype: DTypeLike, blob: object = None) -> NDArray[Any]:
    """An array of zeros, for a blob. Raises OutOfMemoryError."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    what = f"for an array {shape}"
    check(size, what, blob)
    try:
        return np.zeros(shape, dtype)
    except MemoryError as error:
        message = f"{written(size)} {what}; more than the system gives"
        raise OutOfMemoryError(message, blob) from error


def is_lacking(error: Exception) -> bool:
    """Is this an error for want of memory? NumPy has others for arrays that no computer could hold."""
    return isinstance(error, MemoryError) or str(error).startswith(("array is too big", "Maximum allowed dimension"))


def written(size: int) -> str:
    """``20 GB``, ``8.6 TB``: at most two digits that count, unless there are more before the point."""
    number, unit = float(size), 0
    while round(number) >= 1000 and unit < 6:
        number, unit = number / 1000, unit + 1
    return f"{number:.{0 if number >= 9.95 or not unit else 1}f} {('bytes', 'kB', 'MB', 'GB', 'TB', 'PB', 'EB')[unit]}"


def blocks(count: int, size: int) -> list[slice]:
    """``range(count)`` in slices of ``size``, the last one shorter: what is done block by block needs less memory."""
    return [slice(start, min(start + size, count)) for start in range(0, count, size)]


# ---------------------------------------------------------------------------------------------- what there is


@functools.cache
def available() -> tuple[float, str]:
    """The most bytes that this process can have, and whose limit it is, in words; infinite where nobody knows."""
    limits = [(math.inf, ""), *((size, "this machine has") for size in _machine())]
    swap = next((size for size in _numbers(PROC / "meminfo", "SwapTotal:")), 0) * 1024
    limits += [(size, "this process may use") for size in [*_cgroups(swap), *_address_space()]]
    return min(limits, key=lambda limit: limit[0])


def _machine() -> Iterator[int]:
    """Memory and swap space, on Linux."""
    memory, swap = (list(_numbers(PROC / "meminfo", name)) for name in ("MemTotal:", "SwapTotal:"))
    if memory:
        yield (memory[0] + sum(swap)) * 1024


def _cgroups(swap: int) -> Iterator[int]:
    """Limits of the groups that this process belongs to, as containers have them; version 2, then 1."""
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
    """``ulimit -v``, where there is such a thing."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        size = resource.getrlimit(resource.RLIMIT_AS)[0]
        if size != resource.RLIM_INFINITY:
            yield size


def _numbers(path: Path, name: str = "") -> Iterator[int]:
    """The number after a name, or the only one in a file; nothing if there is none."""
    with contextlib.suppress(OSError, ValueError):
        words = path.read_text(encoding="utf-8").split()
        at = words.index(name) + 1 if name else 0
        if at < len(words) and words[at].isdecimal():
            yield int(words[at])
