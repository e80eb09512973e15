r"""Convolution: weighted sums of the windows of an image, with one small kernel for all positions.

bottom[i]  x  (N, C, H, W)
params[0]  w  (O, C / group, kh, kw)
params[1]  b  (O,)            unless ``bias_term: false``
top[i]     y  (N, O, Ho, Wo)  Ho = floor((H + 2 pad - dilation (kh - 1) - 1) / stride) + 1; also Wo

The axes after ``axis``, the channels, are spatial: H and W of an image, or any other number of
axes, each with its own kernel size. The axes before ``axis`` count items.

y[n, o, h, w]  = b[o] + sum over c, i, j of
                 w[o, c, i, j] x[n, c, h stride + i dilation - pad, w stride + ...]
dw[o, c, i, j] = sum over n, h, w of
                 dy[n, o, h, w] x[n, c, h stride + i dilation - pad, w stride + ...]
dx             = every dy[n, o, h, w] w[o, c, i, j], added at the position of its x
db[o]          = sum over n, h, w of dy

``group`` splits inputs and outputs into that many parts; each part of the outputs depends on one
part of the inputs.

Im2col copies the patch of x under each output into a column. With K = C / group * kh * kw and
L = Ho Wo, an image needs three matrix products per group:

    y = w (O / group, K) @ columns (K, L)          dw += dy @ columnsᵀ          dcolumns = wᵀ @ dy

and dx adds every column of dcolumns at the position of its patch (col2im).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from layers.vision.windows import ConvolutionParameter, SlidingWindow
from netlib.blob import Array, Blob, Blobs


class Convolution(SlidingWindow):
    """Convolution (cross-correlation, as is usual in deep learning)."""

    param: ConvolutionParameter
    bottoms: ClassVar[tuple[int, int | None]] = (1, None)
    tops: ClassVar[tuple[int, int | None]] = (1, None)
    in_place = False
    reads_top = reads_kept = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        if len(bottom) != len(top):
            raise self.fail(
                f"has {len(bottom)} bottoms and {len(top)} tops, expected equal numbers of them"
            )
        self._read_convolution(bottom[0])
        p = self.param
        self.weight = self.new_param("weight", self._weight_shape(), p.weight_filler)
        if p.bias_term:
            self.bias = self.new_param("bias", (p.num_output,), p.bias_filler)

    def _weight_shape(self) -> tuple[int, ...]:
        """Shape of w, outputs first."""
        return (self.param.num_output, self.channels // self.param.group, *self.kernel)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        for i, (x, y) in enumerate(zip(bottom, top)):
            self._check_axes(i, x, self.weight.shape)
            y.reshape(*x.shape[: self.axis], self.param.num_output, *self._outputs(i, x))

    def _outputs(self, i: int, x: Blob) -> list[int]:
        """Ho and Wo. Raises LayerError if the kernel does not fit."""
        sizes = zip(x.shape[self.axis + 1 :], self.pad, self._extent(), self.stride)
        counts = [(n + 2 * pad - extent) // stride + 1 for n, pad, extent, stride in sizes]
        if min(counts, default=1) < 1:
            name = self.spec.bottom[i]
            raise self.fail(
                f"kernel {self._extent()} is larger than the padded bottom {name!r} {x.shape}"
            )
        return counts

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        w = self.by_group(self.weight.data)
        for x, y in zip(bottom, top):
            for image, out in zip(self.images(x.data), self.images(y.data)):
                out[...] = (w @ self.by_group(self.im2col(image, out.shape))).reshape(out.shape)
                if self.param.bias_term:
                    out += self.bias.data.reshape(-1, *(1,) * len(self.kernel))

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        w, dw = self.by_group(self.weight.data), self.by_group(self.weight.diff)
        for x, y, down in zip(bottom, top, propagate_down):
            for n, (image, gradient) in enumerate(zip(self.images(x.data), self.images(y.diff))):
                dy = self.by_group(gradient)
                dw += dy @ self.by_group(self.im2col(image, gradient.shape)).swapaxes(1, 2)
                if self.param.bias_term:
                    self.bias.diff[...] += dy.sum(axis=2).reshape(-1)
                if down:
                    self.images(x.diff)[n] = self.col2im(
                        w.swapaxes(1, 2) @ dy, image.shape, gradient.shape
                    )

    def images(self, array: Array) -> Array:
        """View of an array as (N, C, H, W); it may have more axes in front."""
        return array.reshape(-1, *array.shape[self.axis :])

    def by_group(self, rows: Array) -> Array:
        """View of w, an image or columns as (group, rows of the group, ...), with the other
        axes flattened.
        """
        return rows.reshape(self.param.group, len(rows) // self.param.group, -1)

    def im2col(self, image: Array, y_shape: tuple[int, ...]) -> Array:
        """(C, H, W) → columns (K group, L): row (c, i, j) holds the values under element
        (i, j) of channel c.
        """
        padded = np.pad(image, [(0, 0), *((p, p) for p in self.pad)])
        # (C, kh kw, Ho, Wo)
        patches = np.stack([padded[part] for part in self.window_slices(y_shape)], axis=1)
        return patches.reshape(-1, math.prod(y_shape[1:]))

    def col2im(self, columns: Array, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        """Adjoint of ``im2col``, columns → (C, H, W): sums overlapping values."""
        C, *sizes = x_shape
        padded_sizes = [n + 2 * p for n, p in zip(sizes, self.pad)]
        padded = np.zeros((C, *padded_sizes), columns.dtype)
        patches = columns.reshape(C, -1, *y_shape[1:])
        for element, part in enumerate(self.window_slices(y_shape)):
            padded[part] += patches[:, element]
        inside = (slice(None), *(slice(p, p + n) for n, p in zip(sizes, self.pad)))
        return padded[inside]

    def window_slices(self, y_shape: tuple[int, ...]) -> Iterator[tuple[slice, ...]]:
        """For each kernel element, in row-major order, the part of the padded image under it
        in all windows.
        """
        axes = [[slice(None)]]  # all channels
        for k, d, s, n in zip(self.kernel, self.dilation, self.stride, y_shape[1:]):
            span = (n - 1) * s + 1
            axes.append([slice(i * d, i * d + span, s) for i in range(k)])
        return itertools.product(*axes)
