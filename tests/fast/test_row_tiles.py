"""RowTiles: the fast convolution gives the same results as plain loops, for all
layouts of its top.
"""

import numpy as np
import pytest

from fast.row_tiles import RowTiles, fold, toeplitz
from netlib import gradcheck
from tests.support.plain_loops import check_transpose, convolve
from tests.support.tiled import check_padding, load, store, tiled


def fast(x, w, b, dy, tile=None, bottom_tile=None):
    """Compute y, dx, dw, db by RowTiles, with a top in tiles of ``tile`` and a bottom in tiles of
    ``bottom_tile``.
    """
    O, _, kh, kw = w.shape
    layer = gradcheck.make_layer(
        f'type: "Convolution" convolution_param {{ num_output: {O} kernel_h: {kh} kernel_w: {kw} }}',
        [x],
    )
    bottom, top = tiled(x.shape, bottom_tile), tiled(dy.shape, tile)
    if tile:
        top.pitch = -(-(bottom.pitch or x.shape[3]) // tile) * tile
    store(bottom, "data", x)
    store(top, "diff", dy)
    bottom.diff[...] = np.nan
    dw, db, way = np.ones_like(w), np.ones_like(b), RowTiles()
    way.forward(layer, bottom, top, w, b)
    way.backward(layer, bottom, top, w, dw, db, True)
    check_padding(bottom)
    return load(top, "data"), load(bottom, "diff"), dw - 1, db - 1


@pytest.mark.parametrize("bottom_tile", [None, 1, 2, 3])
@pytest.mark.parametrize("tile", [None, 1, 2, 3, 4, 5])
@pytest.mark.parametrize(
    ("image", "kernel"),
    [
        ((5, 5), (1, 1)),
        ((5, 5), (5, 5)),
        ((8, 12), (5, 5)),
        ((7, 4), (2, 3)),
        ((3, 11), (3, 1)),
        ((6, 9), (1, 4)),
    ],
)
def test_any_size(rng, image, kernel, tile, bottom_tile):
    """Forward is the definition, backward its transpose; images that are adjacent in a row do not
    affect each other.
    """
    x, w, b = rng.normal(size=(3, 2, *image)), rng.normal(size=(2, 2, *kernel)), rng.normal(size=2)
    want = convolve(x, w, b)
    dy = rng.normal(size=want.shape)
    y, dx, dw, db = fast(x, w, b, dy, tile, bottom_tile)
    assert np.allclose(y, want, rtol=0, atol=1e-12)
    check_transpose(dy, x, w, b, dx, dw, db, convolve)


@pytest.mark.parametrize("T", [1, 2, 4])
def test_toeplitz_and_fold_are_adjoint(rng, T):
    """For any G, <M(w), G> = <w, fold(G)>."""
    w = rng.normal(size=(3, 2, 3, 2))
    G = rng.normal(size=toeplitz(w, T).shape)
    assert np.isclose((toeplitz(w, T) * G).sum(), (w * fold(G, w.shape, T)).sum())


def test_new_weights_make_new_matrices(rng):
    """The matrices are computed again if the weights differ, also if the same
    array was modified.
    """
    way, w = RowTiles(), rng.normal(size=(2, 1, 2, 2))
    before = way.matrices(w, 2)[0].copy()
    assert np.array_equal(way.matrices(w, 2)[0], before)
    w[0, 0, 0, 0] += 1
    assert not np.array_equal(way.matrices(w, 2)[0], before)
    assert way.matrices(w, 4)[0].shape != before.shape
