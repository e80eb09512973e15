"""export/onnx/normalization.py: each layer type on its own."""

from __future__ import annotations

import pytest

from tests.support.onnx_nets import IMAGE, Cases, check, examples, types_of

CASES: Cases = {
    "BN": [
        (IMAGE, "bn_param { bn_mode: INFERENCE }", 1),
        (IMAGE, "bn_param { momentum: 0.95 eps: 0.1 }", 1),
        (IMAGE, "bn_param { frozen: true }", 1),
    ],
    "BatchNorm": [(IMAGE, "", 1), ([(1, 5)], "batch_norm_param { eps: 0.1 }", 1)],
    "LRN": [
        ([(1, 7, 3, 2)], "lrn_param { local_size: 3 alpha: 2 beta: 0.6 k: 1.5 }", 1),
        (IMAGE, "lrn_param { norm_region: WITHIN_CHANNEL local_size: 3 alpha: 2 }", 1),
    ],
    "MVN": [
        (IMAGE, "", 1),
        (IMAGE, "mvn_param { across_channels: true eps: 0.1 }", 1),
        ([(1, 3, 5)], "mvn_param { normalize_variance: false across_channels: true }", 1),
    ],
    "Normalize": [
        (IMAGE, "", 1),
        (IMAGE, "norm_param { across_spatial: false channel_shared: false eps: 0.1 }", 1),
        ([(1, 5)], "norm_param { channel_shared: false }", 1),
    ],
}


@pytest.mark.parametrize(("name", "shapes", "options", "tops"), examples(CASES))
def test_layer(name, shapes, options, tops, files):
    """The exported layer computes the same as netlib."""
    check(files, name, shapes, options, tops)


def test_every_type_has_an_example():
    """Every layer type of layers/normalization has an example."""
    assert set(CASES) == types_of("normalization")
