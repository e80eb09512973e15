"""Blobs that share memory: the tops of a Split with its bottom, the bottoms of a Concat and the tops of a Slice with
the parts of the other blob.

The layers need no other computation, because NumPy skips the assignment of an array to itself. Two blobs share memory
only if no layer overwrites one of them after they are equal, and if no caller has accessed them. At a caller's first
access, a blob gets separate memory, with the same values (executor.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

from fast import aligned
from layers.common.concat import Concat
from layers.common.slice import Slice
from layers.common.split import Split
from netlib.blob import Array, Blob, Blobs
from netlib.engine.plain import Connection

Place = tuple[Blob, int]  # another blob, and the position of the first value there


def share(connections: Sequence[Connection], is_free: Callable[[Blob], bool]) -> set[Blob]:
    """Let blobs of these layers share memory; returns those that do. ``is_free`` is false for blobs that must not."""
    last_writers = {blob: number for number, at in enumerate(connections) for blob in at.top}
    places: dict[Blob, Place] = {}
    for number, at in reversed(list(enumerate(connections))):  # what is behind a blob decides where it is

        def is_kept(blob: Blob, number: int = number) -> bool:
            return last_writers[blob] <= number and _is_untouched(blob) and is_free(blob)

        layer = at.layer
        if type(layer) is Split and is_kept(source := at.bottom[0]):
            tops = [top for top in at.top if is_kept(top)]
            for top in [top for top in tops if top in places][:1]:
                places[source] = top, 0
            for top in tops:
                places.setdefault(top, (source, 0))
        elif type(layer) is Concat or type(layer) is Slice:
            (whole,), parts = (at.top, at.bottom) if type(layer) is Concat else (at.bottom, at.top)
            if is_kept(whole) and math.prod(whole.shape[: layer.axis]) == 1:
                for part, first in _with_positions(parts):
                    if is_kept(part):
                        places.setdefault(part, (whole, first))
    for part, (whole, first) in places.items():
        while whole in places:
            whole, position = places[whole]
            first += position
        adopt(part, whole.data.reshape(-1)[first : first + part.count].reshape(part.shape))
    return {*places, *(whole for whole, _ in places.values())}


def adopt(blob: Blob, data: Array) -> None:
    """Use ``data`` as the data of a blob, without a copy. Raises ValueError for another shape or dtype."""
    if data.shape != blob.shape or data.dtype != blob.dtype:
        raise ValueError(f"expected an array {blob.shape} of {blob.dtype}, not {data.shape} of {data.dtype}")
    blob._data = data


def separate(blob: Blob) -> None:
    """Give a blob that shares memory its own, with the same values."""
    if blob._data is not None:
        shared, blob._data = blob._data, aligned.empty(blob.shape, blob.dtype)
        blob._data[...] = shared


def _is_untouched(blob: Blob) -> bool:
    """Whether the blob has values, but no data yet, and no other blob's."""
    return blob.count > 0 and blob._data is None and blob.owns_memory


def _with_positions(parts: Blobs) -> Iterator[tuple[Blob, int]]:
    """The parts of a blob, and the positions of their first values."""
    first = 0
    for part in parts:
        yield part, first
        first += part.count
