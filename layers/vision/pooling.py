"""Pooling: maximum or mean over sliding windows, per channel.

bottom[0]  x     (N, C, H, W)
top[0]     y     (N, C, Ho, Wo)   Ho = ceil((H + 2 pad - kernel) / stride) + 1, same for Wo
top[1]     mask  (N, C, Ho, Wo)   optional, for MAX: index h W + w of the maximum in its map; -1
                                  if there is none

MAX   y = max of x over the window             dx[winner] += dy
AVE   y = sum of x over the window / area      dx[all of the window] += dy / area

Caffe's rules: the output size is rounded **up** (unless ``round_mode: FLOOR``, in some forks
``ceil_mode: false``), so the last window, even if it is the only one, may extend beyond the edge;
with pad > 0 in any direction, a last window that starts beyond the image is dropped. MAX selects
the first of equal values and never padding. The area of AVE includes padding but nothing beyond it.
An empty window (stride > kernel) gives -FLT_MAX or NaN. No gradient of masks.

Kept for backward: ``winners``, index of each output of MAX in its window, row-major.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from layers.vision.windows import PoolingParameter, SlidingWindow
from netlib.blob import Array, Blobs

NOTHING = -float(np.finfo(np.float32).max)  # Caffe's maximum of an empty window


class Pooling(SlidingWindow):
    """Max and average pooling."""

    param: PoolingParameter
    bottoms = (1, 1)
    tops = (1, 2)
    in_place = False
    batchwise = True
    reads_bottom = reads_top = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        p = self.param
        if p.pool == "STOCHASTIC":
            raise self.fail(
                "STOCHASTIC pooling is not supported, as in Caffe on a CPU; expected MAX or AVE",
                "pool",
            )
        if len(top) > 1 and p.pool != "MAX":
            raise self.fail(f"has 2 tops, but only MAX pooling has a mask, not {p.pool}", "pool")
        self._read_pooling()
        self.whole_kernel, self.is_max = self.kernel, p.pool == "MAX"

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        self._check_map(bottom[0])
        N, C, H, W = bottom[0].shape
        if self.param.global_pooling:
            self.whole_kernel = (H, W)
        for y in top:
            y.reshape(N, C, self._outputs(0, H), self._outputs(1, W))
        # Clip the kernel to the padded image: with global bounds it would only add padding,
        # possibly a lot.
        (kh, kw), (ph, pw) = self.whole_kernel, self.pad
        self.kernel = (min(kh, H + 2 * ph), min(kw, W + 2 * pw))

    def _outputs(self, i: int, size: int) -> int:
        kernel, stride, pad = self.whole_kernel[i], self.stride[i], self.pad[i]
        extent = size + 2 * pad - kernel  # negative if the only window exceeds the image
        rounds_up = self.param.round_mode == "CEIL"
        count = (-(-extent // stride) if rounds_up else extent // stride) + 1
        if any(self.pad) and (count - 1) * stride >= size + pad:
            count -= 1
        if count < 1:
            raise self.fail(
                f"kernel {kernel} is larger than the padded bottom ({size} + 2 * {pad})"
            )
        return count

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        x, y = bottom[0].data, top[0].data
        self.winners = np.empty(y.shape, int)
        for n in range(len(x)):
            outside = -np.inf if self.is_max else 0
            windows = self.windows(self.padded(x[n], y.shape, outside), y.shape)
            if self.is_max:
                self.winners[n] = windows.argmax(axis=0)  # the first of equal values
                y[n] = np.maximum(windows.max(axis=0), NOTHING)
                if len(top) > 1:
                    index = self._index(n, x.shape[3])
                    top[1].data[n] = np.where(y[n] == NOTHING, -1, index)
            else:
                y[n] = windows.sum(axis=0) / self.area(x.shape, y.shape)  # 0 / 0 in an empty window

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if not propagate_down[0]:
            return
        dy, dx = top[0].diff, bottom[0].diff
        (c, h, w), (sh, sw) = np.indices(dy.shape[1:]), self.stride
        (ph, pw), (H, W) = self.pad, dx.shape[2:]
        for n in range(len(dx)):
            padded = self.padded(np.zeros_like(dx[n]), dy.shape, 0)
            if self.is_max:
                i, j = np.divmod(self.winners[n], self.kernel[1])
                np.add.at(padded, (c, h * sh + i, w * sw + j), dy[n])
            else:
                share = dy[n] / self.area(dx.shape, dy.shape)
                for rows, across in self.window_slices(dy.shape):
                    padded[:, rows, across] += share
            dx[n] = padded[:, ph : ph + H, pw : pw + W]

    def _index(self, n: int, W: int) -> Array:
        """(C, Ho, Wo): index of each winner of an image in its map."""
        _, h, w = np.indices(self.winners[n].shape)
        i, j = np.divmod(self.winners[n], self.kernel[1])
        (sh, sw), (ph, pw) = self.stride, self.pad
        return (h * sh - ph + i) * W + w * sw - pw + j

    def windows(self, padded: Array, y_shape: tuple[int, ...]) -> Array:
        """All windows of an image, (kh kw, C, Ho, Wo): row p holds element p of every window."""
        return np.stack([padded[:, rows, across] for rows, across in self.window_slices(y_shape)])

    def window_slices(self, y_shape: tuple[int, ...]) -> Iterator[tuple[slice, slice]]:
        """For each element of a window, in row-major order, its rows and columns of the padded
        image in all windows.
        """
        (sh, sw), (Ho, Wo) = self.stride, y_shape[2:]
        for i, j in np.ndindex(self.kernel):
            rows = slice(i, i + (Ho - 1) * sh + 1, sh)
            across = slice(j, j + (Wo - 1) * sw + 1, sw)
            yield rows, across

    def area(self, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        """(Ho, Wo): area of each window, clipped at the end of the padding."""
        sizes = []
        for i in range(2):
            start = np.arange(y_shape[2 + i]) * self.stride[i] - self.pad[i]
            end = np.minimum(start + self.kernel[i], x_shape[2 + i] + self.pad[i])
            sizes.append(end - start)
        return np.outer(*sizes).astype(self.dtype)
