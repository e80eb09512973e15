"""ImageData: batches of image files.

top[0]  data   (batch_size, C, H, W)  images, transformed (transform.py), in BGR order, or grey
                                      if not is_color
top[1]  label  (batch_size,)

``source`` is a list with one ``path label`` per line. The path is everything before the last space;
``root_folder`` is prepended to it without a slash. Images are resized to ``new_height`` x
``new_width`` if given. The first image of a batch determines its size; the others must have the
same, unless they are resized or cropped.

Images are read in the order of the list, starting over after the last. With ``shuffle``, every pass
has a new order, a pure function of the layer's seed and the number of the pass, so a *cursor*
(pass, index) is all that a snapshot needs to continue with the next image.
"""

from __future__ import annotations

import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from layers.data.images import planes, read_image, resize_image
from layers.data.reader import Reader
from layers.data.transform import TransformationParameter, Transformer, warn_of_misplaced
from netlib import files
from netlib.blob import Array, Blobs
from netlib.errors import DataError
from netlib.files.paths import find
from netlib.layer import warn_of_ignored
from netlib.proto.schema import UInt, numbered

Cursor = tuple[int, int]  # number of the pass, index in its order


@dataclass(frozen=True)
class ImageDataParameter:
    """The ``image_data_param { ... }`` block."""

    source: str = numbered(1)  # path of the list of images
    batch_size: UInt = numbered(4, 1)
    rand_skip: UInt = numbered(7, 0)  # skip a random number of images, less than this, at the start
    shuffle: bool = numbered(8, False)
    new_height: UInt = numbered(9, 0)  # 0: do not resize
    new_width: UInt = numbered(10, 0)
    is_color: bool = numbered(11, True)
    root_folder: str = numbered(12, "")  # prepended to every path in the list
    scale: float = numbered(2, 1.0)  # this and the following are ignored; see transform_param
    mean_file: str | None = numbered(3, None)
    crop_size: UInt = numbered(5, 0)
    mirror: bool = numbered(6, False)


class ImageData(Reader):
    """Reads image files.

    items   (path, label) of every image, in the order of the list
    cursor  start of the next batch
    notes   lines for the log
    """

    param: ImageDataParameter
    other_blocks: ClassVar[dict[str, type]] = {"transform_param": TransformationParameter}
    bottoms = (0, 0)
    tops = (2, 2)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        self.batch_size = self.batch_of()
        if (p.new_height == 0) != (p.new_width == 0):
            raise self.fail(
                f"new_height {p.new_height} and new_width {p.new_width} must be given together",
                "new_height" if p.new_height else "new_width",
            )
        self.transformer = Transformer(self)
        self.list = find(p.source, self.source)
        self.items, self.checksum = read_list(self.list)
        self.seed = int(self.rng.integers(2**62))
        skip = int(self.rng.integers(p.rand_skip)) if p.rand_skip else 0
        if skip >= len(self.items):
            raise self.fail(
                f"rand_skip {p.rand_skip} would skip all {len(self.items)} images of {p.source}",
                "rand_skip",
            )
        self.cursor: Cursor = (0, skip)
        self.notes = [f"{len(self.items)} images in {p.source}"]
        warn_of_misplaced(self, "scale", "mean_file", "crop_size", "mirror")
        warn_of_ignored(
            self, "force_color", "force_gray", block="transform_param", advice="; write is_color"
        )
        first, _ = self.items[self._order(0)[skip]]
        top[0].reshape(self.batch_size, *self.transformer.shape(self._read(first), first))
        top[1].reshape(self.batch_size)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """The shape depends only on the images; forward sets it."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        batch, cursor = self._next_batch()
        for i, item in batch:
            path, top[1].data[i] = self.items[item]
            image = self._read(path)
            if i == 0:
                top[0].reshape(self.batch_size, *self.transformer.shape(image, path))
            self.transformer.transform(image, top[0].data[i], path)
        self.cursor = cursor

    def skip_batch(self) -> list[tuple[int, int]]:
        """Move the cursor behind the next batch without reading it; returns its rows, and the
        index of each item.
        """
        batch, self.cursor = self._next_batch()
        return batch

    def _next_batch(self) -> tuple[list[tuple[int, int]], Cursor]:
        """Rows and indices of items of the next batch, and the start of the one after it."""
        turn, place = self.cursor
        order = self._order(turn)
        found = []
        for i in self.shard.places(self.batch_size):
            if i is not None:
                found.append((i, int(order[place])))
            place += 1
            if place == len(self.items):
                turn, place = turn + 1, 0
                order = self._order(turn)
        return found, (turn, place)

    def _read(self, path: str) -> Array:
        """Read and resize an image, (C, H, W)."""
        p = self.param
        named_in = self.source if p.root_folder else str(self.list)
        image = read_image(find(p.root_folder + path, named_in), p.is_color)
        return planes(resize_image(image, p.new_height, p.new_width) if p.new_height else image)

    def _order(self, turn: int) -> Array:
        """Order in which a pass visits the images."""
        if not self.param.shuffle:
            return np.arange(len(self.items))
        return np.random.default_rng([self.seed, turn]).permutation(len(self.items))

    # ----------------------------------------------------------------------------------- for resume

    def state(self) -> dict[str, Any]:
        return {
            **super().state(),
            "seed": self.seed,
            "cursor": list(self.cursor),
            "list": self._identity(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        super().restore(state)
        if "seed" not in state:  # state of a layer of another type
            return
        self.seed = int(state["seed"])
        if state.get("list") == self._identity():  # otherwise the position is meaningless
            turn, place = map(int, state["cursor"])
            self.cursor = (turn, place)
            if turn < 0 or not 0 <= place < len(self.items):
                raise ValueError(f"there is no image at {state['cursor']}")

    def reads(self) -> Any:
        """Identity of the list."""
        return self._identity()

    def _identity(self) -> list[Any]:
        return [len(self.items), self.checksum]


def read_list(path: Path) -> tuple[list[tuple[str, int]], int]:
    """Read the paths and labels of a list, and its checksum. Raises DataError."""
    text = files.read_text(path, "the list of images")
    items = []
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip():
            continue
        name, space, label = line.rpartition(" ")
        if not space and "\t" in line:
            raise DataError(
                f"{path}:{number}: found a tab between path and label; expected a space, as in Caffe"
            )
        label = label.strip()
        if not space or not label:
            raise DataError(
                f"{path}:{number}: {line.strip()!r} has no label; expected 'path label'"
            )
        if not re.fullmatch(r"[+-]?\d{1,10}", label):
            raise DataError(
                f"{path}:{number}: the label {label!r} is not a whole number; expected 'path label'"
            )
        if not -(2**31) <= int(label) < 2**31:
            raise DataError(
                f"{path}:{number}: the label {label} does not fit into 32 bits, as Caffe's labels do"
            )
        items.append((name, int(label)))
    if not items:
        raise DataError(f"{path}: the list of images is empty")
    return items, zlib.crc32(text.encode())
