r"""WindowTiles: the first convolution of a depth image, only where there is something to see.

Most of a depth crop is background, one constant value b. Where all that a T x T window of outputs reads is b, the
output is known without a product: bias + b * (sum of the kernel). So the windows that see anything else are looked up,
the inputs of each are copied into a row of X, and all of them go through one large product,

    Y (T T O, A)  =  M (T T O, S S)  @  Xᵀ (S S, A)         A windows, kernel T + 1, S = 2 T

with M[p, q, o, p + i, q + j] = w[o, 0, i, j]. It is done in two halves, for the upper and the lower T / 2 rows of
outputs: each needs only T / 2 + k - 1 of the S rows of inputs, which saves a quarter of the operations. The top is a
sparse blob (tiles.py): the windows, and the constant of all others. The bias is left to the max pooling that
reads it, which adds it to one value in T T. It is exact for any image and any b; the time saved depends on how much of
the image is b.

Backward: dM (T T O, S S) = dY X, folded back to the kernel. dY is what a max pooling passes down: of the T T places of
a window only one has a gradient, so dY is kept as a sparse matrix, and the product has 1 / (T T) of the operations of a
dense one. Every output over the background saw b under the whole kernel, so together they add b * (sum of their dy) to
each element of dw.
"""

from __future__ import annotations

import functools

import numpy as np
import scipy

from fast.fast_layer import FastLayer
from fast.tiles import FastBlob, SparseTiles, tile_of
from netlib.blob import Array, Blob

FLAGS = {2: np.uint16, 4: np.uint32, 8: np.uint64}  # T flags of a row as one number


class WindowTiles:
    """A convolution of one channel with stride 1, without padding, whose bottom needs no gradient."""

    def __init__(self) -> None:
        self._matrix: tuple[Array, int, Array] | None = None

    @staticmethod
    def fits(x: Blob, T: int | None, w: Blob) -> bool:
        """Does each T x T window of the top, with a kernel of T + 1, read exactly 2 x 2 blocks of T x T inputs?"""
        _, C, kh, kw = w.shape
        if T not in FLAGS or tile_of(x) is not None or C != 1 or not kh == kw == T + 1:
            return False
        return x.shape[2] % T == x.shape[3] % T == 0 and T * x.dtype.itemsize % 8 == 0

    def matrix(self, w: Array, T: int) -> Array:
        """M of one half. Computed again when the weights have changed."""
        found = self._matrix
        if found is None or found[1] != T or not np.array_equal(found[0], w):
            O, _, k, _ = w.shape
            M = np.zeros((T // 2, T, O, T // 2 + k - 1, T + k - 1), w.dtype)
            for p, q in np.ndindex(T // 2, T):
                M[p, q, :, p : p + k, q : q + k] = w[:, 0]
            found = self._matrix = (w.copy(), T, M.reshape(T // 2 * T * O, -1))
        return found[2]

    @staticmethod
    def halves(X: Array, T: int) -> Array:
        """(2, A, rows) views of X (A, S S), C-contiguous: what the upper and the lower half of the outputs read."""
        S, item = 2 * T, X.itemsize
        return np.ndarray((2, len(X), 3 * T // 2 * S), X.dtype, X, 0, (T // 2 * S * item, S * S * item, item))

    def forward(self, layer: FastLayer, x: Blob, y: Blob, w: Array, bias: Array | None) -> None:
        """y from x."""
        assert isinstance(y, FastBlob) and y.tile is not None
        T = y.tile
        b = self.background(x)
        window = self.windows(x.data, b, T)
        A = len(window)
        O, places = len(w), T * T
        out = layer.buffer("Y", (y.count,))[: places * O * A].reshape(places * O, A)
        X = self.halves(self.patches(layer, x.data, window, T), T)
        np.matmul(self.matrix(w, T), X.swapaxes(1, 2), out=out.reshape(2, places * O // 2, A))
        if bias is None:
            bias = np.zeros(O, w.dtype)
        y.sparse = SparseTiles(window, out.reshape(places, O, A), bias, w.sum(axis=(1, 2, 3)) * b + bias)

    @staticmethod
    def background(x: Blob) -> Array:
        """b: the far plane of a depth crop. Any other number is as right, only slower; it must be finite, or one bad
        pixel would reach every image.
        """
        b = x.data.max()
        return b if np.isfinite(b) else np.zeros_like(b)

    def windows(self, x: Array, b: Array, T: int) -> Array:
        """(A,) every window that reads anything but b, as in SparseTiles."""
        N, _, H, W = x.shape
        seen = (x != b).view(FLAGS[T])
        block = np.bitwise_or.reduce(seen.reshape(N, H // T, T, W // T), axis=2)  # of T x T inputs
        reads = block[:, :-1] | block[:, 1:]
        reads = reads[:, :, :-1] | reads[:, :, 1:]
        return np.flatnonzero(reads)

    def patches(self, layer: FastLayer, x: Array, window: Array, T: int) -> Array:
        """X (A, S S): what each window reads.

        Copied in units of 8 or 16 bytes, called complex numbers because these are the widest that ``np.take`` knows.
        """
        N, _, H, W = x.shape
        S, A = 2 * T, len(window)
        unit = np.dtype(np.complex128 if T * x.itemsize % 16 == 0 else np.complex64)
        per = unit.itemsize // x.itemsize  # numbers in a unit
        inside = (np.arange(S)[:, None] * (W // per) + np.arange(S // per)).reshape(-1)
        first = _first_inputs(N, H, W // per, T, T // per)[window]
        most = N * (H // T) * (W // T)
        out = layer.buffer("X", (most * S * S,))[: A * S * S].view(unit).reshape(A, S * S // per)
        np.take(x.reshape(-1).view(unit), first[:, None] + inside, out=out, mode="clip")
        return out.view(x.dtype).reshape(A, S * S)

    def backward(self, layer: FastLayer, x: Blob, y: Blob, w: Array, dw: Array, db: Array | None, down: bool) -> None:
        """Adds to dw and db."""
        assert isinstance(y, FastBlob) and y.tile is not None and not down
        found = y.sparse
        assert found is not None and found.diff is not None and found.winner is not None
        T, S, k = y.tile, 2 * y.tile, w.shape[2]
        O, A = found.diff.shape
        X = self.patches(layer, x.data, found.window, T)
        # Column a of dY holds O numbers, in the rows (winner, o).
        rows = found.winner.T.astype(np.int32) * O + np.arange(O, dtype=np.int32)
        columns = np.arange(0, O * A + 1, O, dtype=np.int32)
        dY = scipy.sparse.csc_array((found.diff.T.reshape(-1), rows.reshape(-1), columns), shape=(T * T * O, A))
        dM = (dY @ X).reshape(T, T, O, S, S)
        for p, q in np.ndindex(T, T):
            dw[:, 0] += dM[p, q, :, p : p + k, q : q + k]
        dw += (found.rest_diff * self.background(x))[:, None, None, None]
        if db is not None:
            db += found.diff.sum(axis=1) + found.rest_diff


@functools.lru_cache(maxsize=16)
def _first_inputs(N: int, H: int, W: int, rows: int, columns: int) -> Array:
    """Where in an image (N, H, W) the inputs of each window begin; the next window is some rows or columns further."""
    image, row, column = np.indices((N, H // rows - 1, W // columns - 1)).reshape(3, -1)
    return np.asarray((image * H + row * rows) * W + column * columns)
