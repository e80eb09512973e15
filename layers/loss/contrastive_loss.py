"""ContrastiveLoss: pull similar pairs together, push others at least a margin apart (siamese nets).

bottom[0]  a        (N, C), or with more axes of size 1
bottom[1]  b        (N, C)
bottom[2]  similar  (N,)       0 (also 0.5, as fractions are truncated): pair n is not similar;
                               other values: it is
top[0]     L        scalar

d = |a - b|, one distance per pair
L = 1 / (2 N) sum of  d²                 similar
                      max(0, margin - d)²   not similar; with ``legacy_version`` max(0, margin - d²)

da = dL / N g (a - b)
db = -da                                 no gradient for ``similar``
g  = 1                                   similar
     -(margin - d) / (d + 1e-4)          not similar, d < margin; the 1e-4 (Caffe) avoids
                                         a division by 0
     -1                                  not similar, d² < margin, ``legacy_version``
     0                                   not similar, beyond the margin

Kept for backward: ``difference`` = a - b and ``pull`` = g.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layers.loss.labels import items_and_values
from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class ContrastiveLossParameter:
    """The ``contrastive_loss_param { ... }`` block."""

    margin: float = numbered(1, 1.0)  # minimum distance of pairs that are not similar
    # compare d² with the margin, as in Caffe's first version
    legacy_version: bool = numbered(2, False)


class ContrastiveLoss(Layer):
    """Squared distance of similar pairs, squared deficit to the margin of others."""

    param: ContrastiveLossParameter
    bottoms = (3, 3)
    tops = (1, 1)
    in_place = False
    default_loss_weight = 1.0

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        self.shape = items_and_values(self, Blobs(bottom[:2]))
        N = self.shape[0]
        for blob, name, values in zip(
            bottom, self.spec.bottom, (bottom[0].channels, bottom[1].channels, 1)
        ):
            if blob.shape[:1] != (N,) or blob.count != N * values:
                expected = (
                    "(N, C), two axes" if blob is not bottom[2] else f"({N},), one value per pair"
                )
                raise self.fail(f"bottom {name!r} has shape {blob.shape}, expected {expected}")
        top[0].reshape(())

    def allow_force_backward(self, bottom_index: int) -> bool:
        return bottom_index != 2

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        a, b = (x.data.reshape(self.shape) for x in bottom[:2])
        similar = np.trunc(bottom[2].data.reshape(-1)) != 0
        self.difference = a - b
        squared, margin = (self.difference**2).sum(axis=1), self.param.margin
        if self.param.legacy_version:
            deficit = np.maximum(margin - squared, 0)
            cost, push = deficit, np.ones_like(squared)
        else:
            d = np.sqrt(squared)
            deficit = np.maximum(margin - d, 0)
            cost, push = deficit**2, deficit / (d + 1e-4)
        self.pull = np.where(similar, 1, -push * (deficit > 0))
        top[0].data[...] = np.where(similar, squared, cost).sum() / (2 * len(a))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[2]:
            raise self.fail("has no gradient for its labels; set propagate_down: false for them")
        gradient = self.pull[:, None] * self.difference * (top[0].diff / self.shape[0])
        for x, down, sign in zip(bottom, propagate_down, (1, -1)):
            if down:
                x.diff[...] = (sign * gradient).reshape(x.shape)
