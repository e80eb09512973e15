r"""Im2col: the patches under the windows of a convolution, one column each.

bottom[0]  x  (N, C, H, W)
top[0]     y  (N, C kh kw, Ho, Wo)   Ho and Wo as for Convolution

y[n, (c, i, j), h, w] = x[n, c, h stride + i dilation - pad, w stride + ...], 0 in the padding
dx                    = every dy, added at the position of its x

With it, a convolution becomes a matrix product (convolution.py). Options of the windows are those
of Convolution; options of weights are accepted and ignored.
"""

from __future__ import annotations

import math

from layers.vision.convolution import Convolution
from netlib.blob import Blobs
from netlib.layer import warn_of_ignored


class Im2col(Convolution):
    """Patches in columns."""

    param_name = "convolution_param"
    bottoms = tops = (1, 1)
    reads_bottom = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        self._read_windows(bottom[0])
        warn_of_ignored(self, "num_output", "group", "bias_term", "weight_filler", "bias_filler")
        if not self.kernel:
            raise self.fail(
                f"no spatial axis after axis {self.axis} of bottom {self.spec.bottom[0]!r} "
                f"{bottom[0].shape}"
            )

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        x = bottom[0]
        self._check_axes(0, x)
        rows = x.shape[self.axis] * math.prod(self.kernel)
        top[0].reshape(*x.shape[: self.axis], rows, *self._outputs(0, x))

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        for image, out in zip(self.images(bottom[0].data), self.images(top[0].data)):
            out[...] = self.im2col(image, out.shape).reshape(out.shape)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[0]:
            for dx, dy in zip(self.images(bottom[0].diff), self.images(top[0].diff)):
                dx[...] = self.col2im(dy, dx.shape, dy.shape)
