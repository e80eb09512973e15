"""HingeLoss: one class against all others, each with a margin of 1 (linear support vector machine).

bottom[0]  x       (N, ...)  scores; all axes after the first are K classes
bottom[1]  labels  (N,)      integers from 0 to K - 1
top[0]     L       scalar

m  = max(0, 1 + s x)         s = -1 for the class of the label, 1 for all others
L  = 1 / N sum of m          with ``norm: L1``
     1 / N sum of m²         with ``norm: L2``
dx = dL / N s [m > 0]        or dL / N 2 s m

Kept for backward: ``sign`` = s and ``margins`` = m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from layers.loss import labels as labels_of
from layers.loss.labels import LabelLoss
from netlib.blob import Blobs
from netlib.proto.schema import OneBased, numbered


@dataclass(frozen=True)
class HingeLossParameter:
    """The ``hinge_loss_param { ... }`` block."""

    norm: OneBased[Literal["L1", "L2"]] = numbered(1, "L1")


class HingeLoss(LabelLoss):
    """Sum of deficits to the margins."""

    param: HingeLossParameter

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        self.shape = labels_of.rows(self, bottom)
        top[0].reshape(())

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0].data.reshape(self.shape)
        labels, _ = labels_of.read(self, bottom, self.shape[1])
        self.sign = np.ones_like(x)
        self.sign[np.arange(len(x)), labels] = -1
        self.margins = np.maximum(1 + self.sign * x, 0)
        cost = self.margins if self.param.norm == "L1" else self.margins**2
        top[0].data[...] = cost.sum() / len(x)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[1]:
            raise self.fail("has no gradient for its labels; set propagate_down: false for them")
        if propagate_down[0]:
            slope = self.margins > 0 if self.param.norm == "L1" else 2 * self.margins
            dx = self.sign * slope * (top[0].diff / len(slope))
            bottom[0].diff[...] = dx.reshape(bottom[0].shape)
