r"""Convolution: a small kernel slides over the image and takes a weighted sum everywhere.

bottom[i]  x  (N, C, H, W)
params[0]  w  (O, C / group, kh, kw)
params[1]  b  (O,)            unless ``bias_term: false``
top[i]     y  (N, O, Ho, Wo)  Ho = floor((H + 2 pad - dilation (kh - 1) - 1) / stride) + 1, same for Wo

y[n, o, h, w]  = b[o] + sum over c, i, j of  w[o, c, i, j] x[n, c, h stride + i dilation - pad, w stride + ...]
dw[o, c, i, j] = sum over n, h, w of  dy[n, o, h, w] x[n, c, h stride + ..., w stride + ...]
dx             = every dy[n, o, h, w] w[o, c, i, j], added where its x came from
db[o]          = sum over n, h, w of dy

With ``group`` the channels fall into that many parts that do not see each other.

Two ways to compute it, both by matrix products:

``Im2col``    any options: copy every patch of x into a column, multiply, and for dx add the columns back.
``tiles``     stride 1, no padding, one group, what the hand network has: less copying, better products. They are
              explained in row_tiles.py and window_tiles.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import as_strided

from layers.row_tiles import RowTiles
from layers.window_tiles import WindowTiles
from netlib.blob import Array, Blob, Blobs
from netlib.fillers import Filler
from netlib.layer import Layer
from netlib.schema import Engine, UInt


@dataclass(frozen=True)
class ConvolutionParameter:
    """The ``convolution_param { ... }`` block."""

    num_output: UInt
    bias_term: bool = True
    pad: tuple[UInt, ...] = ()  # one number for both axes, or two
    kernel_size: tuple[UInt, ...] = ()
    stride: tuple[UInt, ...] = ()
    dilation: tuple[UInt, ...] = ()
    pad_h: UInt | None = None
    pad_w: UInt | None = None
    kernel_h: UInt | None = None
    kernel_w: UInt | None = None
    stride_h: UInt | None = None
    stride_w: UInt | None = None
    group: UInt = 1
    weight_filler: Filler = Filler()
    bias_filler: Filler = Filler()
    engine: Engine = "DEFAULT"  # Caffe's choice of implementation; accepted, ignored
    axis: int = 1  # of the channels
    force_nd_im2col: bool = False  # accepted, ignored


class Convolution(Layer):
    """2-D convolution (cross-correlation, as everywhere in deep learning)."""

    param_type = ConvolutionParameter
    bottoms = tops = (1, None)
    in_place = False
    batchwise = True
    reads_top = False

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
        simple = stride == dilation == (1, 1) and pad == (0, 0) and p.group == 1 and len(bottom[0].shape) == 4
        self.simple = simple
        self.row_tiles, self.window_tiles = RowTiles(), WindowTiles()
        self.way: WindowTiles | RowTiles | Im2col = self.row_tiles
        if not simple:
            self.way = Im2col(stride, pad, dilation, p.group)
        self.reach = tuple(d * (k - 1) + 1 for d, k in zip(dilation, kernel))
        self.stride, self.pad = stride, pad

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

    def bottom_tile(self, bottom_index: int, top_tile: int | None) -> int | None:
        return self.row_tiles.tile(top_tile, self.blobs[0].shape) if self.simple else None

    def writes_tiles(self) -> bool:
        return self.simple

    def sparse_tiles(self) -> bool:
        return self.simple and not self.needs_bottom_diff

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        for i, (x, y) in enumerate(zip(bottom, top)):
            self._check_bottom(x)
            *items, C, H, W = x.shape
            if self.channels != C:
                raise self.fail(f"bottom {self.spec.bottom[i]!r} has {C} channels {x.shape}, "
                                f"its weights {self.blobs[0].shape} expect {self.channels}")  # fmt: skip
            out = [
                (size + 2 * pad - reach) // stride + 1
                for size, pad, reach, stride in zip((H, W), self.pad, self.reach, self.stride)
            ]
            if min(out) < 1:
                raise self.fail(
                    f"kernel {self.reach} is larger than the padded bottom {self.spec.bottom[i]!r} {x.shape}"
                )
            y.reshape(*items, self.param.num_output, *out)
            if y.tile is not None:
                y.pitch = -(-(x.pitch or W) // y.tile) * y.tile
        if len(top) == 1 and self.simple:
            fits = top[0].may_be_sparse and WindowTiles.fits(bottom[0], top[0], self.blobs[0])
            self.way = self.window_tiles if fits else self.row_tiles

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        bias = self.blobs[1].data if self.param.bias_term else None
        for x, y in zip(bottom, top):
            self.way.forward(self, x, y, self.blobs[0].data, bias)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        w, dw = self.blobs[0].data, self.blobs[0].diff
        db = self.blobs[1].diff if self.param.bias_term else None
        for x, y, down in zip(bottom, top, propagate_down):
            self.way.backward(self, x, y, w, dw, db, down)


class Im2col:
    """Every patch of x becomes a column; one product for each image and group."""

    def __init__(self, stride: tuple[int, int], pad: tuple[int, int], dilation: tuple[int, int], group: int) -> None:
        self.stride, self.pad, self.dilation, self.group = stride, pad, dilation, group

    def forward(self, layer: Layer, x: Blob, y: Blob, w: Array, bias: Array | None) -> None:
        columns = self.columns(images(x.data), w.shape, y.shape[-2:])
        product = self.w_rows(w) @ columns  # (N, group, O / group, Ho * Wo)
        y.data[...] = product.reshape(y.shape)
        if bias is not None:
            y.data[...] += bias[:, None, None]

    def backward(self, layer: Layer, x: Blob, y: Blob, w: Array, dw: Array, db: Array | None, down: bool) -> None:
        dy = images(y.diff)
        N, O, Ho, Wo = dy.shape
        rows = dy.reshape(N, self.group, O // self.group, Ho * Wo)
        columns = self.columns(images(x.data), w.shape, (Ho, Wo))
        dw += (rows @ columns.swapaxes(2, 3)).sum(axis=0).reshape(w.shape)
        if db is not None:
            db += dy.sum(axis=(0, 2, 3))
        if down:
            dx = images(x.diff)
            dcolumns = self.w_rows(w).swapaxes(1, 2) @ rows
            padded = np.zeros(self.padded_shape(dx.shape), dx.dtype)
            parts = dcolumns.reshape(N, dx.shape[1], w.shape[2], w.shape[3], Ho, Wo)
            for i in range(w.shape[2]):
                for j in range(w.shape[3]):
                    self.shifted(padded, i, j, Ho, Wo)[...] += parts[:, :, i, j]
            dx[...] = self.inner(padded, dx.shape)

    def w_rows(self, w: Array) -> Array:
        """(group, O / group, C / group * kh * kw)"""
        return w.reshape(self.group, w.shape[0] // self.group, -1)

    def columns(self, x: Array, w: tuple[int, ...], outputs: tuple[int, ...]) -> Array:
        """(N, group, C / group * kh * kw, Ho * Wo)"""
        padded = np.zeros(self.padded_shape(x.shape), x.dtype)
        self.inner(padded, x.shape)[...] = x
        n, c, h, v = padded.strides
        (sh, sw), (dh, dv) = self.stride, self.dilation
        patches = as_strided(
            padded, (*x.shape[:2], *w[2:], *outputs), (n, c, h * dh, v * dv, h * sh, v * sw), writeable=False
        )
        return patches.reshape(len(x), self.group, w[1] * w[2] * w[3], outputs[0] * outputs[1])

    def shifted(self, padded: Array, i: int, j: int, Ho: int, Wo: int) -> Array:
        """The values that kernel element (i, j) meets, (N, C, Ho, Wo)."""
        (sh, sw), (dh, dw) = self.stride, self.dilation
        return padded[:, :, i * dh : i * dh + (Ho - 1) * sh + 1 : sh, j * dw : j * dw + (Wo - 1) * sw + 1 : sw]

    def padded_shape(self, x: tuple[int, ...]) -> tuple[int, ...]:
        return (*x[:2], x[2] + 2 * self.pad[0], x[3] + 2 * self.pad[1])

    def inner(self, padded: Array, x: tuple[int, ...]) -> Array:
        return padded[:, :, self.pad[0] : self.pad[0] + x[2], self.pad[1] : self.pad[1] + x[3]]


def images(array: Array) -> Array:
    """(N, C, H, W) of an array that may have more axes in front."""
    return array.reshape(-1, *array.shape[-3:])
