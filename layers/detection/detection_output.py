"""DetectionOutput: detections from locations, confidences and prior boxes (SSD).

bottom[0]  locations    (N, P L 4)     L = 1 with ``share_location``, else one location per class
bottom[1]  confidences  (N, P C)       C = ``num_classes``
bottom[2]  priors       (1, 2, P 4)    boxes and variances of PriorBox
bottom[3]  ignored
top[0]     detections   (1, 1, D, 7)   item, label, confidence, xmin, ymin, xmax, ymax

1. A location l moves and scales its prior p, with variance v (with
   ``variance_encoded_in_target`` v = 1):

   CORNER       corner = corner of p + v l
   CORNER_SIZE  corner = corner of p + v l * size of p
   CENTER_SIZE  centre = centre of p + v l * size of p,    size = size of p * exp(v l)

   ``clip`` limits the corners to [0, 1].
2. For each class except the background: of the boxes whose confidence exceeds
   ``confidence_threshold``, the ``top_k`` with the highest confidence.
3. Non-maximum suppression in this order: a box is dropped if its overlap (intersection / union)
   with a kept box exceeds ``nms_threshold``. With eta < 1, each kept box multiplies the threshold
   by eta while it is above 0.5.
4. Of the boxes of all classes of an item, the ``keep_top_k`` with the highest confidence.

Rows are sorted by item, label and confidence. If there is no detection in the batch, each item
has a row of -1 behind its number. Negative top_k and keep_top_k: all. Of equal confidences the
first comes first.

``forward`` determines D and reshapes the top; before that it has one row. There is no gradient.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from netlib.blob import Array, Blobs
from netlib.layer import Layer, warn
from netlib.proto.schema import OneBased, UInt, numbered

ROWS = 32  # candidates whose overlaps with all later ones are computed together


@dataclass(frozen=True)
class NonMaximumSuppressionParameter:
    """The ``nms_param { ... }`` block."""

    nms_threshold: float = numbered(1, 0.3)  # maximum overlap of two detections of a class
    top_k: int = numbered(2, -1)  # candidates per class; negative: all
    eta: float = numbered(3, 1.0)  # factor of the threshold after each kept box


@dataclass(frozen=True)
class ResizeParameter:
    """How images were resized, for saved detections; ignored."""

    prob: float = numbered(1, 1.0)
    resize_mode: OneBased[Literal["WARP", "FIT_SMALL_SIZE", "FIT_LARGE_SIZE_AND_PAD"]] = numbered(
        2, "WARP"
    )
    height: UInt = numbered(3, 0)
    width: UInt = numbered(4, 0)
    height_scale: UInt = numbered(8, 0)
    width_scale: UInt = numbered(9, 0)
    pad_mode: OneBased[Literal["CONSTANT", "MIRRORED", "REPEAT_NEAREST"]] = numbered(5, "CONSTANT")
    pad_value: tuple[float, ...] = numbered(6, ())
    interp_mode: tuple[OneBased[Literal["LINEAR", "AREA", "NEAREST", "CUBIC", "LANCZOS4"]], ...] = (
        numbered(7, ())
    )


@dataclass(frozen=True)
class SaveOutputParameter:
    """Where Caffe writes detections to files; ignored."""

    output_directory: str = numbered(1, "")
    output_name_prefix: str = numbered(2, "")
    output_format: str = numbered(3, "")
    label_map_file: str = numbered(4, "")
    name_size_file: str = numbered(5, "")
    num_test_image: UInt | None = numbered(6, None)
    resize_param: ResizeParameter | None = numbered(7, None)


@dataclass(frozen=True)
class DetectionOutputParameter:
    """The ``detection_output_param { ... }`` block."""

    num_classes: UInt = numbered(1)  # C, including the background
    share_location: bool = numbered(2, True)  # one location for all classes
    background_label_id: int = numbered(3, 0)  # class that is never detected; -1: none
    nms_param: NonMaximumSuppressionParameter = numbered(4, NonMaximumSuppressionParameter())
    save_output_param: SaveOutputParameter | None = numbered(5, None)  # ignored
    code_type: OneBased[Literal["CORNER", "CENTER_SIZE", "CORNER_SIZE"]] = numbered(6, "CORNER")
    keep_top_k: int = numbered(7, -1)  # detections per item; negative: all
    variance_encoded_in_target: bool = numbered(8, False)  # the locations include the variance
    confidence_threshold: float | None = numbered(9, None)  # only boxes above it; by default all
    visualize: bool = numbered(10, False)  # ignored
    visualize_threshold: float | None = numbered(11, None)  # ignored
    save_file: str = numbered(12, "")  # ignored
    clip: bool = numbered(1000, False)  # limit the boxes to the image (OpenCV)


class DetectionOutput(Layer):
    """Decodes, selects and sorts detections."""

    param: DetectionOutputParameter
    bottoms = (3, 4)
    tops = (1, 1)
    in_place = False
    has_gradient = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p, nms = self.param, self.param.nms_param
        if p.num_classes == 0:
            raise self.fail("num_classes must be at least 1", "num_classes")
        if not nms.nms_threshold >= 0:
            raise self.fail(
                f"nms_threshold {nms.nms_threshold:g} must not be negative", "nms_param"
            )
        if not 0 < nms.eta <= 1:
            raise self.fail(f"eta {nms.eta:g} must be above 0 and at most 1", "nms_param")
        if p.visualize or (p.save_output_param and p.save_output_param.output_directory):
            warn(
                self,
                "does not show or save detections: visualize and save_output_param are ignored",
            )

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        N, boxes = bottom[0].shape[:1], bottom[2].shape
        are_boxes = len(boxes) >= 3 and boxes[:2] == (1, 2) and boxes[2] % 4 == 0
        if not are_boxes or bottom[2].count != 2 * boxes[2]:
            raise self.fail(
                f"bottom {self.spec.bottom[2]!r} has shape {boxes}, expected (1, 2, 4 per prior)"
            )
        P, C = boxes[2] // 4, self.param.num_classes
        self.prior_count = P
        per_prior = 4 if self.param.share_location else 4 * C
        for index, what, numbers in ((0, "locations", per_prior), (1, "confidences", C)):
            name, shape = self.spec.bottom[index], bottom[index].shape
            if not shape or shape[:1] != N or bottom[index].count != shape[0] * numbers * P:
                raise self.fail(
                    f"bottom {name!r} has shape {shape}, expected "
                    f"{numbers * P} {what} per item: {numbers} for each of the {P} priors"
                )
        top[0].reshape(1, 1, 1, 7)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        N, P, C = bottom[0].shape[0], self.prior_count, self.param.num_classes
        L = 1 if self.param.share_location else C
        locations = bottom[0].data.reshape(N, P, L, 4)
        confidences = bottom[1].data.reshape(N, P, C)
        priors, variances = bottom[2].data.reshape(2, P, 4)
        self._check(priors)
        found = [
            self._detect(item, *each, priors, variances)
            for item, each in enumerate(zip(locations, confidences))
        ]
        rows = np.concatenate(found) if found else np.zeros((0, 7))
        if not len(rows):
            rows = np.full((N, 7), -1.0)
            rows[:, 0] = np.arange(N)
        top[0].reshape(1, 1, *rows.shape)
        top[0].data[0, 0] = rows

    def _check(self, priors: Array) -> None:
        """Raise LayerError if a prior has no size that a location could scale."""
        if self.param.code_type != "CORNER":
            has_size = (priors[:, 2:] > priors[:, :2]).all(axis=1)
            for i in np.flatnonzero(~has_size)[:1]:
                numbers = ", ".join(f"{value:g}" for value in priors[i])
                raise self.fail(
                    f"prior {i} of {self.spec.bottom[2]!r} is ({numbers}); "
                    f"{self.param.code_type} needs xmin < xmax and ymin < ymax"
                )

    def _detect(
        self, item: int, locations: Array, confidences: Array, priors: Array, variances: Array
    ) -> Array:
        """Rows of one item: (P, L, 4) and (P, C) -> (D, 7)."""
        p = self.param
        found = [np.zeros((0, 7), self.dtype)]
        for label, scores in enumerate(np.ascontiguousarray(confidences.T)):
            if label == p.background_label_id:
                continue
            chosen = best(scores, p.confidence_threshold, p.nms_param.top_k)
            if len(chosen):
                location = locations[chosen, 0 if p.share_location else label]
                boxes = decode(p, priors[chosen], variances[chosen], location)
                kept = suppress(boxes, p.nms_param.nms_threshold, p.nms_param.eta)
                head = np.broadcast_to(np.array([item, label], self.dtype), (len(kept), 2))
                found.append(np.column_stack([head, scores[chosen[kept]], boxes[kept]]))
        rows = np.concatenate(found)
        if 0 <= p.keep_top_k < len(rows):
            rows = rows[np.sort(np.argsort(-rows[:, 2], kind="stable")[: p.keep_top_k])]
        return rows


def best(scores: Array, threshold: float | None, count: int) -> Array:
    """Indices of the ``count`` highest scores above the threshold, highest first; of equal ones
    the first first.
    """
    chosen = np.flatnonzero(scores > (np.finfo(np.float32).min if threshold is None else threshold))
    if 0 < count < len(chosen):
        lowest = -np.partition(-scores[chosen], count - 1)[count - 1]
        chosen = chosen[scores[chosen] >= lowest]  # so that few have to be sorted
    order = np.argsort(-scores[chosen], kind="stable")
    return chosen[order[:count] if count >= 0 else order]


def decode(p: DetectionOutputParameter, priors: Array, variances: Array, locations: Array) -> Array:
    """Boxes (K, 4) from their priors, variances and locations, all (K, 4)."""
    change = locations if p.variance_encoded_in_target else variances * locations
    size = priors[:, 2:] - priors[:, :2]
    if p.code_type == "CORNER":
        boxes = priors + change
    elif p.code_type == "CORNER_SIZE":
        boxes = priors + change * np.tile(size, 2)
    else:
        centre_of_prior = (priors[:, :2] + priors[:, 2:]) / 2
        centre = centre_of_prior + change[:, :2] * size
        half = size * np.exp(change[:, 2:]) / 2
        boxes = np.hstack([centre - half, centre + half])
    return boxes.clip(0, 1) if p.clip else boxes


def suppress(boxes: Array, threshold: float, eta: float = 1) -> list[int]:
    """Indices of the boxes that non-maximum suppression keeps; the first boxes are the best."""
    kept = []
    worst = np.zeros(len(boxes), boxes.dtype)  # largest overlap with a kept box so far
    for first in range(0, len(boxes), ROWS):
        rows = first + np.flatnonzero(worst[first : first + ROWS] <= threshold)
        for i, overlaps in zip(rows.tolist(), overlap(boxes[rows], boxes[first:])):
            if worst[i] <= threshold:
                kept.append(i)
                np.fmax(worst[first:], overlaps, out=worst[first:])
                if eta < 1 and threshold > 0.5:
                    threshold *= eta
    return kept


def overlap(a: Array, b: Array) -> Array:
    """Intersection / union of each box of a (K, 4) with each of b (M, 4): (K, M); NaN if
    both are empty.
    """
    x1, y1, x2, y2 = np.ascontiguousarray(a.T)[:, :, None]
    u1, v1, u2, v2 = np.ascontiguousarray(b.T)
    w, h = np.minimum(x2, u2), np.minimum(y2, v2)
    w -= np.maximum(x1, u1)
    h -= np.maximum(y1, v1)
    inside = np.maximum(w, 0, out=w)
    inside *= np.maximum(h, 0, out=h)
    area_a, area_b = (x2 - x1) * (y2 - y1), (u2 - u1) * (v2 - v1)
    return np.divide(inside, area_a + area_b - inside, out=inside)
