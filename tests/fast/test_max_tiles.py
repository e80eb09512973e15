"""Max pooling on tiles gives the same results as plain loops."""

from __future__ import annotations

import numpy as np
import pytest

from netlib import gradcheck
from netlib.blob import Blobs
from tests.support.plain_loops import pool
from tests.support.tiled import check_padding, load, store, tiled


def compare(T, x, y, share, bottom_tile=None, top_tile=None):
    """Compare the values and gradients of a layer with the definition."""
    layer = gradcheck.make_layer(
        f'type: "Pooling" pooling_param {{ kernel_size: {T} stride: {T} }}', [x]
    )
    bottom, top = Blobs([tiled(x.shape, bottom_tile)]), Blobs([tiled(y.shape, top_tile)])
    layer.reshape(bottom, top)
    store(bottom[0], "data", x)
    layer.forward(bottom, top)
    assert np.allclose(load(top[0], "data"), y)
    dy = np.random.default_rng(1).normal(size=y.shape)
    store(top[0], "diff", dy)
    bottom[0].diff[...] = np.nan
    layer.backward(top, [True], bottom)
    assert np.allclose(load(bottom[0], "diff"), np.einsum("ncpq,ncpqhw->nchw", dy, share))
    check_padding(bottom[0])


@pytest.mark.parametrize("size", [(4, 4), (5, 9), (8, 6), (4, 17), (7, 7)])
@pytest.mark.parametrize("tiled_bottom", [False, True])
@pytest.mark.parametrize("T", [2, 3, 4])
def test_max_pooling_of_any_size(rng, size, tiled_bottom, T):
    """Values are rounded so that some are equal."""
    x = np.round(rng.normal(size=(3, 2, *size)))
    for top_tile in (None, 1, 2, 4):
        compare(T, x, *pool(x, (T, T), (T, T), (0, 0)), T if tiled_bottom else None, top_tile)
