"""Blobs that share memory: the tops of a Split with its bottom, the bottoms of a Concat and the tops of a Slice with
the parts of the other blob.

The layers need no other computation, because NumPy skips the assignment of an array to itself. Two blobs share memory
only if no layer overwrites one of them after they are equal, and if no caller has accessed them. At a caller's first
access, a blob gets separate memory, with the same values (executor.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

from fast.tiles import FastBlob
from layers.common.concat import Concat
from layers.common.slice import Slice
from layers.common.split import Split
from netlib.blob import Blob, Blobs
from netlib.engine.plain import Connection

Place = tuple[Blob, int]  # another blob, and the position of the first value there


def share(connections: Sequence[Connection], is_free: Callable[[Blob], bool]) -> set[FastBlob]:
    """Let blobs of these layers share memory; returns those that do. ``is_free`` is false for blobs that must not."""
    last_writers = {blob: number for number, at in enumerate(connections) for blob in at.top}
    places: dict[Blob, Place] = {}
    for number, at in reversed(list(enumerate(connections))):  # what is behind a blob decides where it is

        def is_kept(blob: Blob, number: int = number) -> bool:
            return last_writers[blob] <= number and isinstance(blob, FastBlob) and blob.is_untouched() and is_free(blob)

        if type(at.layer) is Split and is_kept(at.bottom[0]):
            tops = [top for top in at.top if is_kept(top)]
            for top in [top for top in tops if top in places][:1]:
                places[at.bottom[0]] = top, 0
            for top in tops:
                places.setdefault(top, (at.bottom[0], 0))
        elif isinstance(at.layer, (Concat, Slice)) and type(at.layer) in (Concat, Slice):
            (whole,), parts = (at.top, at.bottom) if isinstance(at.layer, Concat) else (at.bottom, at.top)
            if is_kept(whole) and math.prod(whole.shape[: at.layer.axis]) == 1:
                for part, first in _with_positions(parts):
                    if is_kept(part):
                        places.setdefault(part, (whole, first))
    return {blob for part in places for blob in _placed(part, places)}


def _with_positions(parts: Blobs) -> Iterator[tuple[Blob, int]]:
    """The parts of a blob, and the positions of their first values."""
    first = 0
    for part in parts:
        yield part, first
        first += part.count


def _placed(part: Blob, places: dict[Blob, Place]) -> tuple[FastBlob, FastBlob]:
    """Let ``part`` use the memory of the outermost blob around it, and return both."""
    whole, first = part, 0
    while whole in places:
        whole, position = places[whole]
        first += position
    assert isinstance(part, FastBlob) and isinstance(whole, FastBlob)
    part.adopt(whole.data.reshape(-1)[first : first + part.count].reshape(part.shape))
    return part, whole
