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


def images(rng, N, size, seen):
    """Images with background 1, and random values in a square with sides of ``seen`` pixels."""
    x = np.ones((N, 1, size, size))
    for i in range(N):
        top, left = rng.integers(0, size - seen + 1, 2)
        x[i, 0, top : top + seen, left : left + seen] = rng.uniform(-1, 0.9, (seen, seen))
    return x


def blobs(x, O, k, T):
    """Create the bottom, and a top in tiles of T."""
    bottom = Blob(x.shape, x.dtype)
    top = tiled((len(x), O, x.shape[2] - k + 1, x.shape[3] - k + 1), T, dtype=x.dtype)
    bottom.data[...], top.pitch = x, x.shape[3]
    return bottom, top


def fits(bottom, top, w_shape, pad=0):
    """Whether WindowTiles computes a convolution from the bottom to a top that may be sparse."""
    top.may_be_sparse = True
    g = Geometry(w_shape[2:], (1, 1), (pad, pad), (1, 1), 1)
    return WindowTiles.fits(g, Blobs([bottom]), Blobs([top]), Blob(w_shape))


def corners(sparse, shape, T):
    """Image, first row and first column of every stored window of a top of this shape."""
    image, row, column = np.unravel_index(sparse.window, (shape[0], shape[2] // T, shape[3] // T))
    return zip(image, row * T, column * T)


def dense(sparse, shape, T, values, rest):
    """Build a plain array from the stored windows and the value of all others."""
    y = np.empty(shape)
    y[...] = np.asarray(rest)[:, None, None]
    for a, (n, r, c) in enumerate(corners(sparse, shape, T)):
        y[n, :, r : r + T, c : c + T] = values[:, :, a].reshape(T, T, -1).transpose(2, 0, 1)
    return y


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("T", "k", "size"), [(4, 5, 16), (2, 3, 8), (4, 5, 20), (8, 9, 24)])
@pytest.mark.parametrize("seen", [0, 1, 5, "all"])
def test_forward_and_backward(rng, seen, T, k, size, dtype):
    x = images(rng, 3, size, size if seen == "all" else seen).astype(dtype)
    w, b = rng.normal(size=(2, 1, k, k)).astype(dtype), rng.normal(size=2).astype(dtype)
    bottom, top = blobs(x, 2, k, T)
    assert fits(bottom, top, w.shape)
    layer = gradcheck.make_layer(
        'type: "Convolution" convolution_param { num_output: 2 kernel_size: 1 }', [x]
    )
    layer.dtype = np.dtype(dtype)
    way, exact = WindowTiles(), 1e-4 if dtype == np.float32 else 1e-12
    way.forward(layer, bottom, top, w, b)
    found = top.sparse
    want = convolve(x, w, b)
    assert np.allclose(
        dense(found, want.shape, T, found.values + found.bias[:, None], found.rest),
        want,
        atol=exact,
    )
    dy = rng.normal(size=want.shape).astype(dtype)
    mark = np.zeros(want.shape)
    A = len(found.window)
    found.diff = rng.normal(size=(2, A)).astype(dtype)
    found.winner = rng.integers(0, T * T, (2, A)).astype(np.uint8)
    for a, (n, r, c) in enumerate(corners(found, want.shape, T)):
        mark[n, :, r : r + T, c : c + T] = 1
        dy[n, :, r : r + T, c : c + T] = 0
        for o, place in enumerate(found.winner[:, a]):  # as from a max pooling
            dy[n, o, r + place // T, c + place % T] = found.diff[o, a]
    found.rest_diff = (dy * (1 - mark)).sum(axis=(0, 2, 3)).astype(dtype)
    dw, db = np.ones_like(w), np.ones_like(b)
    way.backward(layer, bottom, top, w, dw, db, False)
    u = rng.normal(size=w.shape)
    assert np.isclose(
        ((dw - 1) * u).sum(), (dy * convolve(x, u, np.zeros(2))).sum(), rtol=exact, atol=exact
    )
    assert np.allclose(db - 1, dy.sum(axis=(0, 2, 3)), rtol=exact, atol=exact)


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
    layer = gradcheck.make_layer(
        'type: "Convolution" convolution_param { num_output: 1 kernel_size: 1 }', [x]
    )
    layer.dtype = np.dtype(np.float32)
    WindowTiles().forward(layer, bottom, top, np.ones((1, 1, 5, 5), np.float32), None)
    assert [(w // 3, w % 3) for w in top.sparse.window] == [(1, 1), (1, 2), (2, 1), (2, 2)]
