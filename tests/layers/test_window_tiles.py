"""WindowTiles: the convolution that skips the background gives what the plain one gives."""

import numpy as np
import pytest
from test_convolution import plain

from layers.window_tiles import WindowTiles
from netlib import gradcheck
from netlib.blob import Blob


def images(rng, N, size, seen):
    """Background 1, and random values in a square of ``seen`` pixels."""
    x = np.ones((N, 1, size, size))
    for i in range(N):
        top, left = rng.integers(0, size - seen + 1, 2)
        x[i, 0, top : top + seen, left : left + seen] = rng.uniform(-1, 0.9, (seen, seen))
    return x


def blobs(x, O, k, T):
    """Bottom, and a top in tiles of T."""
    bottom, top = Blob(x.shape, x.dtype), Blob((len(x), O, x.shape[2] - k + 1, x.shape[3] - k + 1), x.dtype)
    bottom.data[...] = x
    top.tile, top.pitch = T, x.shape[3]
    return bottom, top


def corners(sparse, shape, T):
    """Image, first row and first column of every stored window of a top of this shape."""
    image, row, column = np.unravel_index(sparse.window, (shape[0], shape[2] // T, shape[3] // T))
    return zip(image, row * T, column * T)


def dense(sparse, shape, T, values, rest):
    """A plain array from stored windows and the value of all others."""
    y = np.empty(shape)
    y[...] = np.asarray(rest)[:, None, None]
    for a, (n, r, c) in enumerate(corners(sparse, shape, T)):
        y[n, :, r : r + T, c : c + T] = values[:, :, a].reshape(T, T, -1).transpose(2, 0, 1)
    return y


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("T", "k", "size"), [(4, 5, 16), (4, 3, 18), (2, 3, 8), (4, 5, 20), (8, 9, 32)])
@pytest.mark.parametrize("seen", [0, 1, 5, "all"])
def test_forward_and_backward(rng, seen, T, k, size, dtype):
    """For images with nothing but background, with a little, and without background."""
    x = images(rng, 3, size, size if seen == "all" else seen).astype(dtype)
    w, b = rng.normal(size=(2, 1, k, k)).astype(dtype), rng.normal(size=2).astype(dtype)
    bottom, top = blobs(x, 2, k, T)
    kernel = Blob(w.shape, dtype)
    if not WindowTiles.fits(bottom, top, kernel):
        assert any(n % T for n in [*x.shape[2:], *top.shape[2:]]) or (k - 1) * x.itemsize % 8 or T * x.itemsize % 8
        return
    layer = gradcheck.make_layer('type: "Convolution" convolution_param { num_output: 2 kernel_size: 1 }', [x])
    layer.dtype = np.dtype(dtype)
    way, exact = WindowTiles(), 1e-4 if dtype == np.float32 else 1e-12
    way.forward(layer, bottom, top, w, b)
    found = top.sparse
    want = plain(x, w, b)
    assert np.allclose(dense(found, want.shape, T, found.values + found.bias[:, None], found.rest), want, atol=exact)
    dy = rng.normal(size=want.shape).astype(dtype)
    mark = np.zeros(want.shape)
    A = len(found.window)
    found.diff = rng.normal(size=(2, A)).astype(dtype)
    found.winner = rng.integers(0, T * T, (2, A)).astype(np.uint8)
    for a, (n, r, c) in enumerate(corners(found, want.shape, T)):
        mark[n, :, r : r + T, c : c + T] = 1
        dy[n, :, r : r + T, c : c + T] = 0
        for o, place in enumerate(found.winner[:, a]):  # as a max pooling passes it down
            dy[n, o, r + place // T, c + place % T] = found.diff[o, a]
    found.rest_diff = (dy * (1 - mark)).sum(axis=(0, 2, 3)).astype(dtype)
    dw, db = np.ones_like(w), np.ones_like(b)
    way.backward(layer, bottom, top, w, dw, db, False)
    u = rng.normal(size=w.shape)
    assert np.isclose(((dw - 1) * u).sum(), (dy * plain(x, u, np.zeros(2))).sum(), rtol=exact, atol=exact)
    assert np.allclose(db - 1, dy.sum(axis=(0, 2, 3)), rtol=exact, atol=exact)


def test_only_windows_that_see_something_are_stored(rng):
    """One pixel in front is seen by one, two or four windows."""
    x = np.ones((1, 1, 16, 16), np.float32)
    x[0, 0, 9, 9] = 0
    bottom, top = blobs(x, 1, 5, 4)
    layer = gradcheck.make_layer('type: "Convolution" convolution_param { num_output: 1 kernel_size: 1 }', [x])
    layer.dtype = np.dtype(np.float32)
    WindowTiles().forward(layer, bottom, top, np.ones((1, 1, 5, 5), np.float32), None)
    assert 1 <= len(top.sparse.window) <= 4
