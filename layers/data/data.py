"""Data: batches of images from an LMDB database, as written by Caffe's convert_imageset.

top[0]  data   (batch_size, C, H, W)  images, transformed (transform.py)
top[1]  label  (batch_size,)          if there is a second top

An entry is a Datum (images.py): bytes, floats, or an encoded image, which OpenCV decodes. Entries
are read in the order of their keys, starting over after the last. The first image of a batch
determines its size; the others must have the same, unless they are cropped.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from layers.data.images import decode_datum
from layers.data.lmdb_file import Cursor, Database
from layers.data.reader import Reader
from layers.data.transform import TransformationParameter, Transformer, warn_of_misplaced
from netlib.blob import Array, Blobs
from netlib.errors import DataError
from netlib.files.paths import find
from netlib.layer import warn_of_ignored
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class DataParameter:
    """The ``data_param { ... }`` block."""

    source: str = numbered(1)  # folder of the database
    batch_size: UInt = numbered(4)
    # Caffe's default; only LMDB is supported
    backend: Literal["LEVELDB", "LMDB"] = numbered(8, "LEVELDB")
    prefetch: UInt = numbered(10, 4)  # batches read ahead; accepted, ignored
    cache: bool = numbered(10001, False)  # keep all in memory (NVIDIA's Caffe); accepted, ignored
    # this and the following are ignored, as in Caffe; see transform_param
    rand_skip: UInt = numbered(7, 0)
    force_encoded_color: bool = numbered(9, False)
    scale: float = numbered(2, 1.0)
    mean_file: str | None = numbered(3, None)
    crop_size: UInt = numbered(5, 0)
    mirror: bool = numbered(6, False)


class Data(Reader):
    """Reads a database.

    entries  number of images in it
    key      key of the first entry of the next batch
    notes    lines for the log
    """

    param: DataParameter
    other_blocks: ClassVar[dict[str, type]] = {"transform_param": TransformationParameter}
    bottoms = (0, 0)
    tops = (1, 2)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        self.batch_size = self.batch_of()
        if p.backend == "LEVELDB":
            raise self.fail(
                "backend LEVELDB, Caffe's default, is not supported; convert the database to LMDB (with "
                "Caffe's convert_imageset, from its images) and set backend: LMDB, or read the images with "
                "an ImageData layer",
                "backend",
            )
        self.transformer = Transformer(self)
        self.path = find(p.source, self.source)
        database = Database(self.path)
        self.entries, self.cursor = database.entries, Cursor(database)
        if not self.cursor.first():
            raise DataError(f"{self.path}: the database has no entries")
        self.key = self.cursor.key
        self.notes = [f"{self.entries} images in {p.source}"]
        warn_of_misplaced(self, "scale", "mean_file", "crop_size", "mirror")
        warn_of_ignored(
            self, "force_encoded_color", advice="; write force_color in transform_param"
        )
        warn_of_ignored(self, "rand_skip")
        image, _, what = self._entry()
        top[0].reshape(self.batch_size, *self.transformer.shape(image, what))
        if len(top) > 1:
            top[1].reshape(self.batch_size)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """The shape depends only on the images; forward sets it."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        if self.cursor.key != self.key and not self.cursor.set_key(self.key):
            self.cursor.first()
        for i in self.shard.places(self.batch_size):
            if i is not None:
                image, label, what = self._entry()
                if i == 0:
                    top[0].reshape(self.batch_size, *self.transformer.shape(image, what))
                self.transformer.transform(image, top[0].data[i], what)
                if len(top) > 1:
                    top[1].data[i] = label
            if not self.cursor.next():
                self.cursor.first()
        self.key = self.cursor.key

    def _entry(self) -> tuple[Array, int, str]:
        """Image and label of the current entry, and its description for messages."""
        what = f"{self.path}: entry {self.cursor.key.decode(errors='backslashreplace')!r}"
        return *decode_datum(self.cursor.value(), self.transformer.color, what), what

    # ----------------------------------------------------------------------------------- for resume

    def state(self) -> dict[str, Any]:
        return {**super().state(), "key": self.key.hex(), "database": self._identity()}

    def restore(self, state: dict[str, Any]) -> None:
        super().restore(state)
        if state.get("database") == self._identity():  # otherwise the position is meaningless
            self.key = bytes.fromhex(state["key"])

    def reads(self) -> Any:
        """Identity of the database and its next entry."""
        return [*self._identity(), self.key.hex(), zlib.crc32(self.cursor.value())]

    def _identity(self) -> list[Any]:
        return [self.path.name, self.entries]
