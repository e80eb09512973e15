"""Every layer type that has a form in ONNX, on its own: the exported layer computes the
same as netlib.
"""

import re

import pytest

from export.onnx.net import LAYERS
from netlib.files.paths import ROOT
from netlib.proto.options import layer_types
from tests.support.onnx_nets import IMAGE, Cases, check, examples

GROUP = "num_output: 4 group: 2"
CASES: Cases = {
    "AbsVal": [(IMAGE, "", 1)],
    "BNLL": [(IMAGE, "", 1)],
    "Bias": [
        (IMAGE, "", 1),
        (IMAGE, "bias_param { axis: 2 num_axes: -1 }", 1),
        ([*IMAGE, (1, 3)], "bias_param { axis: 0 }", 1),
    ],
    "Clip": [
        (IMAGE, "clip_param { min: -0.5 max: 0.25 }", 1),
        (IMAGE, "clip_param { min: 0.25 max: -0.5 }", 1),
    ],
    "ELU": [(IMAGE, "elu_param { alpha: 0.7 }", 1)],
    "Exp": [(IMAGE, "", 1), (IMAGE, "exp_param { base: 2 scale: 3 shift: 1 }", 1)],
    "Log": [(IMAGE, "log_param { base: 2 scale: 3 shift: 4 }", 1), (IMAGE, "", 1)],
    "PReLU": [
        (IMAGE, "", 1),
        ([(1, 5)], "", 1),
        (IMAGE, "prelu_param { channel_shared: true }", 1),
    ],
    "Power": [
        (IMAGE, "", 1),
        (IMAGE, "power_param { scale: 2 shift: -1 }", 1),
        (IMAGE, "power_param { power: 3 shift: 1 }", 1),
        (IMAGE, "power_param { power: 0.5 scale: 0.5 shift: 2 }", 1),
    ],
    "ReLU": [(IMAGE, "", 1), (IMAGE, "relu_param { negative_slope: 0.1 }", 1)],
    "ReLU6": [
        (IMAGE, "", 1),
        (IMAGE, "relu6_param { negative_slope: 0.1 }", 1),
        ([(4, 300)], "", 1),
    ],
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
    "ArgMax": [
        (IMAGE, "", 1),
        (IMAGE, "argmax_param { top_k: 5 out_max_val: true }", 1),
        (IMAGE, "argmax_param { axis: -2 top_k: 2 }", 1),
        (IMAGE, "argmax_param { axis: 1 top_k: 2 out_max_val: true }", 1),
    ],
    "Axpy": [([(1, 3), *IMAGE, *IMAGE], "", 1), ([(1, 3, 1, 1), *IMAGE, *IMAGE], "", 1)],
    "BatchReindex": [([*IMAGE, (1,)], "", 1)],
    "Concat": [([*IMAGE, (1, 2, 7, 6)], "", 1), ([*IMAGE, *IMAGE], "concat_param { axis: 0 }", 1)],
    "Dropout": [
        (IMAGE, "", 1),
        (IMAGE, "dropout_param { dropout_ratio: 0.3 scale_train: false }", 1),
    ],
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
    "Flatten": [
        (IMAGE, "", 1),
        (IMAGE, "flatten_param { axis: 2 }", 1),
        (IMAGE, "flatten_param { axis: 0 }", 1),
    ],
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
        for operation in ("SUM", "ASUM", "SUMSQ", "MEAN")
        for axis in (0, 1, -1)
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
    "Convolution": [
        (IMAGE, "convolution_param { num_output: 4 kernel_size: 3 }", 1),
        (
            IMAGE,
            "convolution_param { num_output: 4 kernel_size: 3 bias_term: false stride: 2 pad: 1 dilation: 2 }",
            1,
        ),
        (
            IMAGE,
            "convolution_param { num_output: 4 kernel_h: 2 kernel_w: 3 stride_h: 2 stride_w: 1 pad_h: 0 pad_w: 2 }",
            1,
        ),
        ([(1, 6, 5, 5)], f"convolution_param {{ {GROUP} kernel_size: 3 }}", 1),
        ([*IMAGE, (1, 3, 4, 4)], "convolution_param { num_output: 2 kernel_size: 3 }", 2),
        ([(1, 2, 3, 5, 4)], "convolution_param { num_output: 2 kernel_size: 2 axis: 2 }", 1),
        ([(1, 3, 9)], "convolution_param { num_output: 2 kernel_size: 4 stride: 2 }", 1),
        ([(1, 2, 4, 5, 6)], "convolution_param { num_output: 3 kernel_size: [2, 3, 4] pad: 1 }", 1),
        ([(1, 3)], "convolution_param { num_output: 2 }", 1),
    ],
    "ConvolutionDepthwise": [(IMAGE, "convolution_param { kernel_size: 3 stride: 2 pad: 1 }", 1)],
    "Crop": [
        ([*IMAGE, (1, 3, 4, 5)], "crop_param { offset: 2 offset: 1 }", 1),
        ([*IMAGE, (1, 2, 7, 5)], "crop_param { axis: 1 offset: 1 offset: 0 offset: 1 }", 1),
        ([*IMAGE, (1, 8, 7, 6)], "", 1),
    ],
    "Deconvolution": [
        (
            IMAGE,
            "convolution_param { num_output: 4 kernel_size: 3 stride: 2 pad: 1 dilation: 2 }",
            1,
        ),
        (
            [(1, 6, 5, 4)],
            f"convolution_param {{ {GROUP} kernel_h: 3 kernel_w: 2 stride: 2 bias_term: false }}",
            1,
        ),
        ([(1, 3, 5)], "convolution_param { num_output: 2 kernel_size: 4 stride: 3 }", 1),
    ],
    "DepthwiseConvolution": [
        (IMAGE, "convolution_param { num_output: 6 group: 3 kernel_size: 3 bias_term: false }", 1)
    ],
    "Interp": [
        *(
            (IMAGE, f"interp_param {{ {options} }}", 1)
            for options in (
                "zoom_factor: 3",
                "shrink_factor: 2",
                "height: 9 width: 2",
                "height: 1 width: 6",
                "zoom_factor: 2 pad_beg: -1 pad_end: -2",
                "zoom_factor: 1 pad_end: -2",
                "zoom_factor: 1",
            )
        ),
        ([*IMAGE, (1, 2, 4, 9)], "", 1),
        ([(1, 2, 1, 3)], "interp_param { height: 5 width: 7 }", 1),
    ],
    "Pooling": [
        *(
            (IMAGE, f"pooling_param {{ pool: {pool} {options} }}", 1)
            for pool in ("MAX", "AVE")
            for options in (
                "kernel_size: 2 stride: 2",  # the window extends beyond the lower edge
                "kernel_size: 3 stride: 2 pad: 1",
                "kernel_size: 2 stride: 2 pad: 1",  # a last window would start beyond the edge
                "kernel_size: 4 stride: 3 pad: 2",
                "kernel_h: 3 kernel_w: 2 stride_h: 1 stride_w: 3 pad_h: 2 pad_w: 0",
                "kernel_size: 3 stride: 2 pad: 1 round_mode: FLOOR",
                "kernel_size: 2 stride: 2 ceil_mode: false",
                "kernel_size: 1 stride: 4",  # windows without a value: -FLT_MAX and NaN
                "global_pooling: true",
            )
        ),
        (IMAGE, "pooling_param { kernel_size: 3 stride: 2 pad: 1 }", 2),
        (IMAGE, "pooling_param { global_pooling: true }", 2),
        (IMAGE, "pooling_param { kernel_size: 1 stride: 4 }", 2),
        # a single window, beyond the image
        (IMAGE, "pooling_param { pool: AVE kernel_size: 9 stride: 4 }", 1),
    ],
    "SPP": [
        (IMAGE, "spp_param { pyramid_height: 2 }", 1),
        (IMAGE, "spp_param { pyramid_height: 3 pool: AVE }", 1),
        (IMAGE, "spp_param { pyramid_height: 1 }", 1),
    ],
    "Upsample": [
        (IMAGE, "upsample_param { scale: 3 }", 1),
        (IMAGE, "", 1),
        ([(1, 2, 3)], "upsample_param { scale: 2 }", 1),
    ],
    "PriorBox": [
        (
            [(1, 2, 2, 3), *IMAGE],
            "prior_box_param { min_size: 2 max_size: 4 aspect_ratio: 3 clip: true }",
            1,
        ),
        (
            [(1, 2, 2, 3), (1, 5)],
            "prior_box_param { min_size: 2 img_size: 9 step_h: 2 step_w: 4 variance: 0.3 }",
            1,
        ),
    ],
    "DeepHandModel": [([(1, 47)], "", 1)],
    "HandModel": [
        ([(1, 47)], "", 1),
        ([(1, 47, 1, 1)], "", 1),
        ([(1, 47), (1, 1)], "", 1),  # a factor
        ([(1, 47), (1, 31, 1)], "", 1),  # bone lengths
    ],
}
ELSEWHERE = {"DetectionOutput", "Input", "Silence"}  # in nets of several layers


@pytest.mark.parametrize(("name", "shapes", "options", "tops"), examples(CASES))
def test_layer(name, shapes, options, tops, files):
    check(files, name, shapes, options, tops)


def test_every_type_has_an_example():
    assert set(CASES) | ELSEWHERE == set(LAYERS)


WITHOUT_FORM = {"Filter", "Im2col", "LSTM", "LSTMUnit", "PSROIPooling", "RNN", "ROIPooling"}


def test_every_layer_type_has_a_form_or_is_refused():
    """Every layer type has an ONNX form, or is one of those known to have none."""
    random_or_from_outside = {
        "DummyData",
        "HDF5Data",
        "HandAugment",
        "Data",
        "ImageData",
        "MemoryData",
        "HDF5Output",
    }
    of_training = {"Accuracy", "PhysLimit"}
    refused = {name for name in layer_types() if name not in LAYERS and not name.endswith("Loss")}
    assert refused <= random_or_from_outside | of_training | WITHOUT_FORM


def test_the_document_names_every_layer_type():
    """docs/onnx.md names every layer type with an ONNX form, and those without that a
    reader may look for.
    """
    text = (ROOT / "docs" / "onnx.md").read_text(encoding="utf-8")
    for name in {*LAYERS, *WITHOUT_FORM}:
        assert re.search(rf"\b{name}\b", text), name
