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
``RowTiles``  stride 1, no padding, one group, what the hand network has: less copying, better products. It is
              explained there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import as_strided

from netlib.blob import Array, Blob, Blobs, tiles_of, untile
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
        self.way: RowTiles | Im2col = RowTiles() if simple else Im2col(stride, pad, dilation, p.group)
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

    def bottom_tile(self, bottom_index: int) -> int | None:
        return 1 if isinstance(self.way, RowTiles) else None

    def writes_tiles(self) -> bool:
        return isinstance(self.way, RowTiles)

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        for i, (x, y) in enumerate(zip(bottom, top)):
            self._check_bottom(x)
            *items, C, H, W = x.shape
            if C != self.channels:
                raise self.fail(f"bottom {self.spec.bottom[i]!r} has {C} channels {x.shape}, "
                                f"its weights {self.blobs[0].shape} expect {self.channels}")  # fmt: skip
            out = [
                (size + 2 * pad - reach) // stride + 1
                for size, pad, reach, stride in zip((H, W), self.pad, self.reach, self.stride)
            ]
            if min(out) < 1:
                raise self.fail(f"kernel {self.reach} is larger than the padded bottom {self.spec.bottom[i]!r} {x.shape}")
            y.reshape(*items, self.param.num_output, *out)
            if y.tile is not None:
                y.pitch = -(-(x.pitch or W) // y.tile) * y.tile

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


class RowTiles:
    """T neighbouring outputs of a row come from one product, with a kernel matrix written out T times.

    Im2col copies each value of x kh * kw times and multiplies by a matrix of O rows only, far too flat for a fast
    product. Here the T outputs y[h, T t : T t + T] all read the J = T + kw - 1 inputs x[h + i, T t : T t + J], so

        Y[h]  (T O, L)  =  M (T O, kh J C)  @  X[h : h + kh]  (kh J C, L)        L = N * W / T

    M[p, o, i, p + j, c] = w[o, c, i, j] and zero elsewhere (a Toeplitz matrix): some products with zero, but T
    times the rows, and x copied only J / T times: X[h, j, c, (n, t)] = x[n, c, h, T t + j]. The kh rows of X that
    an output row needs lie one after the other, so all right factors are one strided view of X, and the
    result is y as tiles of T (netlib/blob.py): what a T x T max pooling wants to read.

    The gradient of the kernel is the same product transposed, folded back from M to w. That of x is a convolution
    of dy with the flipped kernel over kh - 1, kw - 1 zeros around it, again by rows: with dy shifted by q = 0 ..
    kw - 1 columns as further channels, every row of dx is one product. Images stand side by side in a row; the
    zero columns that dy has at the end of every image are the zeros between them.
    """

    def __init__(self) -> None:
        self._matrices: tuple[Array, int, Array, Array] | None = None

    def tile(self, y: Blob, w: tuple[int, ...]) -> int:
        if y.tile is not None:
            return y.tile
        return 4 if w[1] * w[3] <= 8 else 2 if w[1] * w[3] <= 40 else 1  # the flatter M is, the more it gains

    def matrices(self, w: Array, T: int) -> tuple[Array, Array]:
        """M and the matrix of the flipped kernel. Made anew when the weights have changed."""
        found = self._matrices
        if found is None or found[1] != T or not np.array_equal(found[0], w):
            flipped = w[:, :, ::-1, ::-1].transpose(1, 0, 2, 3)
            found = self._matrices = (w.copy(), T, toeplitz(w, T), toeplitz(flipped, 1))
        return found[2], found[3]

    def lower(self, layer: Layer, x: Blob, w: tuple[int, ...], T: int, pitch: int) -> Array:
        """All right factors, (H - kh + 1, kh J C, L), a view of X."""
        (N, C, H, W), (_, _, kh, kw) = x.shape, w
        J, P = T + kw - 1, pitch // T
        X = layer.buffer(f"X{N, C, H, J, P}", (H, J, C, N, P))
        if x.tile is not None and x.pitch == pitch:
            X[:, :T] = x.data.reshape(H, C, N, P, T).transpose(0, 4, 1, 2, 3)
        else:
            tiles_of(x, x.data, T, pitch, X[:, :T])
        rows = X.reshape(H, J, C, N * P)
        for j in range(T, J):  # the last column of an image then comes from the next one; no valid output reads it
            rows[:, j, :, :-1] = rows[:, j - T, :, 1:]
        return stacked_rows(rows.reshape(H, J * C, N * P), kh)

    def forward(self, layer: Layer, x: Blob, y: Blob, w: Array, bias: Array | None) -> None:
        T = self.tile(y, w.shape)
        N, O, Ho, Wo = y.shape
        pitch = y.pitch if y.tile else -(-(x.pitch or x.shape[3]) // T) * T
        storage = (-(-Ho // T) * T, T, O, N, pitch // T)
        out = y.data if y.tile else layer.buffer(f"Y{storage}", storage)
        rows = out[:Ho].reshape(Ho, T * O, -1)
        np.matmul(self.matrices(w, T)[0], self.lower(layer, x, w.shape, T, pitch), out=rows)
        if bias is not None:
            rows += np.tile(bias, T)[:, None]
        if y.tile is None:
            y.data[...] = untile(out, Ho, Wo)

    def backward(
        self, layer: Layer, x: Blob, y: Blob, w: Array, dw: Array, db: Array | None, down: bool
    ) -> None:
        T = self.tile(y, w.shape)
        N, O, Ho, Wo = y.shape
        pitch = y.pitch if y.tile else -(-(x.pitch or x.shape[3]) // T) * T
        storage = (-(-Ho // T) * T, T, O, N, pitch // T)
        out = y.diff if y.tile else layer.buffer(f"dY{storage}", storage)
        tiles = tiles_of(y, y.diff, T, pitch, out)[:Ho]
        dy = tiles.reshape(Ho, T * O, -1)
        right = self.lower(layer, x, w.shape, T, pitch)
        product = layer.buffer(f"G{Ho, right.shape[1], T * O}", (Ho, right.shape[1], T * O))
        np.matmul(right, dy.transpose(0, 2, 1), out=product)
        dw += fold(product.sum(axis=0).T, w.shape, T)
        if db is not None:
            db += dy.reshape(Ho, T, O, -1).sum(axis=(0, 1, 3))
        if down:
            self._backward_x(layer, x, y, w, tiles, T, pitch)

    def _backward_x(self, layer: Layer, x: Blob, y: Blob, w: Array, tiles: Array, T: int, pitch: int) -> None:
        (N, C, H, W), (O, _, kh, kw), Ho = x.shape, w.shape, tiles.shape[0]
        D = layer.buffer(f"D{N, H, pitch}", (H + kh - 1, kw, O, N * pitch))  # zero rows above and below stay zero
        rows = D[kh - 1 : kh - 1 + Ho]
        newest = rows[:, kw - 1]  # dy as plain rows, shifted by nothing
        newest[...] = tiles.transpose(0, 2, 3, 4, 1).reshape(Ho, O, N * pitch)
        for j in range(kw - 1):
            q = kw - 1 - j
            rows[:, j, :, q:] = newest[:, :, :-q]
        factors = stacked_rows(D.reshape(H + kh - 1, kw * O, N * pitch), kh)
        direct = x.tile is not None and x.pitch == pitch
        out = x.diff.reshape(H, C, N * pitch) if direct else layer.buffer(f"dX{N, H, pitch}", (H, C, N * pitch))
        np.matmul(self.matrices(w, T)[1], factors, out=out)
        if not direct:
            dx = untile(out.reshape(H, 1, C, N, pitch), H, W)
            if x.tile is None:
                x.diff[...] = dx
            else:
                tiles_of(Blob(x.shape, x.dtype), dx, x.tile, x.pitch, x.diff)


def images(array: Array) -> Array:
    """(N, C, H, W) of an array that may have more axes in front."""
    return array.reshape(-1, *array.shape[-3:])


def toeplitz(w: Array, T: int) -> Array:
    """M (T O, kh J C) of a kernel w (O, C, kh, kw): the kernel T times, each one column further right."""
    O, C, kh, kw = w.shape
    M = np.zeros((T, O, kh, T + kw - 1, C), w.dtype)
    for p in range(T):
        M[p, :, :, p : p + kw] = w.transpose(0, 2, 3, 1)
    return M.reshape(T * O, -1)


def fold(M: Array, w: tuple[int, ...], T: int) -> Array:
    """The adjoint of ``toeplitz``: what M's gradient (T O, kh J C) is for the kernel."""
    O, C, kh, kw = w
    M = M.reshape(T, O, kh, T + kw - 1, C)
    total: Array = sum(M[p, :, :, p : p + kw] for p in range(T))
    return total.transpose(0, 3, 1, 2)


def stacked_rows(X: Array, kh: int) -> Array:
    """(H, R, L) → (H - kh + 1, kh R, L): every kh rows in a row, a view."""
    H, R, L = X.shape
    return as_strided(X, (H - kh + 1, kh * R, L), X.strides, writeable=False)


