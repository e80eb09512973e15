"""Gradients of a net grouped into buckets, in the order in which a backward pass completes them."""

from __future__ import annotations

from collections.abc import Sequence

from netlib.blob import Blob
from netlib.layer import Layer
from netlib.params import Param

MIN_BYTES = 2**20  # of a bucket: with this size, transfer time exceeds the overhead of a message


class Gradients:
    """The gradients of a net in buckets, those of the last layers first.

    The buckets do not depend on how the layers are run, so all ranks have the same. Parameters that are not trained
    are in none of them.

    parts  per bucket, the parameters
    """

    def __init__(self, layers: Sequence[Layer], learnable: Sequence[Param], min_bytes: int = MIN_BYTES) -> None:
        self._place = {layer.name: i for i, layer in enumerate(layers)}
        self._first: list[int] = []  # index of the first layer of each bucket
        self.parts: list[list[Blob]] = []
        for param in reversed(learnable):  # the owner is the first layer that uses it: the last to add to its diff
            if param.spec.lr_mult == 0:
                continue
            place = self._place[param.layer]
            if not self.parts or (place < self._first[-1] and sum(blob.bytes for blob in self.parts[-1]) >= min_bytes):
                self.parts.append([])
                self._first.append(place)
            self.parts[-1].append(param.blob)
            self._first[-1] = place

    def complete(self, layer: Layer) -> int:
        """Number of complete buckets when this layer and all after it have run backwards."""
        return sum(first >= self._place[layer.name] for first in self._first)
