"""export/onnx/common.py: each layer type on its own, and Silence in a net."""

from __future__ import annotations

import numpy as np
import pytest

from export.onnx.net import load, onnx_image
from tests.support.onnx_nets import IMAGE, Cases, check, examples, run_onnx, types_of

CASES: Cases = {
    "ArgMax": [
        (IMAGE, "", 1),
        (IMAGE, "argmax_param { top_k: 5 out_max_val: true }", 1),
        (IMAGE, "argmax_param { axis: -2 top_k: 2 }", 1),
        (IMAGE, "argmax_param { axis: 1 top_k: 2 out_max_val: true }", 1),
    ],
    "Axpy": [([(1, 3), *IMAGE, *IMAGE], "", 1), ([(1, 3, 1, 1), *IMAGE, *IMAGE], "", 1)],
    "BatchReindex": [([*IMAGE, (1,)], "", 1)],
    "Concat": [([*IMAGE, (1, 2, 7, 6)], "", 1), ([*IMAGE, *IMAGE], "concat_param { axis: 0 }", 1)],
    "Dropout": [(IMAGE, "", 1), (IMAGE, "dropout_param { dropout_ratio: 0.3 scale_train: false }", 1)],
    "Eltwise": [
        ([*IMAGE] * 3, "", 1),
        ([*IMAGE] * 2, "eltwise_param { coeff: 1 coeff: -0.5 }", 1),
        ([*IMAGE] * 3, "eltwise_param { operation: PROD }", 1),
        ([*IMAGE] * 3, "eltwise_param { operation: MAX }", 1),
    ],
    "Embed": [
        ([(1, 4)], "embed_param { num_output: 3 input_dim: 5 }", 1),
        ([(1,)], "embed_param { num_output: 3 input_dim: 5 bias_term: false }", 1),
    ],
    "Flatten": [(IMAGE, "", 1), (IMAGE, "flatten_param { axis: 2 }", 1), (IMAGE, "flatten_param { axis: 0 }", 1)],
    "InnerProduct": [
        (IMAGE, "inner_product_param { num_output: 4 }", 1),
        ([(1, 5)], "inner_product_param { num_output: 4 bias_term: false transpose: true }", 1),
        (IMAGE, "inner_product_param { num_output: 4 axis: -2 }", 1),
    ],
    "Parameter": [(IMAGE, "parameter_param { shape { dim: 2 dim: 3 } }", 1)],
    "Permute": [
        (IMAGE, "permute_param { order: 0 order: 2 order: 3 order: 1 }", 1),
        (IMAGE, "permute_param { order: 3 }", 1),
    ],
    "Reduction": [
        (IMAGE, f"reduction_param {{ operation: {operation} axis: {axis} coeff: 0.5 }}", 1)
        for operation in ("SUM", "ASUM", "SUMSQ", "MEAN") for axis in (0, 1, -1)
    ],
    "Reshape": [
        (IMAGE, "reshape_param { shape { dim: 0 dim: -1 dim: 2 } }", 1),
        (IMAGE, "reshape_param { shape { dim: -1 dim: 6 } }", 1),
        (IMAGE, "reshape_param { axis: 2 shape { dim: 6 dim: 7 } }", 1),
    ],
    "ShuffleChannel": [
        ([(1, 6, 2, 3)], "shuffle_channel_param { group: 3 }", 1),
        ([(1, 6)], "shuffle_channel_param { group: 2 }", 1),
        (IMAGE, "", 1),
    ],
    "Slice": [
        ([(1, 6, 2, 2)], "", 3),
        ([(1, 6, 5)], "slice_param { axis: -1 slice_point: 1 slice_point: 3 }", 3),
        (IMAGE, "", 1),
    ],
    "Softmax": [(IMAGE, "", 1), (IMAGE, "softmax_param { axis: -1 }", 1)],
    "Split": [(IMAGE, "", 2)],
    "Tile": [(IMAGE, "tile_param { tiles: 3 }", 1), (IMAGE, "tile_param { axis: -1 tiles: 2 }", 1)],
}


@pytest.mark.parametrize(("name", "shapes", "options", "tops"), examples(CASES))
def test_layer(name, shapes, options, tops, files):
    """The exported layer computes the same as netlib."""
    check(files, name, shapes, options, tops)


def test_every_type_has_an_example():
    """Every layer type of layers/common has an example."""
    assert set(CASES) | {"Silence"} == types_of("common")


def test_equal_maxima(files):
    """Of equal maxima, ArgMax takes the last and the mask of MAX the first."""
    net = load(*files(
        'layer { name: "a" type: "ArgMax" bottom: "x0" top: "a" argmax_param { top_k: 3 } }'
        'layer { name: "p" type: "Pooling" bottom: "x0" top: "y" top: "mask" pooling_param { kernel_size: 2 } }',
        (1, 2, 3, 2),
    ))
    x = np.zeros((2, 2, 3, 2), np.float32)
    x[:, 1, 1] = 1
    found = run_onnx(onnx_image(net), x0=x)
    assert found["a"].tolist() == [[[[9], [8], [11]]]] * 2
    assert found["mask"].tolist() == [[[[0], [2]], [[2], [2]]]] * 2
    assert {name: y.tolist() for name, y in net.forward(x0=x).items()} == {n: y.tolist() for n, y in found.items()}


def test_silence_and_splits_are_no_operators(files, onnx):
    """Silence and Split add no operators, and a blob with two consumers is not copied."""
    net = load(*files(
        'layer { name: "a" type: "TanH" bottom: "x0" top: "a" } layer { name: "b" type: "AbsVal" bottom: "a" top: "b" }'
        'layer { name: "c" type: "BNLL" bottom: "a" top: "c" } layer { name: "s" type: "Silence" bottom: "c" }',
        (1, 4),
    ))
    graph = onnx.load_from_string(onnx_image(net)).graph
    assert [(node.op_type, *node.input) for node in graph.node] == [
        ("Tanh", "x0"), ("Abs", "a"), ("Softplus", "a"),
    ]
    assert [output.name for output in graph.output] == ["b"]
