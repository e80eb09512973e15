"""SigmoidCrossEntropyLoss: cross-entropy of independent binary targets, each with its own sigmoid.

bottom[0]  x       (N, ...)  scores
bottom[1]  target  same number of items and of values per item: probabilities from 0 to 1
top[0]     L       scalar

p  = 1 / (1 + exp(-x))
L  = - 1 / M sum of  target log p + (1 - target) log(1 - p)
   =   1 / M sum of  max(x, 0) - target x + log(1 + exp(-|x|))     the same, without overflow
dx = dL / M (p - target)          0 where the target is ``ignore_label``

M (``loss_param { normalization }``): BATCH_SIZE (the default here, unlike in other losses) items,
FULL all values, VALID values that are not ignored, NONE 1. As in Caffe, targets are truncated to
integers before they are compared with ``ignore_label``: ``ignore_label: 0`` ignores 0.5 too. Kept
for backward: ``counts``, the mask of the targets that are not ignored.
"""

from __future__ import annotations

import numpy as np

from layers.activation.elementwise import positive, sigmoid
from layers.loss import labels as labels_of
from layers.loss.labels import LabelLoss, items_and_values
from netlib.blob import Blobs
from netlib.proto.messages import LossParameter


class SigmoidCrossEntropyLoss(LabelLoss):
    """Sigmoid and logistic loss combined, which is more accurate than separate layers."""

    param: LossParameter
    param_name = "loss_param"

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.normalization = labels_of.normalization(self.param, default="BATCH_SIZE")

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        self.shape = items_and_values(self, bottom)
        top[0].reshape(())

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, target = (blob.data.reshape(self.shape) for blob in bottom)
        self.counts = labels_of.counted(target, self.param.ignore_label)
        cost = positive(x) - target * x + np.log1p(np.exp(-np.abs(x)))
        self.divisor = labels_of.divisor(self.normalization, self.counts, len(x))
        top[0].data[...] = (cost if self.counts.all() else cost[self.counts]).sum() / self.divisor

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[1]:
            raise self.fail("has no gradient for its targets; set propagate_down: false for them")
        if propagate_down[0]:
            x, target = (blob.data.reshape(self.shape) for blob in bottom)
            dx = (sigmoid(x) - target) * self.counts * (top[0].diff / self.divisor)
            bottom[0].diff[...] = dx.reshape(bottom[0].shape)
