"""DummyData: constant or random values, for testing a net without data.

top[i]  shape and values from ``dummy_data_param { shape { ... } data_filler { ... } }``, one for
        each top or one for all; constants are written once, random values for every batch
"""

from __future__ import annotations

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
        p = self.param
        older = {"num": p.num, "channels": p.channels, "height": p.height, "width": p.width}
        shapes: list[tuple[int, ...]] = [s.dim for s in p.shape]
        if any(older.values()):
            if shapes:
                raise self.fail(
                    "has both shape and the older num, channels, height, width; expected one",
                    "shape",
                )
            for what, sizes in older.items():
                if len(sizes) not in (1, len(top)):
                    raise self.fail(f"has {len(top)} tops, but {len(sizes)} of {what}", what)
            for i in range(len(top)):
                shapes.append(tuple(sizes[i % len(sizes)] for sizes in older.values()))
        for what, given in (("shape", shapes), ("data_filler", p.data_filler)):
            if len(given) not in (0 if what == "data_filler" else 1, 1, len(top)):
                raise self.fail(f"has {len(top)} tops, but {len(given)} of {what}", what)
        for shape in shapes:
            if min(shape, default=0) < 0:
                raise self.fail(f"shape {tuple(shape)} has a negative size", "shape")
        fillers = p.data_filler or (Filler(),)
        self.fillers = [fillers[i % len(fillers)] for i in range(len(top))]
        for i, blob in enumerate(top):
            blob.reshape(shapes[i % len(shapes)])
            fill(blob.data, self.fillers[i], self.rng)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """Shapes are set once, in setup."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        for blob, filler in zip(top, self.fillers):
            if filler.type != "constant":
                fill(blob.data, filler, self.rng)
