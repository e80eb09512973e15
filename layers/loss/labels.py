"""What losses over labels share: which labels count, and by what the sum is divided (``loss_param { normalization }``).

VALID       by the number of labels that are not ignored
FULL        by the number of all labels
BATCH_SIZE  by the number of items
NONE        by 1

Never by less than 1, so that a batch without labels costs nothing. Losses that compare bottoms item by item share
``items_and_values``.
"""

from __future__ import annotations

import math

import numpy as np

from netlib.blob import Array, Blobs
from netlib.layer import Layer
from netlib.proto import schema
from netlib.proto.messages import LossParameter

LEAST = float(np.float32(1e-20))  # what Caffe takes the logarithm of instead of a smaller probability


def normalization(param: LossParameter, default: str = "VALID") -> str:
    """What ``loss_param`` asks for; the older ``normalize`` counts only where the newer field is not given."""
    if schema.gives(param, "normalization"):
        return param.normalization
    if param.normalize is not None:
        return "VALID" if param.normalize else "BATCH_SIZE"
    return default


def divisor(normalization: str, counts: Array, items: int) -> int:
    """The number that a loss and its gradient are divided by; ``counts`` says of every label if it counts."""
    by = {"VALID": int(counts.sum()), "FULL": counts.size, "BATCH_SIZE": items, "NONE": 1}
    return max(1, by[normalization])


def check_shapes(layer: Layer, bottom: Blobs, places: tuple[int, ...], same_items: bool = True) -> None:
    """One label, in the second bottom, for each place of the scores in the first. Raises LayerError.

    ``same_items``: the first axis must agree too, as in Caffe's losses; the axes after it may be written otherwise.
    """
    x, labels = bottom[0].shape, bottom[1].shape
    if math.prod(labels) != math.prod(places) or (same_items and places and labels[:1] != places[:1]):
        raise layer.fail(f"labels {layer.spec.bottom[1]!r} {labels} do not fit scores {layer.spec.bottom[0]!r} {x}; "
                         f"expected {places}")  # fmt: skip


def rows(layer: Layer, bottom: Blobs) -> tuple[int, int]:
    """(N, K) of scores whose K classes are all axes after the first, with one label per item. Raises LayerError."""
    x = bottom[0]
    if not x.shape or not x.count:
        raise layer.fail(f"scores {layer.spec.bottom[0]!r} have shape {x.shape}, expected (N, classes)")
    check_shapes(layer, bottom, x.shape[:1])
    return x.shape[0], x.count // x.shape[0]


def counted(labels: Array, ignore: int | None) -> Array:
    """Which labels count: those that are not ``ignore``. As in Caffe, a label is cut to a whole number first."""
    if ignore is None:
        return np.ones(labels.shape, bool)
    with np.errstate(invalid="ignore"):  # NaN is no label to ignore
        return labels.astype(np.intp) != ignore


def read(layer: Layer, bottom: Blobs, classes: int, ignore: int | None = None) -> tuple[Array, Array]:
    """The labels in a row (0 where one is ignored), and which of them count. Raises LayerError if one is no class."""
    labels = bottom[1].data.reshape(-1)
    counts = counted(labels, ignore)
    wrong = counts & ~((labels > -1) & (labels < classes))  # NaN too
    if wrong.any():
        raise layer.fail(f"label {labels[wrong][0]:.9g} in {layer.spec.bottom[1]!r}; expected 0 to {classes - 1}")
    return np.where(counts, labels, 0).astype(np.intp), counts


def items_and_values(layer: Layer, bottom: Blobs) -> tuple[int, int]:
    """The number of items and of values per item, which all bottoms must share. Raises LayerError."""
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
