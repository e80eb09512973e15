"""Memory of the copies that Split layers make of a blob."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Set
from typing import Protocol

from netlib.blob import Blob, Blobs
from netlib.layer import Layer


class Connected(Protocol):
    """A layer with its bottoms and tops (engine.py)."""

    layer: Layer
    bottom: Blobs
    top: Blobs


def copies_of(connections: Sequence[Connected]) -> Iterator[tuple[int, Blob, Blob]]:
    """The tops of Split layers: the number of the layer, the top and the bottom, unless a later
    layer overwrites one of them.
    """
    writers = {blob: number for number, at in enumerate(connections) for blob in at.top}
    for number, at in enumerate(connections):
        for copy in at.top if at.layer.type == "Split" else []:
            if writers[copy] == number and writers[at.bottom[0]] <= number:
                yield number, copy, at.bottom[0]


def share_splits(connections: Sequence[Connected], apart: Iterable[Connected] = ()) -> None:
    """Let the tops of a Split share the memory of its bottom, as in Caffe, so that all readers see
    what a caller writes; unless a layer ``apart`` uses one of them, or a layer of type Python,
    which may write what it reads.
    """
    own = used_by(apart) | used_by_python(connections)
    for _, copy, blob in copies_of(connections):
        if copy in own or blob in own:
            copy.unshare_data()
        else:
            copy.share_data(blob)


def renew_splits(
    connections: Sequence[Connected], first: int | None = None, kept: Set[Blob] = frozenset()
) -> None:
    """Copy what a caller may have written to the bottoms of Split layers before layer ``first``,
    from which a part will run, to the tops that do not share their memory; not from or to blobs
    of ``kept``.
    """
    for number, copy, blob in copies_of(connections):
        is_before = first is None or number < first
        if is_before and copy.owns_memory and kept.isdisjoint((copy, blob)):
            copy.copy_data(blob)


def used_by(connections: Iterable[Connected]) -> set[Blob]:
    """The blobs that layers read or write."""
    return {blob for at in connections for blob in (*at.bottom, *at.top)}


def used_by_python(connections: Iterable[Connected]) -> set[Blob]:
    """The blobs of layers of type Python, which may write what they read."""
    return used_by(at for at in connections if at.layer.type == "Python")
