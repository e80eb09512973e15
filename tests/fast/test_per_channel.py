"""BatchNorm and Scale of the fast engine give the results of the plain layers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import netlib
from tests.support.nets import inputs

SHAPES = [(3, 4, 5, 6), (1, 7, 40, 50), (20, 3, 1, 1), (5, 300, 2, 3)]
LAYERS = {
    "norm": 'type: "BatchNorm"',
    "norm by sums": 'type: "BatchNorm" batch_norm_param { use_global_stats: true }',
    "scale": 'type: "Scale" scale_param { bias_term: true filler { type: "gaussian" std: 1 } }',
    "scale of two axes": 'type: "Scale" scale_param { num_axes: 2 filler { type: "gaussian" std: 1 } }',
    "one scale": 'type: "Scale" scale_param { num_axes: 0 filler { type: "gaussian" std: 1 } }',
}


def positive(net: netlib.Net) -> None:
    """Set parameters that a BatchNorm can have as sums."""
    for param in net.params.get("l", []):
        param.data[...] = np.abs(param.data) + 0.5


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 2e-5), (np.float64, 1e-11)])
@pytest.mark.parametrize("phase", [netlib.TRAIN, netlib.TEST])
@pytest.mark.parametrize("name", LAYERS)
def test_the_plain_layers_results(
    agree: Callable[..., netlib.Net], rng: np.random.Generator, name: str, phase: int, dtype: type, tolerance: float
) -> None:
    """For large and small maps, with and without working in place."""
    for shape in SHAPES:
        x = (rng.normal(size=shape) + 3).astype(dtype)
        for bottom, copy in [("x", ""), ("y", 'layer { name: "c" type: "Power" bottom: "x" top: "y" }')]:
            text = f'{inputs(x=shape)} {copy} layer {{ name: "l" bottom: "{bottom}" top: "y" {LAYERS[name]} }}'
            agree("force_backward: true " + text, {"x": x}, {"x": 2 * x}, tolerance=tolerance, phase=phase, dtype=dtype,
                  prepare=positive)
