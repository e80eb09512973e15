"""MemoryData: batches from arrays in memory.

top[0]  data   (batch_size, channels, height, width)
top[1]  label  (batch_size, 1, 1, 1)

``set_input_arrays`` sets the arrays; the number of items must be a multiple of ``batch_size``.
Every forward reads the next batch, starting over after the last. As in Caffe, the arrays are not
transformed. They are not copied, so later changes to them affect the following batches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from layers.data.transform import TransformationParameter
from netlib.blob import Array, Blobs
from netlib.layer import Layer, warn
from netlib.proto.schema import UInt, numbered


@dataclass(frozen=True)
class MemoryDataParameter:
    """The ``memory_data_param { ... }`` block."""

    batch_size: UInt = numbered(1)
    channels: UInt = numbered(2)
    height: UInt = numbered(3)
    width: UInt = numbered(4)


class MemoryData(Layer):
    """Reads batches from arrays.

    items     number of items in the arrays
    position  index of the first item of the next batch
    """

    param: MemoryDataParameter
    other_blocks: ClassVar[dict[str, type]] = {"transform_param": TransformationParameter}
    bottoms = (0, 0)
    tops = (2, 2)

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        for name in ("batch_size", "channels", "height", "width"):
            if getattr(self.param, name) == 0:
                raise self.fail(f"{name} must be at least 1", name)
        self.arrays: tuple[Array, Array] | None = None
        self.items = self.position = 0
        if "transform_param" in self.spec.blocks:
            warn(
                self,
                "MemoryData does not transform arrays; transform_param is ignored, as in Caffe",
            )

    def set_input_arrays(self, data: ArrayLike, labels: ArrayLike) -> None:
        """Set the arrays to read: data (N, C, H, W), labels (N,) or (N, 1, 1, 1).

        Raises LayerError.
        """
        p, x, t = self.param, np.asarray(data), np.asarray(labels)
        for what, array, shape in (
            ("data", x, (p.channels, p.height, p.width)),
            ("labels", t, (1, 1, 1)),
        ):
            if array.dtype.kind not in "fiub":
                raise self.fail(f"the {what} must be numbers, found an array of {array.dtype}")
            if array.shape[1:] != shape and not (what == "labels" and array.ndim == 1):
                expected = ", ".join(map(str, ("N", *shape)))
                raise self.fail(f"the {what} have shape {array.shape}, expected ({expected})")
        if len(x) != len(t):
            raise self.fail(f"found {len(x)} items of data, but {len(t)} labels")
        if len(x) == 0 or len(x) % p.batch_size:
            raise self.fail(
                f"found {len(x)} items, expected a multiple of batch_size {p.batch_size}"
            )
        self.arrays, self.items = (x, t.reshape(-1, 1, 1, 1)), len(x)
        self.reset()

    def reset(self) -> None:
        """Continue with the first item."""
        self.position = 0

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        top[0].reshape(p.batch_size, p.channels, p.height, p.width)
        top[1].reshape(p.batch_size, 1, 1, 1)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        if self.arrays is None:
            raise self.fail("has no data; call set_input_arrays(data, labels) before forward")
        batch = slice(self.position, self.position + self.param.batch_size)
        for blob, array in zip(top, self.arrays):
            blob.data[...] = array[batch]
        self.position = batch.stop % self.items

    def state(self) -> dict[str, Any]:
        return {**super().state(), "position": self.position, "items": self.items}

    def restore(self, state: dict[str, Any]) -> None:
        super().restore(state)
        if state.get("items") == self.items:  # assume that the caller set the same arrays again
            self.position = int(state["position"])
            if not 0 <= self.position < max(self.items, 1):
                raise ValueError(f"there is no item {self.position}")
