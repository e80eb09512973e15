"""What a net found in each image: classes, detections or other values, as lines to print and arrays of all images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from netlib.blob import Array
from netlib.errors import NetlibError
from netlib.net import Net
from tools.common.net_images import Preprocessing


class Results:
    """The values of one blob for each image.

    A top of DetectionOutput (1, 1, D, 7) has any number of rows per image: item, label, confidence and the corners
    xmin, ymin, xmax, ymax of a box, in units of the input's width and height. Other blobs have the image as first axis.
    ``labels`` are the names of the classes, from the file ``source``.
    """

    def __init__(self, net: Net, blob: str, labels: Sequence[str] | None, source: str | None) -> None:
        self.blob, self.labels, self.source = blob, labels, source
        makers: list[Any] = [layer for layer in net.layers if blob in layer.spec.top]
        self.classes = makers[-1].param.num_classes if makers and makers[-1].type == "DetectionOutput" else 0
        self.is_softmax = any(layer.type == "Softmax" for layer in makers)
        self.found: list[Array] = []

    def add(self, array: Array, count: int) -> list[Array]:
        """Store and return the values of each of ``count`` images of a batch. Raises NetlibError."""
        if self.classes:
            rows = array.reshape(-1, 7)
            items = [rows[rows[:, 0] == number] for number in range(count)]
        elif array.shape[:1] == (count,):
            items = [item.copy() for item in array]
        else:
            raise NetlibError(f"blob {self.blob!r} has shape {array.shape} for {count} images; expected the image as "
                              "first axis")
        self.found += items
        return items

    def array(self) -> Array:
        """The values of all images: (images, ...), or (1, 1, D, 7) for detections, with the image as item."""
        if not self.classes:
            return np.stack(self.found)
        rows = [np.column_stack([np.full(len(item), n), item[:, 1:]]) for n, item in enumerate(self.found)]
        return np.concatenate(rows).astype(np.float32)[None, None]

    def lines(self, values: Array, top: int, preprocessing: Preprocessing, shape: Sequence[int]) -> Iterator[str]:
        """Yield lines about an image of ``shape`` (H, W, C): ``top`` detections or classes, or the range of the values.

        Values are classes if a Softmax computed them or if there are labels. Boxes are in px of the image.
        Raises NetlibError.
        """
        if self.classes:
            self._check_labels(self.classes)
            rows = values[values[:, 1] >= 0]
            yield f"{self.blob}: {len(rows)} detections"
            for row in rows[np.argsort(-rows[:, 2], kind="stable")[:top]]:
                box = preprocessing.to_image(row[3:], shape)
                yield f"  {row[2]:.4f}  {self._name(int(row[1]))}  {' '.join(f'{side:.0f}' for side in box)}"
        elif max(values.shape, default=1) == values.size and (self.labels or self.is_softmax):
            self._check_labels(values.size)
            yield self.blob
            for number in np.argsort(-values.ravel(), kind="stable")[:top]:
                yield f"  {values.flat[number]:.4f}  {self._name(number)}"
        else:
            yield (f"{self.blob} {values.shape}, values from {values.min():.6g} to {values.max():.6g}, mean "
                   f"{values.mean():.6g}")

    def _check_labels(self, classes: int) -> None:
        if self.labels is not None and len(self.labels) != classes:
            background = ", the background included" if self.classes else ""
            raise NetlibError(f"{self.source}: {len(self.labels)} labels, but blob {self.blob!r} has {classes} classes"
                              f"{background}")

    def _name(self, number: int) -> str:
        return self.labels[number] if self.labels else f"class {number}"
