"""The gradients of a net in the order in which a backward pass completes them, for whoever need not wait for all."""

from __future__ import annotations

from collections.abc import Sequence

from netlib.blob import Blob
from netlib.layer import Layer
from netlib.params import Param

LEAST = 2**20  # bytes of a part: sending it takes longer than a message alone


class Gradients:
    """The gradients of a net in parts, those of the last layers first.

    The parts do not depend on how the layers run, so all ranks have the same ones. Parameters that are not trained are
    in none.

    parts  the parameters whose diffs they are
    """

    def __init__(self, layers: Sequence[Layer], learnable: Sequence[Param], least: int = LEAST) -> None:
        self._place = {layer.name: i for i, layer in enumerate(layers)}
        self._first: list[int] = []  # layer of each part
        self.parts: list[list[Blob]] = []
        for param in reversed(learnable):  # whose owner is the first layer that uses it: the last to add to its diff
            if param.spec.lr_mult == 0:
                continue
            place = self._place[param.layer]
            if not self.parts or (place < self._first[-1] and sum(blob.bytes for blob in self.parts[-1]) >= least):
                self.parts.append([])
                self._first.append(place)
            self.parts[-1].append(param.blob)
            self._first[-1] = place

    def complete(self, layer: Layer) -> int:
        """How many parts are, when this layer and all after it have run backwards."""
        return sum(first >= self._place[layer.name] for first in self._first)
