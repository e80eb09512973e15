# Replace each NotImplementedError, then run: python tools/exercise.py convolution
r"""Convolution: weighted sums of the windows of an image, with one small kernel for all positions.

bottom[i]  x  (N, C, H, W)
params[0]  w  (O, C / group, kh, kw)
params[1]  b  (O,)            unless ``bias_term: false``
top[i]     y  (N, O, Ho, Wo)  Ho = floor((H + 2 pad - dilation (kh - 1) - 1) / stride) + 1, same for Wo

The axes after ``axis``, the channels, are spatial: H and W of an image, or any other number of axes, each with its own
kernel size. The axes before ``axis`` count items.

y[n, o, h, w]  = b[o] + sum over c, i, j of  w[o, c, i, j] x[n, c, h stride + i dilation - pad, w stride + ...]
dw[o, c, i, j] = sum over n, h, w of  dy[n, o, h, w] x[n, c, h stride + i dilation - pad, w stride + ...]
dx             = every dy[n, o, h, w] w[o, c, i, j], added at the position of its x
db[o]          = sum over n, h, w of dy

``group`` splits inputs and outputs into that many parts; each part of the outputs depends on one part of the inputs.

Im2col copies the patch of x under each output into a column. With K = C / group * kh * kw and L = Ho Wo, an image needs
three matrix products per group:

    y = w (O / group, K) @ columns (K, L)          dw += dy @ columnsᵀ          dcolumns = wᵀ @ dy

and dx adds every column of dcolumns at the position of its patch (col2im).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from layers.vision.windows import ConvolutionParameter, SlidingWindow
from netlib.blob import Array, Blob, Blobs


class Convolution(SlidingWindow):
    """Convolution (cross-correlation, as is usual in deep learning)."""

    param_type = ConvolutionParameter
    bottoms: ClassVar[tuple[int, int | None]] = (1, None)
    tops: ClassVar[tuple[int, int | None]] = (1, None)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        if len(bottom) != len(top):
            raise self.fail(f"has {len(bottom)} bottoms and {len(top)} tops, expected equal numbers of them")
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
        # Return [Ho, Wo] for the shape of x: its spatial axes begin at self.axis + 1. self.pad, self.stride and
        # self.kernel have one value per spatial axis, and self._extent() is the span of the dilated kernel.
        raise NotImplementedError

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        # For every x in bottom and y in top: write y.data, the sum over c, i, j of the docstring, plus b. images(),
        # by_group() and im2col() reduce it to matrix products; plain loops over n, o, h, w are also correct, but
        # slower.
        raise NotImplementedError

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        # Add to self.weight.diff (dw) and self.bias.diff (db), summed over the images; write x.diff where
        # propagate_down is true. Sum the contributions of windows that share a pixel.
        raise NotImplementedError

    def images(self, array: Array) -> Array:
        """View of an array as (N, C, H, W); it may have more axes in front."""
        return array.reshape(-1, *array.shape[self.axis :])

    def by_group(self, rows: Array) -> Array:
        """View of w, an image or columns as (group, rows of the group, ...), with the other axes flattened."""
        return rows.reshape(self.param.group, len(rows) // self.param.group, -1)

    def im2col(self, image: Array, y_shape: tuple[int, ...]) -> Array:
        """(C, H, W) → columns (K group, L): row (c, i, j) holds the values under element (i, j) of channel c."""
        # Stack the pixels that each kernel element multiplies; window_slices() yields the slices of the padded image.
        # Leave it unchanged if your forward does not use it.
        raise NotImplementedError

    def col2im(self, columns: Array, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        """Adjoint of ``im2col``, columns → (C, H, W): sums overlapping values."""
        # The adjoint of im2col: add every element of the columns to its pixel and crop the padding. Leave it
        # unchanged if your backward does not use it.
        raise NotImplementedError

    def window_slices(self, y_shape: tuple[int, ...]) -> Iterator[tuple[slice, ...]]:
        """For each kernel element, in row-major order, the part of the padded image under it in all windows."""
        for element in np.ndindex(self.kernel):
            steps = zip(element, self.dilation, self.stride, y_shape[1:])
            yield slice(None), *(slice(i * d, i * d + (n - 1) * s + 1, s) for i, d, s, n in steps)
