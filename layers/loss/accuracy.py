"""Accuracy: the share of the items whose label is among the best ``top_k`` scores. No gradient.

bottom[0]  x       (..., classes, ...)  scores; the classes stand on ``axis``
bottom[1]  labels  same shape without that axis; whole numbers
top[0]     a       scalar
top[1]     a_c     (classes,) optional: the accuracy of each class; 0 for a class without items
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.schema import UInt, numbered


@dataclass(frozen=True)
class AccuracyParameter:
    """The ``accuracy_param { ... }`` block."""

    top_k: UInt = numbered(1, 1)
    axis: int = numbered(2, 1)
    ignore_label: int | None = numbered(3, None)  # items with this label do not count


class Accuracy(Layer):
    """How often the label wins."""

    param_type = AccuracyParameter
    bottoms = (2, 2)
    tops = (1, 2)
    in_place = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x, labels = bottom
        self.axis = self.canonical_axis(self.param.axis, x)
        self.places = x.shape[: self.axis] + x.shape[self.axis + 1 :]
        classes = x.shape[self.axis]
        if labels.count != int(np.prod(self.places)):
            raise self.fail(f"labels {self.spec.bottom[1]!r} {labels.shape} do not fit scores "
                            f"{self.spec.bottom[0]!r} {x.shape}; expected {self.places}")  # fmt: skip
        if not 1 <= self.param.top_k <= classes:
            raise self.fail(f"top_k {self.param.top_k} must be from 1 to the {classes} classes", "top_k")
        top[0].reshape(())
        if len(top) > 1:
            top[1].reshape(classes)

    def allow_force_backward(self, bottom_index: int) -> bool:
        return False

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        scores = np.moveaxis(bottom[0].data, self.axis, -1).reshape(-1, bottom[0].shape[self.axis])
        labels = bottom[1].data.reshape(-1).astype(np.intp)
        counts = np.ones(len(labels), bool)
        if self.param.ignore_label is not None:
            counts = labels != self.param.ignore_label
        labels, scores = labels[counts], scores[counts]
        if len(labels) and not 0 <= labels.min() <= labels.max() < scores.shape[1]:
            raise self.fail(f"a label in {self.spec.bottom[1]!r} is not from 0 to {scores.shape[1] - 1}")
        own = np.take_along_axis(scores, labels[:, None], 1)
        right = (scores > own).sum(axis=1) + (scores == own).sum(axis=1) - 1 < self.param.top_k  # ties count against
        top[0].data[...] = right.mean() if len(right) else 0
        if len(top) > 1:
            total = np.bincount(labels, minlength=scores.shape[1])
            top[1].data[...] = np.bincount(labels, right, scores.shape[1]) / np.maximum(total, 1)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if any(propagate_down):
            raise self.fail("has no gradient; set propagate_down: false, or leave it out of training")
