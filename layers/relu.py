"""ReLU: cut off what is negative.

bottom[0]  x  any shape
top[0]     y  same shape, may be the same blob

y  = max(x, 0) + slope * min(x, 0)
dx = dy where y > 0, slope * dy elsewhere       (at 0, as in Caffe, the gradient is slope * dy)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from netlib.blob import Array, Blobs
from netlib.layer import Layer
from netlib.schema import Engine

# NumPy's maximum with a scalar is four times slower than with an array: compare against rows of zeros.
ROW = 1 << 14


@dataclass(frozen=True)
class ReLUParameter:
    """The ``relu_param { ... }`` block."""

    negative_slope: float = 0.0  # 0: cut off; small and positive: "leaky"
    engine: Engine = "DEFAULT"  # Caffe's choice of implementation; accepted, ignored


class ReLU(Layer):
    """Rectified linear unit."""

    param_type = ReLUParameter
    param_name = "relu_param"
    bottoms = tops = (1, 1)
    batchwise = True
    elementwise = True
    reads_bottom = False  # the sign of y is the sign of x

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self.slope = self.param.negative_slope
        self.monotone = self.slope == 0
        self.reads_bottom = self.slope < 0  # then y does not tell the sign of x
        if self.reads_bottom and bottom[0] is top[0]:
            raise self.fail("with a negative negative_slope cannot run in place", "negative_slope")
        self.zeros = np.zeros(ROW, self.dtype)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        top[0].reshape(bottom[0].shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, y = bottom[0].data, top[0].data
        if self.slope:
            np.multiply(x, np.where(x > 0, self.dtype.type(1), self.dtype.type(self.slope)), out=y)
        elif x.size < ROW or not (x.flags.c_contiguous and y.flags.c_contiguous):
            np.maximum(x, self.zeros[: x.shape[-1]] if x.ndim > 0 and x.shape[-1] <= ROW else 0, out=y)
        else:
            self._rectify(x.reshape(-1), y.reshape(-1))

    def _rectify(self, x: Array, y: Array) -> None:
        whole = x.size // ROW * ROW
        np.maximum(x[:whole].reshape(-1, ROW), self.zeros, out=y[:whole].reshape(-1, ROW))
        np.maximum(x[whole:], self.zeros[: x.size - whole], out=y[whole:])

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not propagate_down[0]:
            return
        sign, dy, dx = (bottom if self.reads_bottom else top)[0].data, top[0].diff, bottom[0].diff
        if self.slope:
            np.multiply(dy, np.where(sign > 0, self.dtype.type(1), self.dtype.type(self.slope)), out=dx)
        else:  # a multiplication by the mask costs a twentieth of a masked copy
            np.multiply(dy, sign > 0, out=dx)
