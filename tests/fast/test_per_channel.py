"""BatchNorm and Scale of the fast engine give the results of the plain layers."""

from __future__ import annotations

import numpy as np
import pytest

import netlib
from netlib.proto import prototxt
from tests.support.nets import inputs

SHAPES = [(3, 4, 5, 6), (1, 7, 40, 50), (20, 3, 1, 1), (5, 300, 2, 3)]
LAYERS = {
    "norm": 'type: "BatchNorm"',
    "norm by sums": 'type: "BatchNorm" batch_norm_param { use_global_stats: true }',
    "scale": 'type: "Scale" scale_param { bias_term: true filler { type: "gaussian" std: 1 } }',
    "scale of two axes": 'type: "Scale" scale_param { num_axes: 2 filler { type: "gaussian" std: 1 } }',
    "one scale": 'type: "Scale" scale_param { num_axes: 0 filler { type: "gaussian" std: 1 } }',
}


def passes(engine: str, text: str, xs: dict[str, np.ndarray], dtype: type, phase: int) -> list[np.ndarray]:
    """Outputs and gradients of two passes."""
    net = netlib.Net(prototxt.parse(text), phase, dtype=dtype, engine=engine, seed=1)
    found = []
    for param in net.params.get("l", []):
        param.data[...] = np.abs(param.data) + 0.5
    for turn in range(2):
        net.clear_param_diffs()
        for name, x in xs.items():
            net.blobs[name].data[...] = x * (turn + 1)
        net.run_forward()
        found.append(net.blobs["y"].data.copy())
        net.backward(y=np.random.default_rng(turn).normal(size=net.blobs["y"].shape))
        found += [net.blobs[name].diff.copy() for name in xs]
        found += [half.copy() for param in net.params.get("l", []) for half in (param.data, param.diff)]
    return found


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("phase", [netlib.TRAIN, netlib.TEST])
@pytest.mark.parametrize("name", LAYERS)
def test_the_plain_layers_results(rng: np.random.Generator, name: str, phase: int, dtype: type) -> None:
    """Outputs, gradients and moving averages agree, for large and small maps, with and without working in place."""
    for shape in SHAPES:
        xs = {"x": (rng.normal(size=shape) + 3).astype(dtype)}
        for bottom, top in [("x", "y"), ("y", "y")]:
            copy = 'layer { name: "c" type: "Power" bottom: "x" top: "y" }' if bottom == "y" else ""
            layer = f'layer {{ name: "l" bottom: "{bottom}" top: "{top}" {LAYERS[name]} }}'
            text = "force_backward: true " + inputs(x=shape) + copy + layer
            expected = passes("plain", text, xs, dtype, phase)
            for found, wanted in zip(passes("fast", text, xs, dtype, phase), expected):
                size = max(np.abs(wanted).max(initial=0), 1)
                assert np.abs(found - wanted).max(initial=0) <= (2e-5 if dtype == np.float32 else 1e-11) * size, text
