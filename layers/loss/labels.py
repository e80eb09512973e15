"""Helpers for losses over labels: ignored labels, and the divisor of the sum
(``loss_param { normalization }``).

VALID       number of labels that are not ignored
FULL        number of labels
BATCH_SIZE  number of items
NONE        1

The divisor is at least 1, so the loss of a batch without labels is 0. Losses that compare bottoms
item by item use ``items_and_values``.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from netlib.blob import Array, Blobs
from netlib.layer import Layer
from netlib.proto import schema
from netlib.proto.messages import LossParameter

MIN_PROBABILITY = float(np.float32(1e-20))  # Caffe's lower bound before it takes the logarithm


class LabelLoss(Layer):
    """Base class of losses of scores, the first bottom, and labels, which have no gradient."""

    bottoms: ClassVar[tuple[int, int | None]] = (2, 2)
    tops: ClassVar[tuple[int, int | None]] = (1, 1)
    in_place = False
    default_loss_weight = 1.0

    def allow_force_backward(self, bottom_index: int) -> bool:
        return bottom_index == 0


def normalization(param: LossParameter, default: str = "VALID") -> str:
    """The normalization in ``loss_param``; the older ``normalize`` applies only if the newer
    field is not set.
    """
    if schema.is_given(param, "normalization"):
        return param.normalization
    if param.normalize is not None:
        return "VALID" if param.normalize else "BATCH_SIZE"
    return default


def divisor(by: str, counts: Array, items: int) -> int:
    """The divisor of a loss and its gradient for a normalization; ``counts`` is false for
    ignored labels.
    """
    divisors = {"VALID": int(counts.sum()), "FULL": counts.size, "BATCH_SIZE": items, "NONE": 1}
    return max(1, divisors[by])


def check_shapes(
    layer: Layer, bottom: Blobs, places: tuple[int, ...], same_items: bool = True
) -> None:
    """Check that the second bottom has one label per position of the scores. Raises LayerError.

    ``same_items``: the first axis must agree too, as in Caffe's losses; later axes may have
    another layout.
    """
    x, labels = bottom[0].shape, bottom[1].shape
    other_items = same_items and places and labels[:1] != places[:1]
    if other_items or math.prod(labels) != math.prod(places):
        names = layer.spec.bottom
        raise layer.fail(
            f"labels {names[1]!r} {labels} do not fit scores {names[0]!r} {x}; expected {places}"
        )


def rows(layer: Layer, bottom: Blobs) -> tuple[int, int]:
    """Shape (N, K) of scores whose K classes are on all axes after the first, with one
    label per item.

    Raises LayerError.
    """
    x = bottom[0]
    if not x.shape or not x.count:
        raise layer.fail(
            f"scores {layer.spec.bottom[0]!r} have shape {x.shape}, expected (N, classes)"
        )
    check_shapes(layer, bottom, x.shape[:1])
    return x.shape[0], x.count // x.shape[0]


def counted(labels: Array, ignore: int | None) -> Array:
    """Mask of the labels that are not ``ignore``; as in Caffe, labels are truncated to
    integers first.
    """
    if ignore is None:
        return np.ones(labels.shape, bool)
    return labels.astype(np.intp) != ignore  # NaN never equals ``ignore``


def read(
    layer: Layer, bottom: Blobs, classes: int, ignore: int | None = None
) -> tuple[Array, Array]:
    """Labels as a flat array (0 where ignored), and the mask of those that count.

    Raises LayerError if out of range.
    """
    labels = bottom[1].data.reshape(-1)
    counts = counted(labels, ignore)
    wrong = counts & ~((labels > -1) & (labels < classes))  # includes NaN
    if wrong.any():
        name = layer.spec.bottom[1]
        raise layer.fail(f"label {labels[wrong][0]:.9g} in {name!r}; expected 0 to {classes - 1}")
    return np.where(counts, labels, 0).astype(np.intp), counts


def items_and_values(layer: Layer, bottom: Blobs) -> tuple[int, int]:
    """Number of items and of values per item, equal for all bottoms. Raises LayerError."""
    first, names = bottom[0], layer.spec.bottom
    items = first.shape[0] if first.shape else 0
    if items == 0:
        raise layer.fail(f"bottom {names[0]!r} {first.shape} has no items")
    for other, name in zip(bottom[1:], names[1:]):
        if other.count != first.count or other.shape[:1] != first.shape[:1]:
            raise layer.fail(
                f"bottoms {names[0]!r} {first.shape} and {name!r} {other.shape} must have "
                "the same number of items and of values per item"
            )
    return items, first.count // items
