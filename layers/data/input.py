"""Input: a blob that the caller writes.

top[i]  shape from ``input_param { shape { dim: ... } }``, one for each top or one for all
"""

from __future__ import annotations

from dataclasses import dataclass

from netlib.blob import Blobs
from netlib.layer import Layer
from netlib.proto.messages import BlobShape
from netlib.proto.schema import numbered


@dataclass(frozen=True)
class InputParameter:
    """The ``input_param { ... }`` block."""

    shape: tuple[BlobShape, ...] = numbered(1, ())


class Input(Layer):
    """Input of a net."""

    param: InputParameter
    bottoms = (0, 0)
    tops = (1, None)
    is_input = True

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        shapes = self.param.shape
        if len(shapes) not in (0, 1, len(top)):
            raise self.fail(f"has {len(top)} tops, but {len(shapes)} shapes", "shape")
        for shape in shapes:
            if min(shape.dim, default=0) < 0:
                raise self.fail(f"shape {shape.dim} has a negative size", "shape")
        for i, blob in enumerate(top):
            blob.keeps_first = True
            if shapes:
                blob.reshape(shapes[i if len(shapes) > 1 else 0].dim)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        """The caller sets the shape."""

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        """The caller writes the data."""
