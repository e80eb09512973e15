r"""WindowTiles: the first convolution of a depth image, computed only where the image is
not background.

Most of a depth crop is background with one constant value b. If a T x T window of outputs reads
only b, its outputs are bias + b * (sum of the kernel), without a product. For each of the other
windows the inputs are copied to a row of X, and one large product computes all of them,

    Y (T T O, A)  =  M (T T O, S S)  @  Xᵀ (S S, A)         A windows, kernel T + 1, S = 2 T

with M[p, q, o, p + i, q + j] = w[o, 0, i, j]. The product is computed in two halves, for the upper
and the lower T / 2 rows of outputs: each reads only T / 2 + k - 1 of the S rows of inputs, which
saves a quarter of the operations. The top is a sparse blob: the computed windows, and the constant
of all others. The max pooling that reads the top adds the bias, to one value in T T. The result is
exact for any image and any b; the time saved depends on the part of the image that is b.

Backward: dM (T T O, S S) = dY X, folded back to the kernel. dY is the gradient from a max pooling:
only one of the T T elements of a window has a gradient, so dY is a sparse matrix, and the product
has 1 / (T T) of the operations of a dense one. Every output over the background reads b under the
whole kernel, so together they add b * (sum of their dy) to each element of dw.
"""

from __future__ import annotations

import functools

import numpy as np
import scipy

from fast.fast_layer import FastLayer
from fast.geometry import Geometry, NotFiniteError, check_finite
from fast.tiles import FastBlob, SparseTiles, tile_of
from netlib.blob import Array, Blob, Blobs

FLAGS = {2: np.uint16, 4: np.uint32, 8: np.uint64}  # T -> integer type with T bytes, one per flag


class WindowTiles:
    """A convolution of one channel with stride 1 and no padding, whose bottom needs no gradient."""

    def __init__(self) -> None:
        self._matrix: tuple[Array, Array] | None = None  # w, and M of one half computed from it

    @staticmethod
    def fits(g: Geometry, bottom: Blobs, top: Blobs, w: Blob) -> bool:
        """Whether each T x T window of a sparse top, with a kernel of T + 1, reads exactly 2 x 2
        blocks of T x T inputs of one channel.
        """
        x, y = bottom[0], top[0]
        if len(top) > 1 or not isinstance(y, FastBlob):
            return False
        T = y.tile
        if T not in FLAGS or not y.may_be_sparse:
            return False
        if not g.is_dense or any(g.pad) or g.kernel != (T + 1, T + 1):
            return False
        _, C, H, W = x.shape
        if C != 1 or tile_of(x) is not None:
            return False
        return H % T == 0 and W % T == 0 and T * x.dtype.itemsize % 8 == 0

    def matrix(self, w: Array, T: int) -> Array:
        """M of one half; computed again only if the weights have changed."""
        if self._matrix is None or not np.array_equal(self._matrix[0], w):
            O, _, k, _ = w.shape
            half = T // 2
            M = np.zeros((half, T, O, half + k - 1, T + k - 1), w.dtype)
            for p, q in np.ndindex(half, T):
                M[p, q, :, p : p + k, q : q + k] = w[:, 0]
            self._matrix = w.copy(), M.reshape(half * T * O, -1)
        return self._matrix[1]

    @staticmethod
    def halves(X: Array, T: int) -> Array:
        """View X (A, S S), C-contiguous, as (2, A, rows): the inputs of the upper and the lower
        half of the outputs.
        """
        S, item = 2 * T, X.itemsize
        strides = T // 2 * S * item, S * S * item, item
        return np.ndarray((2, len(X), 3 * T // 2 * S), X.dtype, X, 0, strides)

    def forward(self, layer: FastLayer, x: Blob, y: Blob, w: Array, bias: Array | None) -> None:
        """Compute y from x.

        Raises NotFiniteError, because the zeros of M would make NaN of infinity.
        """
        check_finite(x.data)
        assert isinstance(y, FastBlob) and y.tile is not None
        T = y.tile
        b = self.background(x)
        window = self.windows(x.data, b, T)
        A, O = len(window), len(w)
        Y = layer.buffer("Y", (y.count,))[: T * T * O * A]
        X = self.halves(self.patches(layer, x.data, window, T), T)
        np.matmul(self.matrix(w, T), X.swapaxes(1, 2), out=Y.reshape(2, T * T * O // 2, A))
        if bias is None:
            bias = np.zeros(O, w.dtype)
        rest = w.sum(axis=(1, 2, 3)) * b + bias
        y.sparse = SparseTiles(window, Y.reshape(T * T, O, A), bias, rest)

    @staticmethod
    def background(x: Blob) -> Array:
        """Return b, the far plane of a depth crop.

        Any number gives the same result, but is slower.
        """
        return x.data.max()

    def windows(self, x: Array, b: Array, T: int) -> Array:
        """Return the indices (A,) of all windows that read a value other than b, as
        in SparseTiles.
        """
        N, _, H, W = x.shape
        foreground = (x != b).view(FLAGS[T])  # T neighbouring flags are one integer
        by_block = np.bitwise_or.reduce(foreground.reshape(N, H // T, T, W // T), axis=2)
        of_two_rows = by_block[:, :-1] | by_block[:, 1:]
        of_four_blocks = of_two_rows[:, :, :-1] | of_two_rows[:, :, 1:]
        return np.flatnonzero(of_four_blocks)

    def patches(self, layer: FastLayer, x: Array, window: Array, T: int) -> Array:
        """Return X (A, S S), the inputs of each window.

        They are copied in units of 8 or 16 bytes, viewed as complex numbers, the widest type that
        ``np.take`` supports.
        """
        N, _, H, W = x.shape
        S, A = 2 * T, len(window)
        unit = np.dtype(np.complex128 if T * x.itemsize % 16 == 0 else np.complex64)
        numbers = unit.itemsize // x.itemsize  # in a unit
        rows = np.arange(S) * (W // numbers)
        inside = (rows[:, None] + np.arange(S // numbers)).reshape(-1)
        first = _first_inputs(N, H, W // numbers, T, T // numbers)[window]
        max_windows = N * (H // T) * (W // T)
        memory = layer.buffer("X", (max_windows * S * S,))
        out = memory[: A * S * S].view(unit).reshape(A, S * S // numbers)
        np.take(x.reshape(-1).view(unit), first[:, None] + inside, out=out, mode="clip")
        return out.view(x.dtype).reshape(A, S * S)

    def backward(
        self, layer: FastLayer, x: Blob, y: Blob, w: Array, dw: Array, db: Array | None, down: bool
    ) -> None:
        """Add to dw and db. Raises NotFiniteError if forward did."""
        assert isinstance(y, FastBlob) and y.tile is not None and not down
        sparse = y.sparse
        if sparse is None:
            raise NotFiniteError
        assert sparse.diff is not None and sparse.winner is not None
        T, S, k = y.tile, 2 * y.tile, w.shape[2]
        O, A = sparse.diff.shape
        X = self.patches(layer, x.data, sparse.window, T)
        # Column a of dY has O numbers, in the rows (winner, o).
        rows = sparse.winner.T.astype(np.int32) * O + np.arange(O, dtype=np.int32)
        column_starts = np.arange(0, O * A + 1, O, dtype=np.int32)
        values = sparse.diff.T.reshape(-1)
        dY = scipy.sparse.csc_array((values, rows.reshape(-1), column_starts), shape=(T * T * O, A))
        dM = (dY @ X).reshape(T, T, O, S, S)
        for p, q in np.ndindex(T, T):
            dw[:, 0] += dM[p, q, :, p : p + k, q : q + k]
        dw += (sparse.rest_diff * self.background(x))[:, None, None, None]
        if db is not None:
            db += sparse.diff.sum(axis=1) + sparse.rest_diff


@functools.lru_cache(maxsize=16)
def _first_inputs(N: int, H: int, W: int, rows: int, columns: int) -> Array:
    """Flat index in images (N, H, W) of the first input of each window; windows are ``rows`` and
    ``columns`` apart.
    """
    windows = N, H // rows - 1, W // columns - 1
    image, row, column = np.indices(windows).reshape(3, -1)
    return np.asarray((image * H + row * rows) * W + column * columns)
