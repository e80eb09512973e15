"""What a net found in each image: classes, detections or other values, as lines, arrays of all
images, and pictures.
"""

from __future__ import annotations

import colorsys
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from netlib.blob import Array
from netlib.errors import NetlibError
from netlib.net import Net
from tools.common.console import aligned
from tools.common.net_images import Preprocessing

MAX_SHOWN = 20  # classes in a table of confusions; of more classes, mistakes
FONT, WHITE = cv2.FONT_HERSHEY_SIMPLEX, (255, 255, 255)


class Shown(NamedTuple):
    """How much of an image's result is shown.

    top        maximum number of classes or detections, the best first; None for all
    threshold  minimum confidence or value
    """

    top: int | None = 5
    threshold: float = -np.inf


class Results:
    """The values of one blob for each image.

    A top of DetectionOutput (1, 1, D, 7) has any number of rows per image: item, label, confidence
    and the corners xmin, ymin, xmax, ymax of a box, in units of the input's width and height.
    Other blobs have the image as first axis.

    labels         names of the classes, from the file ``source``
    shown          how much of an image's result is shown
    preprocessing  of the images

    Has further

    classes     number of classes of a DetectionOutput; 0 for another blob
    is_softmax  True if a Softmax makes the blob
    found       the values of each image
    """

    def __init__(
        self,
        net: Net,
        blob: str,
        labels: Sequence[str] | None,
        source: str | None,
        shown: Shown,
        preprocessing: Preprocessing,
    ) -> None:
        self.blob, self.labels, self.source = blob, labels, source
        self._shown, self._preprocessing = shown, preprocessing
        makers: list[Any] = [layer for layer in net.layers if blob in layer.spec.top]
        self.classes = (
            makers[-1].param.num_classes if makers and makers[-1].type == "DetectionOutput" else 0
        )
        self.is_softmax = any(layer.type == "Softmax" for layer in makers)
        self.found: list[Array] = []

    def add(self, array: Array, count: int) -> list[Array]:
        """Store and return the values of each of ``count`` images of a batch.

        Raises NetlibError.
        """
        if self.classes:
            rows = array.reshape(-1, 7)
            items = [rows[rows[:, 0] == number] for number in range(count)]
        elif array.shape[:1] == (count,):
            items = [item.copy() for item in array]
        else:
            raise NetlibError(
                f"blob {self.blob!r} has shape {array.shape} for {count} images; expected the image as "
                "first axis"
            )
        self.found += items
        return items

    def array(self) -> Array:
        """The values of all images: (images, ...), or (1, 1, D, 7) for detections, with the
        image as item.
        """
        if not self.classes:
            return np.stack(self.found)
        rows = [
            np.column_stack([np.full(len(item), n), item[:, 1:]])
            for n, item in enumerate(self.found)
        ]
        return np.concatenate(rows).astype(np.float32)[None, None]

    def lines(self, values: Array, shape: Sequence[int]) -> Iterator[str]:
        """Yield lines about an image of ``shape`` (H, W, C): its detections or classes, or the
        range of the values.

        Values are classes if a Softmax computed them or if there are labels. Boxes are in px of the
        image. Raises NetlibError.
        """
        if self.classes:
            yield f"{self.blob}: {np.count_nonzero(values[:, 1] >= 0)} detections"
            for confidence, name, _, box in self.boxes(values, shape):
                yield f"  {confidence:.4f}  {name}  {' '.join(f'{side:.0f}' for side in box)}"
        elif self.are_classes(values):
            self.check_labels(values.size)
            yield self.blob
            for number in self._best(values.ravel()):
                yield f"  {values.flat[number]:.4f}  {self._name(number)}"
        else:
            yield (
                f"{self.blob} {values.shape}, values from {values.min():.6g} to {values.max():.6g}, mean "
                f"{values.mean():.6g}"
            )

    def are_classes(self, values: Array) -> bool:
        """Whether the values of an image are one for each class."""
        is_row = max(values.shape, default=1) == values.size
        return not self.classes and is_row and bool(self.labels or self.is_softmax)

    def boxes(self, values: Array, shape: Sequence[int]) -> Iterator[tuple[float, str, int, Array]]:
        """Yield confidence, name and number of the class, and the box (4,) in px, of an image's
        detections, best first.

        Raises NetlibError.
        """
        self.check_labels(self.classes)
        rows = values[values[:, 1] >= 0]
        for row in rows[self._best(rows[:, 2])]:
            number = int(row[1])
            box = self._preprocessing.to_image(row[3:], shape)
            yield float(row[2]), self._name(number), number, box

    def drawn(self, values: Array, image: Array) -> NDArray[np.uint8]:
        """The image (H, W, 3), blue first, with the boxes of its detections and their classes.

        Raises NetlibError.
        """
        height, width = image.shape[:2]
        channels = image.reshape(height, width, -1)  # one of a grey image, three of a coloured one
        picture = np.repeat(channels, 3 // channels.shape[2], axis=2)
        unit = max(height, width) / 600
        line = max(1, round(2 * unit))
        scale = max(0.4, 0.6 * unit)
        found = list(self.boxes(values, image.shape))
        for confidence, name, number, box in reversed(found):  # the best on top
            hue = number * 0.618 % 1  # the golden ratio keeps neighbours apart
            colour = tuple(round(255 * part) for part in colorsys.hsv_to_rgb(hue, 0.9, 0.75))
            limits = np.tile((width, height), 2)
            left, top, right, bottom = (
                np.clip(box, -limits, 2 * limits).round().astype(int).tolist()
            )
            cv2.rectangle(picture, (left, top), (right, bottom), colour, line)
            text = f"{name} {confidence:.0%}"
            (w, h), below = cv2.getTextSize(text, FONT, scale, line)
            x = min(max(left, 0), max(width - w, 0))
            y = max(top, h + 2 * below)
            cv2.rectangle(picture, (x, y - h - 2 * below), (x + w, y), colour, cv2.FILLED)
            cv2.putText(picture, text, (x, y - below), FONT, scale, WHITE, line)
        return picture

    def check_labels(self, classes: int) -> None:
        """Raise NetlibError if there are labels, and not one for each class."""
        if self.labels is not None and len(self.labels) != classes:
            background = ", the background included" if self.classes else ""
            raise NetlibError(
                f"{self.source}: {len(self.labels)} labels, but blob {self.blob!r} has {classes} classes"
                f"{background}"
            )

    def _name(self, number: int) -> str:
        return self.labels[number] if self.labels else f"class {number}"

    def _best(self, values: Array) -> Array:
        """The indices of the values that are shown, the largest first."""
        order = np.argsort(-values, kind="stable")
        return order[~(values[order] < self._shown.threshold)][: self._shown.top]


class Confusion:
    """How often images of one class were taken for another; ``names`` are those of the classes."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self.counts = np.zeros((len(names), len(names)), np.int64)  # of true and found classes

    def add(self, path: str, truth: int, values: Array) -> None:
        """Add an image with a value for each class.

        Raises NetlibError for a class that the net does not have.
        """
        if not 0 <= truth < len(self._names):
            raise NetlibError(f"{path}: its label is {truth}; expected 0 to {len(self._names) - 1}")
        self.counts[truth, int(values.argmax())] += 1

    def lines(self) -> Iterator[str]:
        """Yield a table with a row for each true class, or the most frequent mistakes;
        then the accuracy.
        """
        yield from self._table() if len(self._names) <= MAX_SHOWN else self._mistakes()
        right = int(np.trace(self.counts))
        total = int(self.counts.sum())
        yield f"accuracy {right / max(total, 1):.4f} ({right} of {total})"
        true, found = (self.counts.any(axis=axis) for axis in (1, 0))
        if true.sum() > 1 and found.sum() == 1:
            only = self._names[int(found.argmax())]
            yield f"all images were taken for {only!r}: are the mean, the scale and the weights those of this net?"

    def _table(self) -> list[str]:
        """The lines of a table with a row for each true class."""
        heading = ["true \\ found", *self._names]
        rows = [[name, *map(str, counts)] for name, counts in zip(self._names, self.counts)]
        return aligned([heading, *rows]).split("\n")

    def _mistakes(self) -> Iterator[str]:
        """Yield a line for each of the most frequent mistakes, the most frequent first."""
        wrong = self.counts - np.diag(np.diag(self.counts))
        for at in np.argsort(-wrong.ravel(), kind="stable")[:MAX_SHOWN]:
            if wrong.flat[at]:
                name, other = (self._names[n] for n in divmod(int(at), len(self._names)))
                yield f"{name} taken for {other}: {wrong.flat[at]}"
