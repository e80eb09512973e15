"""InfogainLoss: softmax cross-entropy weighted by a matrix over pairs of classes.

bottom[0]  x       (..., classes, ...)  scores; the K classes are on ``axis``
bottom[1]  labels  same shape without that axis; integers
bottom[2]  H       K * K values, row = label; optional, default from the file ``source``
top[0]     L       scalar
top[1]     p       optional: the probabilities

p  = softmax of x
L  = - 1 / M sum over labels and k of  H[label, k] log max(p[k], 1e-20)
dx = dL / M (p[k] sum of H[label] - H[label, k])          0 where the label is ``ignore_label``

M as in SoftmaxWithLoss (``loss_param { normalization }``). With the identity for H this is
SoftmaxWithLoss. Kept for backward: ``p``, and ``rows``, the row of H for each label.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from layers.common.softmax import softmax
from layers.loss import labels as labels_of
from layers.loss.labels import LabelLoss
from netlib.blob import Array, Blobs
from netlib.files.paths import find
from netlib.proto.binaryproto import read_blob
from netlib.proto.messages import LossParameter
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class InfogainLossParameter:
    """The ``infogain_loss_param { ... }`` block."""

    source: str | None = numbered(1, None)  # .binaryproto file with H
    axis: int = numbered(2, 1)  # axis of the classes


class InfogainLoss(LabelLoss):
    """Softmax and a logistic loss weighted by pairs of classes."""

    param: InfogainLossParameter
    other_blocks: ClassVar[dict[str, type]] = {"loss_param": LossParameter}
    bottoms = (2, 3)
    tops = (1, 2)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.loss_param: LossParameter = self.read_block("loss_param", LossParameter)
        if self.loss_param.normalize is not None:
            raise self.fail(
                "InfogainLoss does not support normalize; expected normalization: VALID or BATCH_SIZE"
            )
        self.from_file = None
        if len(bottom) < 3:
            if self.param.source is None:
                raise self.fail(
                    "needs the matrix H, as a third bottom or as infogain_loss_param { source: ... }"
                )
            self.from_file = read_blob(find(self.param.source, self.source))

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0]
        self.axis = self.canonical_axis(self.param.axis, x)
        self.classes, self.items = x.shape[self.axis], math.prod(x.shape[: self.axis])
        labels_of.check_shapes(self, bottom, x.shape[: self.axis] + x.shape[self.axis + 1 :])
        what, H = self._matrix(bottom)
        if H.size != self.classes**2:
            raise self.fail(
                f"H {what!r} {H.shape} has {H.size} values, expected {self.classes} x {self.classes}"
            )
        top[0].reshape(())
        if len(top) > 1:
            top[1].reshape(x.shape)

    def _matrix(self, bottom: Blobs) -> tuple[str, Array]:
        """The source of H, and H."""
        if self.from_file is not None:
            return str(self.param.source), self.from_file
        return self.spec.bottom[2], bottom[2].data

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        labels, counts = labels_of.read(self, bottom, self.classes, self.loss_param.ignore_label)
        H = self._matrix(bottom)[1].reshape(self.classes, self.classes)
        self.p = np.moveaxis(softmax(bottom[0].data, self.axis), self.axis, -1)
        self.rows = (H[labels] * counts[:, None]).reshape(self.p.shape)  # 0 for ignored labels
        self.divisor = labels_of.divisor(self.loss_param.normalization, counts, self.items)
        # 0 rather than -0
        total = 0 - (self.rows * np.log(np.maximum(self.p, labels_of.MIN_PROBABILITY))).sum()
        top[0].data[...] = total / self.divisor
        if len(top) > 1:
            top[1].data[...] = np.moveaxis(self.p, -1, self.axis)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if any(propagate_down[1:]):
            raise self.fail(
                "has no gradient for its labels and for H; set propagate_down: false for them"
            )
        if propagate_down[0]:
            dx = self.p * self.rows.sum(axis=-1, keepdims=True) - self.rows
            share = top[0].diff / self.divisor
            bottom[0].diff[...] = np.moveaxis(dx, -1, self.axis) * share
