"""Memory of the copies that Split layers make of a blob."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol

from netlib.blob import Blob, Blobs
from netlib.layer import Layer


class Connected(Protocol):
    """A layer with its bottoms and tops (engine.py)."""

    layer: Layer
    bottom: Blobs
    top: Blobs


def share_splits(connections: Sequence[Connected], apart: Iterable[Connected] = ()) -> None:
    """Let the tops of a Split share the memory of its bottom, as in Caffe, so that all readers see
    what a caller writes; unless a later layer overwrites one of them, or a layer ``apart`` uses it.
    """
    writers = {blob: number for number, at in enumerate(connections) for blob in at.top}
    own = {blob for at in apart for blob in (*at.bottom, *at.top)}
    for number, at in enumerate(connections):
        for blob in copies_of(at):
            if all(writers[one] <= number and one not in own for one in (at.bottom[0], blob)):
                blob.share_data(at.bottom[0])
            else:
                blob.unshare_data()


def copies_of(at: Connected) -> Sequence[Blob]:
    """The tops of a Split; of another layer none."""
    return at.top if at.layer.type == "Split" else []


def of_users(connections: Sequence[Connected]) -> list[Connected]:
    """The layers of type Python, which may write what they read."""
    return [at for at in connections if at.layer.type == "Python"]
