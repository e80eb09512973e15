"""DummyData: constant or random values, for testing a net without data.

top[i]  shape and values from ``dummy_data_param { shape { ... } data_filler { ... } }``, one for
        each top or one for all; constants are written once, random values for every batch
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from netlib.blob import Blobs
from netlib.fillers import Filler, fill
from netlib.layer import Layer
from netlib.proto.messages import BlobShape
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class DummyDataParameter:
    """The ``dummy_data_param { ... }`` block."""

    data_filler: tuple[Filler, ...] = numbered(1, ())  # default: constant 0
    shape: tuple[BlobShape, ...] = numbered(6, ())
    # older form of shape: four sizes, each once or once per top
    num: tuple[UInt, ...] = numbered(2, ())
    channels: tuple[UInt, ...] = numbered(3, ())
    height: tuple[UInt, ...] = numbered(4, ())
    width: tuple[UInt, ...] = numbered(5, ())


class DummyData(Layer):
    """Generated data."""

    param: DummyDataParameter
    bottoms = (0, 0)
    tops = (1, None)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        shapes = self._shapes(len(top))
        self._require_one_or_each("shape", shapes, len(top))
        given = self.param.data_filler or (Filler(),)
        self._require_one_or_each("data_filler", given, len(top))
        for shape in shapes:
            if min(shape, default=0) < 0:
                raise self.fail(f"shape {tuple(shape)} has a negative size", "shape")
        self.fillers = [given[i % len(given)] for i in range(len(top))]
        for i, blob in enumerate(top):
            blob.reshape(shapes[i % len(shapes)])
            fill(blob.data, self.fillers[i], self.rng)

    def _shapes(self, tops: int) -> list[tuple[int, ...]]:
        """The shapes that the options give, in either form. Raises LayerError."""
        p = self.param
        shapes: list[tuple[int, ...]] = [shape.dim for shape in p.shape]
        older = {"num": p.num, "channels": p.channels, "height": p.height, "width": p.width}
        if not any(older.values()):
            return shapes
        if shapes:
            raise self.fail(
                "has both shape and the older num, channels, height, width; expected one", "shape"
            )
        for name, sizes in older.items():
            self._require_one_or_each(name, sizes, tops)
        return [tuple(sizes[i % len(sizes)] for sizes in older.values()) for i in range(tops)]

    def _require_one_or_each(self, name: str, given: Sequence[object], tops: int) -> None:
        """Raise LayerError unless an option has one value, or one for each top."""
        if len(given) not in (1, tops):
            raise self.fail(f"has {tops} tops, but {len(given)} of {name}", name)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Shapes are set once, in setup."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        for blob, filler in zip(top, self.fillers):
            if filler.type != "constant":
                fill(blob.data, filler, self.rng)
