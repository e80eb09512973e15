"""FastInnerProduct on up to FEW_ITEMS items."""

from __future__ import annotations

import platform
import sys
from unittest import mock

import numpy as np
import pytest

import netlib
from fast import inner_product
from fast.inner_product import CACHED_BYTES, FEW_ITEMS, FastInnerProduct
from netlib.blob import Array
from tests.layers.conftest import Run

INPUTS, OUTPUTS = 1152, 700  # as in the paper's FC1; more than three blocks of weights in the cache
TEXT = f'type: "InnerProduct" inner_product_param {{ num_output: {OUTPUTS} weight_filler {{ type: "gaussian" }} }}'


def forward(x: Array) -> Array:
    """Compute the output (N, OUTPUTS) for x (N, INPUTS)."""
    done = Run(TEXT, [x], dtype=np.float32)
    assert isinstance(done.layer, FastInnerProduct)
    return done.y


def assert_same(found: Array, expected: Array) -> None:
    """They are bitwise equal with OpenBLAS's kernels for x86; in other libraries rounding may
    depend on the position.
    """
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
    if (sys.platform, platform.machine()) == ("linux", "x86_64"):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("count", [2, FEW_ITEMS])
def test_an_item_does_not_depend_on_the_others(
    rng: np.random.Generator, keep_threads: None, count: int, threads: int
) -> None:
    """Several items, in blocks of outputs, give the same results as each item alone,
    in one product.
    """
    assert 4 * INPUTS * OUTPUTS > 3 * CACHED_BYTES
    netlib.set_threads(threads)
    x = rng.normal(size=(count, INPUTS)).astype(np.float32)
    together = forward(x)
    alone = np.concatenate([forward(item[None]) for item in x])
    assert_same(together, alone)


def test_large_weights_in_blocks_for_each_thread(
    rng: np.random.Generator, keep_threads: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One item is multiplied by a part of large weights on each thread, with the same results as
    in one product.
    """
    netlib.set_threads(3)
    x = rng.normal(size=(1, INPUTS)).astype(np.float32)
    whole = forward(x)
    blocks = mock.Mock(wraps=inner_product.blocks)
    monkeypatch.setattr(inner_product, "LARGE_BYTES", 4 * INPUTS * OUTPUTS)
    monkeypatch.setattr(inner_product, "blocks", blocks)
    parts = forward(x)
    assert mock.call(OUTPUTS, 256) in blocks.mock_calls  # a multiple of 64
    assert_same(parts, whole)
