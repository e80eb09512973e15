"""Gradients of options and shapes whose computation no case of support/layer_cases.py and no
recording of Caffe has.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from layers import LAYER_TYPES
from tests.support.layer_cases import off_zero

RANDOM = 'weight_filler { type: "gaussian" } bias_filler { type: "gaussian" }'
NORM = 'scale_filler { type: "uniform" min: 0.5 max: 2 } eps: 0.1'
CONT = [[0, 1], [1, 1], [1, 0], [1, 1]]
FIRST = {"wanted": [True, False]}
WINDOWS = [
    "kernel_size: 1",
    "kernel_size: 4 stride: 2 pad: 1",
    "kernel_size: 2 dilation: 2",
    "kernel_size: 2 group: 2",
    "kernel_size: [2, 3] stride: [1, 2] pad: [0, 1]",
    "kernel_size: 2 bias_term: false",
]
SPATIAL = [(2, 4), (2, 4, 5), (1, 4, 3, 2, 3)]  # zero, one and three spatial axes

# of a gain or a bias
SHAPES = ["", "axis: 0", "num_axes: 2", "axis: 0 num_axes: -1", "num_axes: 0", "axis: -1"]
GAINS = 'filler { type: "gaussian" } bias_term: true bias_filler { type: "gaussian" }'

# type, options, bottoms, and the options of the check
CASES: list[tuple[str, str, list[Any], dict[str, Any]]] = [
    *(("Scale", f"scale_param {{ {GAINS} {shape} }}", [off_zero(2, 3, 4)], {}) for shape in SHAPES),
    *(
        ("Scale", f"scale_param {{ {GAINS} }}", [off_zero(2, 3, 4), off_zero(*gain)], {})
        for gain in ((), (3,))
    ),
    *(
        ("Bias", f'bias_param {{ filler {{ type: "gaussian" }} {shape} }}', [off_zero(2, 3, 4)], {})
        for shape in SHAPES
    ),
    *(("Bias", "", [off_zero(2, 3, 4), off_zero(*bias)], {}) for bias in ((), (3,), (3, 4))),
    *(
        ("Bias", "", [off_zero(2, 3, 4), off_zero(3, 4)], {"wanted": [first, not first]})
        for first in (True, False)
    ),
    ("ReLU", "relu_param { negative_slope: -0.5 }", [off_zero(3, 4)], {"in_place": False}),
    ("Softmax", "softmax_param { axis: 0 }", [off_zero(2, 3, 4)], {}),
    ("Softmax", "softmax_param { axis: 2 }", [off_zero(2, 3, 4)], {}),
    ("Concat", "", [off_zero(2, 2), off_zero(2, 3)], {"wanted": [False, True]}),
    (
        "Eltwise",
        "eltwise_param { operation: MAX }",
        [off_zero(2, 4) for _ in range(3)],
        {"wanted": [False, True, False]},
    ),
    (
        "Embed",
        f"embed_param {{ num_output: 2 input_dim: 3 bias_term: false {RANDOM} }}",
        [[[0, 2], [2, 2]]],
        {"wanted": [False]},
    ),
    (
        "InnerProduct",
        f"inner_product_param {{ num_output: 3 bias_term: false {RANDOM} }}",
        [off_zero(2, 3, 2)],
        {},
    ),
    (
        "InnerProduct",
        f"inner_product_param {{ num_output: 3 axis: 2 transpose: true {RANDOM} }}",
        [off_zero(2, 3, 2)],
        {},
    ),
    (
        "Permute",
        "permute_param { order: 4 order: 2 order: 0 order: 1 order: 3 }",
        [off_zero(2, 3, 2, 1, 2)],
        {},
    ),
    ("HingeLoss", "", [off_zero(2, 3, 2), [[5], [0]]], FIRST),
    ("EuclideanLoss", "", [off_zero(3, 4), off_zero(3, 4)], FIRST),
    (
        "InfogainLoss",
        "loss_param { ignore_label: 1 }",
        [off_zero(2, 3, 4), [[0, 1, 2, 2], [1, 0, 0, 2]], off_zero(3, 3)],
        {"wanted": [True, False, False]},
    ),
    (
        "MultinomialLogisticLoss",
        "",
        [abs(off_zero(2, 3, 2)), np.reshape([5, 0], (2, 1, 1, 1))],
        FIRST,
    ),
    ("SigmoidCrossEntropyLoss", "", [off_zero(2, 3, 4), abs(off_zero(2, 12))], FIRST),
    (
        "SmoothL1Loss",
        "",
        [off_zero(3, 4) for _ in range(4)],
        {"wanted": [True, True, False, False]},
    ),
    (
        "LSTM",
        f"recurrent_param {{ num_output: 3 {RANDOM} }}",
        [off_zero(4, 2, 2, 2), CONT, off_zero(2, 3)],
        {"wanted": [True, False, True]},
    ),
    ("RNN", f"recurrent_param {{ num_output: 3 {RANDOM} }}", [off_zero(4, 2, 5), CONT], FIRST),
    ("BatchNorm", "", [off_zero(3, 2, 4)], {}),
    ("LRN", "lrn_param { local_size: 3 k: 2 }", [off_zero(2, 4, 3, 4)], {}),
    ("LRN", "lrn_param { local_size: 3 norm_region: WITHIN_CHANNEL }", [off_zero(2, 4, 3, 4)], {}),
    *(
        (
            "MVN",
            f"mvn_param {{ normalize_variance: {variance} across_channels: {across} }}",
            [off_zero(2, 3, 2, 3)],
            {},
        )
        for variance, across in (("true", "true"), ("false", "true"), ("false", "false"))
    ),
    *(
        (
            "Normalize",
            f"norm_param {{ across_spatial: {across} channel_shared: {shared} {NORM} }}",
            [off_zero(*shape)],
            {},
        )
        for across in ("true", "false")
        for shared in ("true", "false")
        for shape in ((2, 3), (1, 2, 2, 1, 3))
    ),
    *(
        (
            "Convolution",
            f"convolution_param {{ num_output: 4 group: 2 kernel_size: 2 pad: 1 {RANDOM} }}",
            [off_zero(*shape)],
            {},
        )
        for shape in SPATIAL
    ),
    *(
        (
            "Deconvolution",
            f"convolution_param {{ num_output: 4 group: 2 kernel_size: 3 stride: 2 pad: 1 {RANDOM} }}",
            [off_zero(*shape)],
            {},
        )
        for shape in SPATIAL
    ),
    *(
        (
            "Deconvolution",
            f"convolution_param {{ num_output: 2 {windows} {RANDOM} }}",
            [off_zero(2, 2, 3, 4)],
            {},
        )
        for windows in WINDOWS
    ),
    *(
        ("Interp", f"interp_param {{ {options} }}", [off_zero(2, 2, 4, 5)], {})
        for options in (
            "zoom_factor: 3",
            "shrink_factor: 2",
            "height: 7 width: 2 pad_beg: -1",
            "height: 1 width: 6",
        )
    ),
]


@pytest.mark.parametrize(("kind", "options", "bottoms", "more"), CASES)
def test_the_gradient_agrees_with_differences(
    check: Callable[..., None], kind: str, options: str, bottoms: list[Any], more: dict[str, Any]
) -> None:
    """Also in place, where the layer supports it."""
    in_place = more.get("in_place", LAYER_TYPES[kind].in_place and "tops" not in more)
    for together in {False, in_place}:
        check(f'type: "{kind}" {options}', *bottoms, **{**more, "in_place": together})
