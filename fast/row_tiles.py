r"""RowTiles: convolution on tiles (tiles.py), in which one matrix product computes T neighbouring
outputs of a row.

Im2col copies each value of x kh * kw times and multiplies by a matrix with only O rows, which is
too flat for a fast product. Here the T outputs y[h, T t : T t + T] all read the J = T + kw - 1
inputs x[h + i, T t : T t + J], so

    Y[h]  (T O, L)  =  M (T O, kh J C)  @  X[h : h + kh]  (kh J C, L)        L = N * W / T

M[p, o, i, p + j, c] = w[o, c, i, j] and zero elsewhere (a Toeplitz matrix). Some products are with
zero, but M has T times the rows, and x is copied only J / T times: X[h, j, c, (n, t)] = x[n, c, h,
T t + j]. The kh rows of X for an output row are contiguous, so all right factors are one strided
view of X, and the result is y as tiles of T (tiles.py), the layout that a T x T max pooling reads.

The gradient of the kernel is the same product transposed, folded back from M to w. The gradient of
x is a convolution of the same form: of dy with the flipped kernel, with kh - 1 rows of zeros above
and below and kw - 1 columns on the left. Images are adjacent in a row, and the zero columns at the
end of each image of dy are also those before the next.
"""

from __future__ import annotations

import numpy as np

from fast.fast_layer import FastLayer
from fast.geometry import Geometry, check_finite
from fast.tiles import pitch_of, store_plain, tile_of, tiled_shape, tiles_of, untile
from netlib.blob import Array, Blob, Blobs, divide_up

MAX_ROW = 40  # C kw; with more, the products of Rows are as large without tiles


class RowTiles:
    """A convolution with stride 1, without padding, dilation or groups."""

    def __init__(self) -> None:
        self._matrices: tuple[Array, int, Array, Array] | None = None

    @staticmethod
    def fits(g: Geometry, bottom: Blobs, top: Blobs, w: Blob) -> bool:
        """Whether the convolution has these options, and so few numbers in a row of the kernel
        that tiles help.
        """
        if len(g.kernel) != 2 or len(bottom[0].shape) != 4:
            return False
        if not g.is_dense or any(g.pad) or g.group > 1:
            return False
        return max(g.kernel) > 1 and w.shape[1] * w.shape[3] <= MAX_ROW

    def tile(self, top_tile: int | None, w: tuple[int, ...]) -> int:
        """Return T: the tile of the top if it is tiled, else a heuristic for w (O, C, kh, kw).

        M has T O rows, and J C = (T + kw - 1) C columns per row of the kernel, so a larger T helps
        more if C kw is small. The bounds were chosen for the layers of the hand network, C kw = 5,
        40 and 24, each of which was fastest with the tile that its pooling reads.
        """
        if top_tile is not None:
            return top_tile
        return 4 if w[1] * w[3] <= 8 else 2

    def pitch(self, x: Blob, y: Blob, T: int) -> int:
        """Number of columns stored per row."""
        return pitch_of(y) if tile_of(y) else divide_up(pitch_of(x) or x.width, T) * T

    def matrices(self, w: Array, T: int) -> tuple[Array, Array]:
        """M of the kernel and of the flipped kernel.

        Computed again when the weights have changed.
        """
        found = self._matrices
        if found is None or found[1] != T or not np.array_equal(found[0], w):
            flipped = w[:, :, ::-1, ::-1].transpose(1, 0, 2, 3)
            found = self._matrices = (w.copy(), T, toeplitz(w, T), toeplitz(flipped, T))
        return found[2], found[3]

    def forward(self, layer: FastLayer, x: Blob, y: Blob, w: Array, bias: Array | None) -> None:
        """Compute y from x.

        Raises NotFiniteError, because the zeros of M would make NaN of infinity.
        """
        check_finite(x.data)
        T = self.tile(tile_of(y), w.shape)
        _, O, Ho, Wo = y.shape
        pitch = self.pitch(x, y, T)
        storage = tiled_shape(y.shape, T, pitch)
        out = y.data if tile_of(y) else layer.buffer("Y", storage)
        rows = out[:Ho].reshape(Ho, T * O, -1)
        X = self.lower(layer, x, w.shape, T, pitch)
        np.matmul(self.matrices(w, T)[0], stacked_rows(X, w.shape[2]), out=rows)
        if bias is not None:
            rows.reshape(Ho, T, O, -1)[...] += bias[:, None]
        if tile_of(y) is None:
            y.data[...] = untile(out, Ho, Wo)

    def lower(self, layer: FastLayer, x: Blob, w: tuple[int, ...], T: int, pitch: int) -> Array:
        """Copy x to X (H, J C, L), of which ``stacked_rows`` gives all right factors."""
        (N, C, H, _), kw = x.shape, w[3]
        J, P = T + kw - 1, pitch // T
        X = layer.buffer("X", (H, J, C, N, P))
        if tile_of(x) == T and pitch_of(x) == pitch:
            X[:, :T] = x.data[:H]
        else:
            tiles_of(x, x.data, T, pitch, X[:, :T])
        rows = X.reshape(H, J, C, N * P)
        # the last column is that of the next image, but no valid output reads it
        for j in range(T, J):
            rows[:, j, :, :-1] = rows[:, j - T, :, 1:]
        return rows.reshape(H, J * C, N * P)

    def backward(
        self, layer: FastLayer, x: Blob, y: Blob, w: Array, dw: Array, db: Array | None, down: bool
    ) -> None:
        """Add to dw and db, and write dx if ``down``. Raises NotFiniteError before."""
        T = self.tile(tile_of(y), w.shape)
        (_, O, Ho, _), kh = y.shape, w.shape[2]
        pitch = self.pitch(x, y, T)
        storage = tiled_shape(y.shape, T, pitch)
        out = y.diff if tile_of(y) else layer.buffer("dY", storage)
        dy = tiles_of(y, y.diff, T, pitch, out)[:Ho].reshape(Ho, T * O, -1)
        X = self.lower(layer, x, w.shape, T, pitch)
        product = layer.buffer("G", (Ho, kh * X.shape[1], T * O))
        np.matmul(stacked_rows(X, kh), dy.swapaxes(1, 2), out=product)
        found = fold(product.sum(axis=0).T, w.shape, T)
        check_finite(found)
        check_finite(w)
        dw += found
        if db is not None:
            db += dy.reshape(Ho, T, O, -1).sum(axis=(0, 1, 3))
        if down:
            self.backward_x(layer, x, dy.reshape(Ho, T, O, -1), w, T, pitch)

    def backward_x(
        self, layer: FastLayer, x: Blob, dy: Array, w: Array, T: int, pitch: int
    ) -> None:
        """Compute dx from dy (Ho, T, O, L)."""
        (N, C, H, W), (O, _, kh, kw), (Ho, _, _, L) = x.shape, w.shape, dy.shape
        J = T + kw - 1
        D = layer.buffer("D", (H + kh - 1, J, O, L))  # the rows above and below remain zero
        rows = D[kh - 1 : kh - 1 + Ho]
        for j in range(J):  # of column T t + j - (kw - 1) of dy
            back, phase = divmod(j - (kw - 1), T)
            rows[:, j, :, -back:] = dy[:, phase, :, : L + back]
        direct = tile_of(x) == T and pitch_of(x) == pitch
        dx = x.diff[:H] if direct else layer.buffer("dX", (H, T, C, N, pitch // T))
        flipped, windows = self.matrices(w, T)[1], stacked_rows(D.reshape(len(D), J * O, L), kh)
        np.matmul(flipped, windows, out=dx.reshape(H, T * C, L))
        if direct:
            x.diff[H:] = 0  # padding, which may have values of a higher image
            return
        store_plain(x, untile(dx, H, W), x.diff)


def toeplitz(w: Array, T: int) -> Array:
    """Build M (T O, kh J C) from a kernel w (O, C, kh, kw): T copies of it, each shifted right
    by one column.
    """
    O, C, kh, kw = w.shape
    M = np.zeros((T, O, kh, T + kw - 1, C), w.dtype)
    for p in range(T):
        M[p, :, :, p : p + kw] = w.transpose(0, 2, 3, 1)
    return M.reshape(T * O, -1)


def fold(M: Array, w: tuple[int, ...], T: int) -> Array:
    """Adjoint of ``toeplitz``: convert the gradient of M (T O, kh J C) to that of the kernel."""
    O, C, kh, kw = w
    M = M.reshape(T, O, kh, T + kw - 1, C)
    total = np.zeros((O, kh, kw, C), M.dtype)
    for p in range(T):
        total += M[p, :, :, p : p + kw]
    return total.transpose(0, 3, 1, 2)


def stacked_rows(X: Array, kh: int) -> Array:
    """View X (H, R, L) as (H - kh + 1, kh R, L): each kh consecutive rows.

    X must be C-contiguous. NumPy's as_strided takes 3 us for each of the hundreds of views per
    batch and is not used.
    """
    (H, R, L), item = X.shape, X.itemsize
    strides = R * L * item, L * item, item
    return np.ndarray((H - kh + 1, kh * R, L), X.dtype, X, 0, strides)
