"""Memory of the copies that Split layers make of a blob."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
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
    users = [*apart, *(at for at in connections if at.layer.type == "Python")]
    own = {blob for at in users for blob in (*at.bottom, *at.top)}
    for _, copy, blob in copies_of(connections):
        if copy in own or blob in own:
            copy.unshare_data()
        else:
            copy.share_data(blob)


def renew_splits(connections: Sequence[Connected], first: int) -> None:
    """Copy what a caller may have written to the bottoms of Split layers before layer ``first``,
    from which a part will run, to the tops that do not share their memory.
    """
    for number, copy, blob in copies_of(connections):
        if number < first and copy.owns_memory:
            copy.data[...] = blob.data
