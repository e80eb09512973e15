"""WindowTiles: the convolution that skips the background gives the same results as
the plain one.
"""

import numpy as np
import pytest

from fast.geometry import Geometry
from fast.window_tiles import WindowTiles
from netlib import gradcheck
from netlib.blob import Blob, Blobs
from tests.support.plain_loops import convolve
from tests.support.tiled import tiled


def images(rng, N, size, side):
    """Images with background 1, and random values in a square with this side."""
    x = np.ones((N, 1, size, size))
    for image in x[:, 0]:
        top, left = rng.integers(0, size - side + 1, 2)
        image[top : top + side, left : left + side] = rng.uniform(-1, 0.9, (side, side))
    return x


def layer_of(x):
    """A convolution layer, for its buffers."""
    text = 'type: "Convolution" convolution_param { num_output: 1 kernel_size: 1 }'
    layer = gradcheck.make_layer(text, [x])
    layer.dtype = x.dtype
    return layer


def blobs(x, O, k, T):
    """Create the bottom, and a top in tiles of T."""
    bottom = Blob(x.shape, x.dtype)
    top = tiled((len(x), O, x.shape[2] - k + 1, x.shape[3] - k + 1), T, dtype=x.dtype)
    bottom.data[...] = x
    top.pitch = x.shape[3]
    return bottom, top


def fits(bottom, top, w_shape, pad=0):
    """Whether WindowTiles computes a convolution from the bottom to a top that may be sparse."""
    top.may_be_sparse = True
    g = Geometry(w_shape[2:], (1, 1), (pad, pad), (1, 1), 1)
    return WindowTiles.fits(g, Blobs([bottom]), Blobs([top]), Blob(w_shape))


def stored(y, sparse, T):
    """Views of the windows of y (N, O, ...) that are stored, in their order."""
    windows = len(y), y.shape[2] // T, y.shape[3] // T
    for n, row, column in zip(*np.unravel_index(sparse.window, windows)):
        yield y[n, :, row * T :, column * T :][:, :T, :T]


def dense(sparse, shape, T):
    """Build a plain array from the stored windows and the value of all others."""
    y = np.empty(shape)
    y[...] = sparse.rest[:, None, None]
    values = (sparse.values + sparse.bias[:, None]).transpose(2, 1, 0)
    for window, own in zip(stored(y, sparse, T), values):
        window[...] = own.reshape(window.shape)
    return y


def take_gradient(sparse, dy, T, rng):
    """Give the windows random gradients of their winners, as from a max pooling, write them to dy,
    and sum the others.
    """
    O, A = dy.shape[1], len(sparse.window)
    sparse.diff = rng.normal(size=(O, A)).astype(dy.dtype)
    sparse.winner = rng.integers(0, T * T, (O, A)).astype(np.uint8)
    for window in stored(dy, sparse, T):
        window[...] = 0
    sparse.rest_diff = dy.sum(axis=(0, 2, 3))
    for window, winners, diffs in zip(stored(dy, sparse, T), sparse.winner.T, sparse.diff.T):
        window[np.arange(O), winners // T, winners % T] = diffs


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("T", "k", "size"), [(4, 5, 16), (2, 3, 8), (4, 5, 20), (8, 9, 24)])
@pytest.mark.parametrize("side", [0, 1, 5, "all"])
def test_forward_and_backward(rng, side, T, k, size, dtype):
    """The gradient of the weights is checked by its product with random weights u."""
    x = images(rng, 3, size, size if side == "all" else side).astype(dtype)
    w = rng.normal(size=(2, 1, k, k)).astype(dtype)
    b = rng.normal(size=2).astype(dtype)
    bottom, top = blobs(x, 2, k, T)
    assert fits(bottom, top, w.shape)
    layer, convolution = layer_of(x), WindowTiles()
    tolerance = 1e-4 if dtype == np.float32 else 1e-12
    convolution.forward(layer, bottom, top, w, b)
    expected = convolve(x, w, b)
    assert np.allclose(dense(top.sparse, expected.shape, T), expected, atol=tolerance)
    dy = rng.normal(size=expected.shape).astype(dtype)
    take_gradient(top.sparse, dy, T, rng)
    dw, db = np.ones_like(w), np.ones_like(b)
    convolution.backward(layer, bottom, top, w, dw, db, False)
    u = rng.normal(size=w.shape)
    along_u = (dy * convolve(x, u, np.zeros(2))).sum()
    assert np.isclose(((dw - 1) * u).sum(), along_u, rtol=tolerance, atol=tolerance)
    assert np.allclose(db - 1, dy.sum(axis=(0, 2, 3)), rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize(
    ("T", "k", "size", "channels"),
    [(4, 3, 16, 1), (4, 5, 18, 1), (3, 4, 12, 1), (4, 5, 16, 2), (None, 5, 16, 1)],
    ids=["another kernel", "another size", "another tile", "two channels", "no tiles"],
)
def test_other_shapes_do_not_fit(T, k, size, channels):
    """A window must read exactly 2 x 2 blocks of one channel, with T of 2, 4 or 8."""
    bottom, top = Blob((1, channels, size, size)), tiled((1, 2, size - k + 1, size - k + 1), T)
    assert not fits(bottom, top, (2, channels, k, k))


def test_only_windows_with_foreground_are_stored():
    """One foreground pixel, in block (2, 2) of 4 x 4 pixels, gives the four windows that
    read this block.
    """
    x = np.ones((1, 1, 16, 16), np.float32)
    x[0, 0, 9, 9] = 0
    bottom, top = blobs(x, 1, 5, 4)
    WindowTiles().forward(layer_of(x), bottom, top, np.ones((1, 1, 5, 5), np.float32), None)
    assert [(w // 3, w % 3) for w in top.sparse.window] == [(1, 1), (1, 2), (2, 1), (2, 2)]
