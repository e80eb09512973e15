"""SoftmaxWithLoss: cross-entropy of a softmax against labels.

bottom[0]  x       (..., classes, ...)  scores; the classes stand on ``axis``
bottom[1]  labels  same shape without that axis; whole numbers
top[0]     L       scalar
top[1]     p       optional: the probabilities

p  = softmax of x
L  = - 1 / M sum of log p[label]
dx = dL / M (p - [class = label])          0 where the label is ``ignore_label``

M (``loss_param { normalization }``): VALID labels that are not ignored, FULL all labels, BATCH_SIZE items (the axes
before ``axis``), NONE 1.
Kept for backward: ``p``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import softmax

from netlib.blob import Array, Blobs
from netlib.layer import Layer
from netlib.messages import LossParameter
from netlib.schema import Engine, numbered


@dataclass(frozen=True)
class SoftmaxParameter:
    """The ``softmax_param { ... }`` block."""

    axis: int = numbered(2, 1)
    engine: Engine = numbered(1, "DEFAULT")  # accepted, ignored


class SoftmaxWithLoss(Layer):
    """Softmax and multinomial logistic loss in one, which is more exact than one after the other."""

    param_type = SoftmaxParameter
    param_name = "softmax_param"
    bottoms = (2, 2)
    tops = (1, 2)
    in_place = False
    loss_weight = 1.0

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.loss_param: LossParameter = self.read_block("loss_param", LossParameter)
        old = self.loss_param.normalize
        block = self.spec.blocks.get("loss_param")
        given = block is not None and block.values("normalization")
        self.normalization = self.loss_param.normalization
        if not given and old is not None:
            self.normalization = "VALID" if old else "BATCH_SIZE"

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x, labels = bottom
        self.axis = self.canonical_axis(self.param.axis, x)
        places = x.shape[: self.axis] + x.shape[self.axis + 1 :]
        if labels.count != int(np.prod(places)):
            raise self.fail(f"labels {self.spec.bottom[1]!r} {labels.shape} do not fit scores "
                            f"{self.spec.bottom[0]!r} {x.shape}; expected {places}")  # fmt: skip
        self.places = places
        top[0].reshape(())
        if len(top) > 1:
            top[1].reshape(x.shape)

    def allow_force_backward(self, bottom_index: int) -> bool:
        return bottom_index == 0

    def _labels(self, bottom: Blobs) -> tuple[Array, Array]:
        """Labels with the class axis, and which of them count."""
        labels = np.expand_dims(bottom[1].data.reshape(self.places).astype(np.intp), self.axis)
        counts = np.ones(labels.shape, bool)
        if self.loss_param.ignore_label is not None:
            counts = labels != self.loss_param.ignore_label
        classes = bottom[0].shape[self.axis]
        wrong = counts & ((labels < 0) | (labels >= classes))
        if wrong.any():
            raise self.fail(f"label {labels[wrong][0]} in {self.spec.bottom[1]!r}; expected 0 to {classes - 1}")
        return np.where(counts, labels, 0), counts

    def _divisor(self, counts: Array) -> float:
        if self.normalization == "VALID":
            return max(1, int(counts.sum()))
        if self.normalization == "FULL":
            return max(1, counts.size)
        return max(1, int(np.prod(self.places[: self.axis]))) if self.normalization == "BATCH_SIZE" else 1

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        self.p = softmax(bottom[0].data, axis=self.axis)
        labels, counts = self._labels(bottom)
        chosen = np.take_along_axis(self.p, labels, self.axis)
        tiny = np.finfo(np.float32).tiny  # as Caffe: the logarithm never sees a zero
        top[0].data[...] = -(np.log(np.maximum(chosen, tiny)) * counts).sum() / self._divisor(counts)
        if len(top) > 1:
            top[1].data[...] = self.p

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            labels, counts = self._labels(bottom)
            dx = self.p.copy()
            np.put_along_axis(dx, labels, np.take_along_axis(dx, labels, self.axis) - 1, self.axis)
            bottom[0].diff[...] = dx * counts * (top[0].diff / self._divisor(counts))
