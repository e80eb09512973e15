"""export/onnx/activation.py: each layer type on its own."""

from __future__ import annotations

import pytest

from tests.support.onnx_nets import IMAGE, Cases, check, examples, types_of

CASES: Cases = {
    "AbsVal": [(IMAGE, "", 1)],
    "BNLL": [(IMAGE, "", 1)],
    "Bias": [
        (IMAGE, "", 1),
        (IMAGE, "bias_param { axis: 2 num_axes: -1 }", 1),
        ([*IMAGE, (1, 3)], "bias_param { axis: 0 }", 1),
    ],
    "Clip": [(IMAGE, "clip_param { min: -0.5 max: 0.25 }", 1), (IMAGE, "clip_param { min: 0.25 max: -0.5 }", 1)],
    "ELU": [(IMAGE, "elu_param { alpha: 0.7 }", 1)],
    "Exp": [(IMAGE, "", 1), (IMAGE, "exp_param { base: 2 scale: 3 shift: 1 }", 1)],
    "Log": [(IMAGE, "log_param { base: 2 scale: 3 shift: 4 }", 1), (IMAGE, "", 1)],
    "PReLU": [(IMAGE, "", 1), ([(1, 5)], "", 1), (IMAGE, "prelu_param { channel_shared: true }", 1)],
    "Power": [
        (IMAGE, "", 1),
        (IMAGE, "power_param { scale: 2 shift: -1 }", 1),
        (IMAGE, "power_param { power: 3 shift: 1 }", 1),
        (IMAGE, "power_param { power: 0.5 scale: 0.5 shift: 2 }", 1),
    ],
    "ReLU": [(IMAGE, "", 1), (IMAGE, "relu_param { negative_slope: 0.1 }", 1)],
    "ReLU6": [(IMAGE, "", 1), (IMAGE, "relu6_param { negative_slope: 0.1 }", 1), ([(4, 300)], "", 1)],
    "Scale": [
        (IMAGE, "", 1),
        (IMAGE, "scale_param { axis: 2 num_axes: 2 bias_term: true }", 1),
        (IMAGE, "scale_param { num_axes: 0 bias_term: true }", 1),
        ([*IMAGE, (1, 3)], "scale_param { axis: 0 }", 1),
    ],
    "Sigmoid": [(IMAGE, "", 1)],
    "Swish": [(IMAGE, "swish_param { beta: 1.7 }", 1)],
    "TanH": [(IMAGE, "", 1)],
    "Threshold": [(IMAGE, "threshold_param { threshold: 0.3 }", 1)],
}


@pytest.mark.parametrize(("name", "shapes", "options", "tops"), examples(CASES))
def test_layer(name, shapes, options, tops, files):
    """The exported layer computes the same as netlib."""
    check(files, name, shapes, options, tops)


def test_every_type_has_an_example():
    """Every layer type of layers/activation has an example."""
    assert set(CASES) == types_of("activation")
