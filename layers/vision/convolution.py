r"""Convolution: a small kernel slides over the image and takes a weighted sum everywhere.

bottom[i]  x  (N, C, H, W)
params[0]  w  (O, C / group, kh, kw)
params[1]  b  (O,)            unless ``bias_term: false``
top[i]     y  (N, O, Ho, Wo)  Ho = floor((H + 2 pad - dilation (kh - 1) - 1) / stride) + 1, same for Wo

y[n, o, h, w]  = b[o] + sum over c, i, j of  w[o, c, i, j] x[n, c, h stride + i dilation - pad, w stride + ...]
dw[o, c, i, j] = sum over n, h, w of  dy[n, o, h, w] x[n, c, h stride + i dilation - pad, w stride + ...]
dx             = every dy[n, o, h, w] w[o, c, i, j], added where its x came from
db[o]          = sum over n, h, w of dy

``group`` splits inputs and outputs into that many parts; each part of the outputs sees one part of the inputs.

Im2col: the patch of x that one output sees becomes a column. With K = C / group * kh * kw and L = Ho Wo, an image is
three matrix products per group:

    y = w (O / group, K) @ columns (K, L)          dw += dy @ columnsᵀ          dcolumns = wᵀ @ dy

and dx adds every column of dcolumns back to where its patch came from (col2im).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from netlib.blob import Array, Blob, Blobs
from netlib.fillers import Filler
from netlib.layer import Layer
from netlib.schema import Engine, UInt, numbered


@dataclass(frozen=True)
class ConvolutionParameter:
    """The ``convolution_param { ... }`` block."""

    num_output: UInt = numbered(1)
    bias_term: bool = numbered(2, True)
    pad: tuple[UInt, ...] = numbered(3, ())  # one number for both axes, or two
    kernel_size: tuple[UInt, ...] = numbered(4, ())
    stride: tuple[UInt, ...] = numbered(6, ())
    dilation: tuple[UInt, ...] = numbered(18, ())
    pad_h: UInt | None = numbered(9, None)
    pad_w: UInt | None = numbered(10, None)
    kernel_h: UInt | None = numbered(11, None)
    kernel_w: UInt | None = numbered(12, None)
    stride_h: UInt | None = numbered(13, None)
    stride_w: UInt | None = numbered(14, None)
    group: UInt = numbered(5, 1)
    weight_filler: Filler = numbered(7, Filler())
    bias_filler: Filler = numbered(8, Filler())
    engine: Engine = numbered(15, "DEFAULT")  # Caffe's choice of implementation; accepted, ignored
    axis: int = numbered(16, 1)  # of the channels
    force_nd_im2col: bool = numbered(17, False)  # accepted, ignored


class Convolution(Layer):
    """2-D convolution (cross-correlation, as everywhere in deep learning)."""

    param_type = ConvolutionParameter
    bottoms = tops = (1, None)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        if len(bottom) != len(top):
            raise self.fail(f"has {len(bottom)} bottoms and {len(top)} tops, expected as many of both")
        self._check_bottom(bottom[0])
        p = self.param
        spatial = len(bottom[0].shape) - 1 - self.canonical_axis(p.axis, bottom[0])
        if spatial != 2:
            raise self.fail(f"{spatial} spatial axes after axis {p.axis} of {bottom[0].shape}; expected 2", "axis")
        kernel = self._pair("kernel", p.kernel_size, (p.kernel_h, p.kernel_w), None)
        stride = self._pair("stride", p.stride, (p.stride_h, p.stride_w), 1)
        pad = self._pair("pad", p.pad, (p.pad_h, p.pad_w), 0)
        dilation = self._pair("dilation", p.dilation, (None, None), 1)
        channels = bottom[0].shape[-3]
        if min(*kernel, *stride, *dilation, p.num_output, p.group) < 1:
            raise self.fail("num_output, kernel, stride, dilation and group must be at least 1")
        if channels % p.group or p.num_output % p.group:
            raise self.fail(f"group {p.group} must divide {channels} channels and num_output {p.num_output}", "group")
        self.channels = channels
        self.new_param("weight", (p.num_output, channels // p.group, *kernel), p.weight_filler)
        if p.bias_term:
            self.new_param("bias", (p.num_output,), p.bias_filler)
        self.kernel, self.stride, self.pad, self.dilation = kernel, stride, pad, dilation

    def _pair(
        self, name: str, both: tuple[int, ...], each: tuple[int | None, int | None], default: int | None
    ) -> tuple[int, int]:
        """(vertical, horizontal) of an option that is given for both axes, for each, or not at all."""
        option = "kernel_size" if name == "kernel" else name
        if both and each != (None, None):
            raise self.fail(f"give either {option}, or {name}_h and {name}_w", option)
        if len(both) > 2:
            raise self.fail(f"{len(both)} values of {option} for 2 spatial axes", option)
        if both:
            return both[0], both[-1]
        height, width = each[0], each[1]
        if default is None and (height is None or width is None):
            raise self.fail(f"needs {option}, or {name}_h and {name}_w", option)
        return (default if height is None else height) or 0, (default if width is None else width) or 0

    def _check_bottom(self, blob: Blob) -> None:
        if len(blob.shape) < 4:
            raise self.fail(f"bottom {self.spec.bottom[0]!r} has shape {blob.shape}, expected (N, C, H, W)")

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        reach = tuple(d * (k - 1) + 1 for d, k in zip(self.dilation, self.kernel))
        for i, (x, y) in enumerate(zip(bottom, top)):
            self._check_bottom(x)
            *items, C, H, W = x.shape
            if self.channels != C:
                raise self.fail(f"bottom {self.spec.bottom[i]!r} has {C} channels {x.shape}, "
                                f"its weights {self.blobs[0].shape} expect {self.channels}")  # fmt: skip
            out = [(n + 2 * pad - r) // s + 1 for n, pad, r, s in zip((H, W), self.pad, reach, self.stride)]
            if min(out) < 1:
                raise self.fail(f"kernel {reach} is larger than the padded bottom {self.spec.bottom[i]!r} {x.shape}")
            y.reshape(*items, self.param.num_output, *out)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        w = self.by_group(self.blobs[0].data)
        for x, y in zip(bottom, top):
            for image, out in zip(images(x.data), images(y.data)):
                out[...] = (w @ self.im2col(image, out.shape)).reshape(out.shape)
                if self.param.bias_term:
                    out += self.blobs[1].data[:, None, None]

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        w, dw = self.by_group(self.blobs[0].data), self.by_group(self.blobs[0].diff)
        for x, y, down in zip(bottom, top, propagate_down):
            for n, (image, gradient) in enumerate(zip(images(x.data), images(y.diff))):
                dy = gradient.reshape(self.param.group, w.shape[1], -1)
                dw += dy @ self.im2col(image, gradient.shape).swapaxes(1, 2)
                if self.param.bias_term:
                    self.blobs[1].diff[...] += gradient.sum(axis=(1, 2))
                if down:
                    images(x.diff)[n] = self.col2im(w.swapaxes(1, 2) @ dy, image.shape, gradient.shape)

    def by_group(self, w: Array) -> Array:
        """w or dw as (group, O / group, K): a view."""
        return w.reshape(self.param.group, self.param.num_output // self.param.group, -1)

    def im2col(self, image: Array, y_shape: tuple[int, ...]) -> Array:
        """(C, H, W) → columns (group, K, L): row (c, i, j) is what kernel element (i, j) of channel c meets."""
        padded = np.pad(image, [(0, 0), *((p, p) for p in self.pad)])
        met = np.stack([padded[:, rows, across] for rows, across in self.places(y_shape)], axis=1)  # (C, kh kw, Ho, Wo)
        return met.reshape(self.param.group, -1, y_shape[1] * y_shape[2])

    def col2im(self, columns: Array, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        """The adjoint of ``im2col``, (group, K, L) → (C, H, W): what several columns share is summed."""
        (C, H, W), (top, left) = x_shape, self.pad
        padded = np.zeros((C, H + 2 * top, W + 2 * left), columns.dtype)
        met = columns.reshape(C, -1, *y_shape[1:])
        for place, (rows, across) in enumerate(self.places(y_shape)):
            padded[:, rows, across] += met[:, place]
        return padded[:, top : top + H, left : left + W]

    def places(self, y_shape: tuple[int, ...]) -> Iterator[tuple[slice, slice]]:
        """For each kernel element, row by row, the rows and columns of the padded image that it meets."""
        (sh, sw), (dh, dw), (_, Ho, Wo) = self.stride, self.dilation, y_shape
        for i, j in np.ndindex(self.kernel):
            yield (
                slice(i * dh, i * dh + (Ho - 1) * sh + 1, sh),
                slice(j * dw, j * dw + (Wo - 1) * sw + 1, sw),
            )


def images(array: Array) -> Array:
    """(N, C, H, W) of an array that may have more axes in front: a view."""
    return array.reshape(-1, *array.shape[-3:])
