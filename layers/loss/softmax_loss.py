"""SoftmaxWithLoss: softmax cross-entropy against labels.

bottom[0]  x       (..., classes, ...)  scores; the classes are on ``axis``
bottom[1]  labels  same shape without that axis; integers
top[0]     L       scalar
top[1]     p       optional: the probabilities

p  = softmax of x
L  = - 1 / M sum of log p[label]
dx = dL / M (p - [class = label])          0 where the label is ``ignore_label``

M (``loss_param { normalization }``): VALID (default) labels that are not ignored, FULL all labels,
BATCH_SIZE items (the axes before ``axis``), NONE 1. Kept for backward: ``p``.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from layers.common.softmax import SoftmaxParameter, softmax
from layers.loss import labels as labels_of
from layers.loss.labels import LabelLoss
from netlib.blob import Array, Blobs
from netlib.proto.messages import LossParameter


class SoftmaxWithLoss(LabelLoss):
    """Softmax and multinomial logistic loss combined, which is more accurate than
    separate layers.
    """

    param: SoftmaxParameter
    param_name = "softmax_param"
    other_blocks: ClassVar[dict[str, type]] = {"loss_param": LossParameter}
    tops = (1, 2)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.loss_param: LossParameter = self.read_block("loss_param", LossParameter)
        self.normalization = labels_of.normalization(self.loss_param)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0]
        self.axis = self.canonical_axis(self.param.axis, x)
        self.places = x.shape[: self.axis] + x.shape[self.axis + 1 :]
        self.items = math.prod(x.shape[: self.axis])
        labels_of.check_shapes(self, bottom, self.places)
        top[0].reshape(())
        if len(top) > 1:
            top[1].reshape(x.shape)

    def _labels(self, bottom: Blobs) -> tuple[Array, Array]:
        """Labels and the mask of those that count, both with a class axis of size 1."""
        found = labels_of.read(
            self, bottom, bottom[0].shape[self.axis], self.loss_param.ignore_label
        )
        labels, counts = (np.expand_dims(each.reshape(self.places), self.axis) for each in found)
        return labels, counts

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        self.p = softmax(bottom[0].data, self.axis)
        labels, counts = self._labels(bottom)
        chosen = np.take_along_axis(self.p, labels, self.axis)
        tiny = np.finfo(np.float32).tiny  # as in Caffe, avoids the logarithm of zero
        # 0, not -0, if all labels are ignored
        total = 0 - (np.log(np.maximum(chosen, tiny)) * counts).sum()
        top[0].data[...] = total / labels_of.divisor(self.normalization, counts, self.items)
        if len(top) > 1:
            top[1].data[...] = self.p

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[1]:
            raise self.fail("has no gradient for its labels; set propagate_down: false for them")
        if propagate_down[0]:
            labels, counts = self._labels(bottom)
            scale = top[0].diff / labels_of.divisor(self.normalization, counts, self.items)
            weight = (counts * scale).astype(self.dtype)
            dx = np.multiply(self.p, weight, out=bottom[0].diff)
            np.put_along_axis(
                dx, labels, np.take_along_axis(dx, labels, self.axis) - weight, self.axis
            )
