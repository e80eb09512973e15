r"""Convolution: a small kernel slides over the image and takes a weighted sum everywhere.

bottom[i]  x  (N, C, H, W)
params[0]  w  (O, C / group, kh, kw)
params[1]  b  (O,)            unless ``bias_term: false``
top[i]     y  (N, O, Ho, Wo)  Ho = floor((H + 2 pad - dilation (kh - 1) - 1) / stride) + 1, same for Wo

What follows ``axis``, the channels, is spatial: H and W of an image, or any other number of axes, each with its own
kernel size. What stands before ``axis`` counts items.

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

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from netlib.blob import Array, Blob, Blobs
from netlib.fillers import Filler
from netlib.layer import Layer
from netlib.proto.schema import Engine, UInt, numbered


@dataclass(frozen=True)
class ConvolutionParameter:
    """The ``convolution_param { ... }`` block."""

    num_output: UInt = numbered(1, 0)
    bias_term: bool = numbered(2, True)
    pad: tuple[UInt, ...] = numbered(3, ())  # one number for all spatial axes, or one each
    kernel_size: tuple[UInt, ...] = numbered(4, ())
    stride: tuple[UInt, ...] = numbered(6, ())
    dilation: tuple[UInt, ...] = numbered(18, ())
    pad_h: UInt | None = numbered(9, None)  # those with _h and _w: of two spatial axes
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
    """Convolution (cross-correlation, as everywhere in deep learning)."""

    param_type = ConvolutionParameter
    bottoms: ClassVar[tuple[int, int | None]] = (1, None)
    tops: ClassVar[tuple[int, int | None]] = (1, None)
    in_place = False

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        if len(bottom) != len(top):
            raise self.fail(f"has {len(bottom)} bottoms and {len(top)} tops, expected as many of both")
        self._read_windows(bottom[0])
        p, channels = self.param, self.channels
        if min(p.num_output, p.group) < 1:
            raise self.fail("num_output and group must be at least 1", "num_output" if p.group else "group")
        if channels == 0:
            raise self.fail(f"bottom {self.spec.bottom[0]!r} {bottom[0].shape} has no channels")
        if channels % p.group or p.num_output % p.group:
            raise self.fail(f"group {p.group} must divide {channels} channels and num_output {p.num_output}", "group")
        self.weight = self.new_param("weight", self._weight_shape(), p.weight_filler)
        if p.bias_term:
            self.bias = self.new_param("bias", (p.num_output,), p.bias_filler)

    def _read_windows(self, bottom: Blob) -> None:
        """Read ``axis``, and how the kernel lies: one number per spatial axis."""
        p = self.param
        self.axis = self.canonical_axis(p.axis, bottom)
        self.channels, *sizes = bottom.shape[self.axis :]
        self.kernel = self._each("kernel", p.kernel_size, (p.kernel_h, p.kernel_w), 0, len(sizes))
        self.stride = self._each("stride", p.stride, (p.stride_h, p.stride_w), 1, len(sizes))
        self.pad = self._each("pad", p.pad, (p.pad_h, p.pad_w), 0, len(sizes))
        self.dilation = self._each("dilation", p.dilation, (None, None), 1, len(sizes))
        if 0 in self.kernel:
            raise self.fail("needs kernel_size, or kernel_h and kernel_w, of at least 1", "kernel_size")
        if 0 in self.stride + self.dilation:
            raise self.fail("stride and dilation must be at least 1")

    def _each(
        self, name: str, given: tuple[int, ...], h_w: tuple[int | None, int | None], default: int, axes: int
    ) -> tuple[int, ...]:
        """An option for each of the spatial axes: it is given for all together, for each, or not at all."""
        option = "kernel_size" if name == "kernel" else name
        if h_w != (None, None):
            if given:
                raise self.fail(f"give either {option}, or {name}_h and {name}_w", option)
            if axes != 2:
                raise self.fail(f"{name}_h and {name}_w are for 2 spatial axes, not {axes}; give {option}")
            given = tuple(default if value is None else value for value in h_w)
        if len(given) > 1 and len(given) != axes:
            raise self.fail(f"{len(given)} values of {option} for {axes} spatial axes", option)
        return given if len(given) > 1 else (given or (default,)) * axes

    def _weight_shape(self) -> tuple[int, ...]:
        """Of w: outputs first."""
        return (self.param.num_output, self.channels // self.param.group, *self.kernel)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        for i, (x, y) in enumerate(zip(bottom, top)):
            self._check_axes(i, x)
            if x.shape[self.axis] != self.channels:
                raise self.fail(f"bottom {self.spec.bottom[i]!r} has {x.shape[self.axis]} channels {x.shape}, "
                                f"its weights {self.weight.shape} expect {self.channels}")  # fmt: skip
            y.reshape(*x.shape[: self.axis], self.param.num_output, *self._outputs(i, x))

    def _check_axes(self, i: int, x: Blob) -> None:
        """As many spatial axes as at setup. Raises LayerError."""
        if len(x.shape) != self.axis + 1 + len(self.kernel):
            raise self.fail(f"bottom {self.spec.bottom[i]!r} has shape {x.shape}, "
                            f"expected {len(self.kernel)} spatial axes after axis {self.axis}")  # fmt: skip

    def _reach(self) -> tuple[int, ...]:
        """How far the kernel reaches, from its first to its last element."""
        return tuple(d * (k - 1) + 1 for d, k in zip(self.dilation, self.kernel))

    def _outputs(self, i: int, x: Blob) -> list[int]:
        """Ho, Wo. Raises LayerError if the kernel fits nowhere."""
        sizes = zip(x.shape[self.axis + 1 :], self.pad, self._reach(), self.stride)
        out = [(n + 2 * pad - reach) // stride + 1 for n, pad, reach, stride in sizes]
        if min(out, default=1) < 1:
            raise self.fail(
                f"kernel {self._reach()} is larger than the padded bottom {self.spec.bottom[i]!r} {x.shape}"
            )
        return out

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
                    self.images(x.diff)[n] = self.col2im(w.swapaxes(1, 2) @ dy, image.shape, gradient.shape)

    def images(self, array: Array) -> Array:
        """(N, C, H, W) of an array that may have more axes in front: a view."""
        return array.reshape(-1, *array.shape[self.axis :])

    def by_group(self, rows: Array) -> Array:
        """w, an image or columns as (group, rows of the group, ...), the other axes flattened: a view."""
        return rows.reshape(self.param.group, len(rows) // self.param.group, -1)

    def im2col(self, image: Array, y_shape: tuple[int, ...]) -> Array:
        """(C, H, W) → columns (K group, L): row (c, i, j) is what kernel element (i, j) of channel c meets."""
        padded = np.pad(image, [(0, 0), *((p, p) for p in self.pad)])
        met = np.stack([padded[part] for part in self.places(y_shape)], axis=1)  # (C, kh kw, Ho, Wo)
        return met.reshape(-1, math.prod(y_shape[1:]))

    def col2im(self, columns: Array, x_shape: tuple[int, ...], y_shape: tuple[int, ...]) -> Array:
        """The adjoint of ``im2col``, columns → (C, H, W): what several columns share is summed."""
        C, *sizes = x_shape
        padded = np.zeros((C, *(n + 2 * p for n, p in zip(sizes, self.pad))), columns.dtype)
        met = columns.reshape(C, -1, *y_shape[1:])
        for element, part in enumerate(self.places(y_shape)):
            padded[part] += met[:, element]
        inside = (slice(None), *(slice(p, p + n) for n, p in zip(sizes, self.pad)))
        return padded[inside]

    def places(self, y_shape: tuple[int, ...]) -> Iterator[tuple[slice, ...]]:
        """For each kernel element, row by row, the part of the padded image that it meets: all channels, rows, ..."""
        for element in np.ndindex(self.kernel):
            steps = zip(element, self.dilation, self.stride, y_shape[1:])
            yield slice(None), *(slice(i * d, i * d + (n - 1) * s + 1, s) for i, d, s, n in steps)
