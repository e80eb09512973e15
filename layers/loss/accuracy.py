"""Accuracy: fraction of items whose label is among the ``top_k`` highest scores.

It has no gradient.

bottom[0]  x       (..., classes, ...)  scores; the classes are on ``axis``
bottom[1]  labels  integers, one per position of x without that axis
top[0]     a       scalar
top[1]     a_c     (classes,) optional: the accuracy per class; 0 for a class without items
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layers.loss import labels as labels_of
from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class AccuracyParameter:
    """The ``accuracy_param { ... }`` block."""

    top_k: UInt = numbered(1, 1)
    axis: int = numbered(2, 1)
    ignore_label: int | None = numbered(3, None)  # items with this label are ignored


class Accuracy(Layer):
    """Top-k accuracy."""

    param: AccuracyParameter
    bottoms = (2, 2)
    tops = (1, 2)
    in_place = False
    has_gradient = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0]
        self.axis = self.canonical_axis(self.param.axis, x)
        places = x.shape[: self.axis] + x.shape[self.axis + 1 :]
        labels_of.check_shapes(self, bottom, places, same_items=False)
        self.classes = x.shape[self.axis]
        if self.param.top_k > self.classes:
            raise self.fail(
                f"top_k {self.param.top_k} is more than the {self.classes} classes", "top_k"
            )
        top[0].reshape(())
        if len(top) > 1:
            top[1].reshape(self.classes)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        scores = np.moveaxis(bottom[0].data, self.axis, -1).reshape(-1, self.classes)
        labels, counts = labels_of.read(self, bottom, self.classes, self.param.ignore_label)
        labels, scores = labels[counts], scores[counts]
        own = np.take_along_axis(scores, labels[:, None], 1)
        higher, equal = (scores > own).sum(axis=1), (scores == own).sum(axis=1) - 1
        right = higher + equal < self.param.top_k  # ties count as higher
        top[0].data[...] = right.mean() if len(right) else 0
        if len(top) > 1:
            total = np.bincount(labels, minlength=self.classes)
            top[1].data[...] = np.bincount(labels, right, self.classes) / np.maximum(total, 1)
