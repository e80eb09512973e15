r"""Winograd: 3 x 3 and 5 x 5 convolutions with a quarter to a third of the multiplications.

Winograd's F(m x m, k x k) (Lavin and Gray, "Fast algorithms for convolutional neural networks", 2016) computes a tile
of m x m outputs from 6 x 6 inputs d with 36 products, m = 7 - k: 4 for 3 x 3 kernels, 2 for 5 x 5.

    y = Aᵀ [(G w Gᵀ) * (Bᵀ d B)] A

The matrices follow from six points (Vincent et al., "On improving the numerical stability of Winograd convolutions",
2017): 0, a, -a, b, -b and infinity, here with a = 3/4 and b = 3/2, for which the largest error in float32 is a quarter
of that for the usual 1 and 2, below 4e-6 of the largest output for 512 channels. Both kernels have one Bᵀ:

    Bᵀ d at 0         d4 - b² d2 - a² (d2 - b² d0)          Aᵀ at a point p    1  p  p²  p³, the first m
         at a, -a     (d4 - b² d2) ± a (d3 - b² d1)              at infinity   0 ... 0  1
         at b, -b     (d4 - a² d2) ± b (d3 - a² d1)         G at a point p     (1  p  p² ...) / product of (p - others)
         at infinity  d5 - b² d3 - a² (d3 - b² d1)               at infinity   0 ... 0  1

Summed over channels, each of the 36 positions is one matrix product over the tiles of a block. The gradient of x is a
convolution of dy with the flipped kernel; that of w is Gᵀ [sum over tiles of (A dy Aᵀ) * (Bᵀ d B)] G.

The elements of a tile are arrays over all tiles and channels, so a transform is a few sums of long vectors. OpenCV's
scaleAdd multiplies and adds in one pass, in half of the time of NumPy's addition.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial

import cv2
import numpy as np

from fast import parallel
from fast.fusing import After
from fast.geometry import Geometry, image_blocks
from fast.parallel import scratch
from netlib.blob import Array
from netlib.system.memory import blocks

BLOCK_BYTES = 4 << 20  # of both factors of the products of a block; smaller ones take more calls
MIN_TILES = 192  # of a block, because BLAS copies the weights for every product
MIN_PART = 64  # tiles of a thread
SIDE = 6  # of the inputs of a tile
A, B = 0.75, 1.5  # the points
AA, BB = A * A, B * B
POINTS = (0.0, A, -A, B, -B)

Part = tuple[slice, slice]  # images, rows of tiles


class Winograd:
    """The algorithm for 3 x 3 and 5 x 5 kernels, stride 1, without dilation and groups, and many channels."""

    def correlate(self, g: Geometry, x: Array, w: Array, after: After, y: Array) -> None:
        """Write y."""
        O, C = w.shape[:2]
        m = SIDE + 1 - g.kernel[0]
        weights = (_gg(g.kernel[0]).astype(w.dtype) @ w.reshape(O * C, -1).T).reshape(SIDE * SIDE, O, C)

        def job(part: Part) -> None:
            images, rows = part
            V = _inputs(g, x[images], rows, y.shape[2:])
            _correlate(weights, V, after, y[images, :, m * rows.start : m * rows.stop], m)

        parallel.run([partial(job, part) for part in _blocks(x, y, m)])

    def transpose(self, g: Geometry, dy: Array, w: Array, after: After, dx: Array) -> None:
        """Write dx."""
        self.correlate(g.turned, dy, g.flipped(w), after, dx)

    def gradient(self, g: Geometry, x: Array, dy: Array, dw: Array) -> None:
        """Add to dw."""
        O, C = dw.shape[:2]
        m = SIDE + 1 - g.kernel[0]
        parts = list(_blocks(x, dy, m))
        count = 1 if parallel.is_inside() else parallel.threads()
        lanes = list(blocks(len(parts), -(-len(parts) // count) or 1))
        totals = scratch("totals", (len(lanes), SIDE * SIDE, O, C), dw.dtype)

        def job(number: int, lane: slice) -> None:
            for i, (images, rows) in enumerate(parts[lane]):
                V = _inputs(g, x[images], rows, dy.shape[2:])
                Z = _outputs(dy[images, :, m * rows.start : m * rows.stop], m)
                if i == 0:
                    np.matmul(Z, V.swapaxes(1, 2), out=totals[number])
                else:
                    product = scratch("result", totals[0].shape, dw.dtype)
                    totals[number] += np.matmul(Z, V.swapaxes(1, 2), out=product)

        parallel.run([partial(job, number, lane) for number, lane in enumerate(lanes)])
        for total in totals[1:]:
            totals[0] += total
        if lanes:
            dw += (_gg(g.kernel[0]).T.astype(dw.dtype) @ totals[0].reshape(SIDE * SIDE, -1)).T.reshape(dw.shape)


def _gg(k: int) -> Array:
    """The matrix (36, k²) of G w Gᵀ as one product."""
    G = [[p**j / math.prod(p - q for q in POINTS if q != p) for j in range(k)] for p in POINTS]
    return np.kron(*[np.array([*G, [0.0] * (k - 1) + [1.0]])] * 2)


def _scaled(a: Array, factor: float, b: Array, out: Array) -> Array:
    """Write factor a + b, of matrices, to out."""
    cv2.scaleAdd(a, factor, b, dst=out)
    return out


def _to_points(d: Sequence[Array], out: Array, temporary: Array) -> None:
    """Write Bᵀ d to the six matrices out, from six matrices d; ``temporary`` is three more."""
    E, F, u = temporary
    _scaled(d[2], -BB, d[4], E)
    _scaled(d[1], -BB, d[3], F)
    _scaled(F, A, E, out[1])
    _scaled(F, -A, E, out[2])
    _scaled(d[0], -BB, d[2], u)
    _scaled(u, -AA, E, out[0])
    _scaled(d[3], -BB, d[5], u)
    _scaled(F, -AA, u, out[5])
    _scaled(d[2], -AA, d[4], E)
    _scaled(d[1], -AA, d[3], F)
    _scaled(F, B, E, out[3])
    _scaled(F, -B, E, out[4])


def _from_points(p: Array, out: Array, temporary: Array) -> None:
    """Write Aᵀ p to the m matrices out, from six matrices p."""
    u, v, _ = temporary
    if len(out) == 4:
        _scaled(p[1], 1, p[2], u)
        _scaled(p[3], 1, p[4], v)
        _scaled(u, 1, p[0], out[0])
        _scaled(v, 1, out[0], out[0])
        cv2.addWeighted(u, AA, v, BB, 0, dst=out[2])
        _scaled(p[2], -1, p[1], u)
        _scaled(p[4], -1, p[3], v)
        cv2.addWeighted(u, A, v, B, 0, dst=out[1])
        _scaled(u, A * AA, p[5], out[3])
        _scaled(v, B * BB, out[3], out[3])
    else:
        _scaled(p[1], 1, p[0], u)
        _scaled(p[3], 1, p[2], v)
        _scaled(u, 1, v, out[0])
        _scaled(p[4], 1, out[0], out[0])
        _scaled(p[2], -1, p[1], u)
        _scaled(u, A, p[5], out[1])
        _scaled(p[4], -1, p[3], u)
        _scaled(u, B, out[1], out[1])


def _spread(y: Array, out: Array, temporary: Array) -> None:
    """Write A y to the six matrices out, from m matrices y."""
    even, odd, _ = temporary
    out[0], out[5] = y[0], y[-1]
    for i, p in ((1, A), (3, B)):
        if len(y) == 4:
            e, o = _scaled(y[2], p * p, y[0], even), _scaled(y[3], p * p, y[1], odd)
        else:
            e, o = y[0], y[1]
        _scaled(o, p, e, out[i])
        _scaled(o, -p, e, out[i + 1])


def _inputs(g: Geometry, x: Array, rows: slice, outputs: tuple[int, ...]) -> Array:
    """Bᵀ d B of the tiles of these rows, V (36, C, tiles), from x (n, C, H, W)."""
    n, C = x.shape[:2]
    m = SIDE + 1 - g.kernel[0]
    R, T, more = rows.stop - rows.start, -(-outputs[1] // m), -(-SIDE // m) - 1
    padded = scratch("padded", (C, n, R + more, m, m * (T + more)), x.dtype)
    _place(x.swapaxes(0, 1), g.pad[0] - m * rows.start, g.pad[1], padded.reshape(C, n, (R + more) * m, -1))
    split = scratch("split", (m, SIDE, C, n, R + more, T), x.dtype)
    by_row = padded.transpose(3, 0, 1, 2, 4)
    for column in range(SIDE):
        split[:, column] = by_row[..., column : column + m * (T - 1) + 1 : m]
    mixed = scratch("mixed", (m, SIDE, C * n, (R + more) * T), x.dtype)
    temporary = scratch("temporary", (3, SIDE * C * n * (R + more) * T), x.dtype)
    for row in range(m):
        _to_points(split[row].reshape(SIDE, C * n, -1), mixed[row], _first(temporary, mixed[row, 0].shape))
    V = scratch("inputs", (SIDE, SIDE * C * n, R * T), x.dtype)
    whole = mixed.reshape(m, SIDE * C * n, -1)
    elements = [whole[i % m, :, i // m * T : (i // m + R) * T] for i in range(SIDE)]
    _to_points(elements, V, _first(temporary, V[0].shape))
    return V.reshape(SIDE * SIDE, C, -1)


def _first(memory: Array, shape: tuple[int, int]) -> Array:
    """Three matrices in memory (3, values)."""
    return memory[:, : math.prod(shape)].reshape(3, *shape)


def _place(x: Array, top: int, left: int, out: Array) -> None:
    """Write x (C, n, H, W) to ``out`` from row ``top`` and column ``left``, with zeros around it."""
    (H, W), (high, wide) = x.shape[2:], out.shape[2:]
    first, end = min(max(top, 0), high), min(max(top + H, 0), high)
    start, stop = min(max(left, 0), wide), min(max(left + W, 0), wide)
    out[:, :, :first] = out[:, :, end:] = 0
    inner = out[:, :, first:end]
    inner[..., :start] = inner[..., stop:] = 0
    inner[..., start:stop] = x[:, :, first - top : end - top, start - left : stop - left]


def _correlate(weights: Array, V: Array, after: After, y: Array, m: int) -> None:
    """Write the rows y (n, O, rows, Wo) of one block."""
    n, O, rows, Wo = y.shape
    R, T = -(-rows // m), -(-Wo // m)
    size = O * n * R * T
    products = scratch("products", (SIDE * SIDE, O, n * R * T), y.dtype)
    np.matmul(weights, V, out=products)
    halves = scratch("mixed", (m, SIDE, n * R * T * O), y.dtype)
    temporary = scratch("temporary", (3, SIDE * size), y.dtype)
    _from_points(products.reshape(SIDE, 1, -1), halves.reshape(m, 1, -1), _first(temporary, (1, SIDE * size)))
    sums = scratch("split", (m, O * n * R, T), y.dtype)
    merged = scratch("padded", (O * n * R, T, m), y.dtype)
    by_channel = y.swapaxes(0, 1)
    for row in range(m):
        target = by_channel[:, :, row::m]
        _from_points(halves[row].reshape(SIDE, 1, -1), sums.reshape(m, 1, -1), _first(temporary, (1, size)))
        cv2.merge(list(sums), merged)
        after.write(merged.reshape(O, n, R, -1)[:, :, : target.shape[2], :Wo], target, slice(0, O))


def _outputs(dy: Array, m: int) -> Array:
    """A dy Aᵀ of the tiles of dy (n, O, rows, Wo), Z (36, O, tiles)."""
    n, O, rows, Wo = dy.shape
    R, T = -(-rows // m), -(-Wo // m)
    padded = scratch("padded", (O, n, R, m, m * T), dy.dtype)
    _place(dy.swapaxes(0, 1), 0, 0, padded.reshape(O, n, R * m, -1))
    split = scratch("split", (m, m, 1, O * n * R * T), dy.dtype)
    by_row = padded.transpose(3, 0, 1, 2, 4)
    for column in range(m):
        split[:, column].reshape(m, O, n, R, T)[...] = by_row[..., column::m]
    mixed = scratch("mixed", (m, SIDE, 1, O * n * R * T), dy.dtype)
    temporary = scratch("temporary", (3, SIDE * O * n * R * T), dy.dtype)
    for row in range(m):
        _spread(split[row], mixed[row], _first(temporary, mixed[row, 0].shape))
    Z = scratch("products", (SIDE, 1, SIDE * O * n * R * T), dy.dtype)
    _spread(mixed.reshape(m, 1, -1), Z, _first(temporary, Z[0].shape))
    return Z.reshape(SIDE * SIDE, O, -1)


def _blocks(x: Array, y: Array, m: int) -> Iterator[Part]:
    """The images and rows of tiles of each block; at least one for each thread outside of slices."""
    tiles = -(-y.shape[2] // m), -(-y.shape[3] // m)
    each = max(BLOCK_BYTES // (SIDE * SIDE * (x.shape[1] + y.shape[1]) * x.itemsize), MIN_TILES)
    if not parallel.is_inside():
        each = min(each, max(-(-len(x) * tiles[0] * tiles[1] // parallel.threads()), MIN_PART))
    return image_blocks(len(x), tiles, each)
