"""export/onnx/vision.py: each layer type on its own."""

from __future__ import annotations

import pytest

from export.onnx.check import differences
from export.onnx.net import load, onnx_image
from tests.support.onnx_nets import IMAGE, Cases, check, examples, types_of

GROUP = "num_output: 4 group: 2"
CASES: Cases = {
    "Convolution": [
        (IMAGE, "convolution_param { num_output: 4 kernel_size: 3 }", 1),
        (IMAGE, "convolution_param { num_output: 4 kernel_size: 3 bias_term: false stride: 2 pad: 1 dilation: 2 }", 1),
        (IMAGE, "convolution_param { num_output: 4 kernel_h: 2 kernel_w: 3 stride_h: 2 stride_w: 1 pad_h: 0 pad_w: 2 }",
         1),
        ([(1, 6, 5, 5)], f"convolution_param {{ {GROUP} kernel_size: 3 }}", 1),
        ([*IMAGE, (1, 3, 4, 4)], "convolution_param { num_output: 2 kernel_size: 3 }", 2),
        ([(1, 2, 3, 5, 4)], "convolution_param { num_output: 2 kernel_size: 2 axis: 2 }", 1),
        ([(1, 3, 9)], "convolution_param { num_output: 2 kernel_size: 4 stride: 2 }", 1),
        ([(1, 2, 4, 5, 6)], "convolution_param { num_output: 3 kernel_size: [2, 3, 4] pad: 1 }", 1),
        ([(1, 3)], "convolution_param { num_output: 2 }", 1),
    ],
    "ConvolutionDepthwise": [
        (IMAGE, "convolution_param { kernel_size: 3 stride: 2 pad: 1 }", 1),
    ],
    "Crop": [
        ([*IMAGE, (1, 3, 4, 5)], "crop_param { offset: 2 offset: 1 }", 1),
        ([*IMAGE, (1, 2, 7, 5)], "crop_param { axis: 1 offset: 1 offset: 0 offset: 1 }", 1),
        ([*IMAGE, (1, 8, 7, 6)], "", 1),
    ],
    "Deconvolution": [
        (IMAGE, "convolution_param { num_output: 4 kernel_size: 3 stride: 2 pad: 1 dilation: 2 }", 1),
        ([(1, 6, 5, 4)], f"convolution_param {{ {GROUP} kernel_h: 3 kernel_w: 2 stride: 2 bias_term: false }}", 1),
        ([(1, 3, 5)], "convolution_param { num_output: 2 kernel_size: 4 stride: 3 }", 1),
    ],
    "DepthwiseConvolution": [
        (IMAGE, "convolution_param { num_output: 6 group: 3 kernel_size: 3 bias_term: false }", 1),
    ],
    "Interp": [
        *((IMAGE, f"interp_param {{ {options} }}", 1) for options in (
            "zoom_factor: 3", "shrink_factor: 2", "height: 9 width: 2", "height: 1 width: 6",
            "zoom_factor: 2 pad_beg: -1 pad_end: -2", "zoom_factor: 1 pad_end: -2", "zoom_factor: 1",
        )),
        ([*IMAGE, (1, 2, 4, 9)], "", 1),
        ([(1, 2, 1, 3)], "interp_param { height: 5 width: 7 }", 1),
    ],
    "Pooling": [
        *((IMAGE, f"pooling_param {{ pool: {pool} {options} }}", 1) for pool in ("MAX", "AVE") for options in (
            "kernel_size: 2 stride: 2",  # the window extends beyond the lower edge
            "kernel_size: 3 stride: 2 pad: 1",
            "kernel_size: 2 stride: 2 pad: 1",  # a last window would start beyond the edge
            "kernel_size: 4 stride: 3 pad: 2",
            "kernel_h: 3 kernel_w: 2 stride_h: 1 stride_w: 3 pad_h: 2 pad_w: 0",
            "kernel_size: 3 stride: 2 pad: 1 round_mode: FLOOR",
            "kernel_size: 2 stride: 2 ceil_mode: false",
            "kernel_size: 1 stride: 4",  # windows without a value: -FLT_MAX and NaN
            "global_pooling: true",
        )),
        (IMAGE, "pooling_param { kernel_size: 3 stride: 2 pad: 1 }", 2),
        (IMAGE, "pooling_param { global_pooling: true }", 2),
        (IMAGE, "pooling_param { kernel_size: 1 stride: 4 }", 2),
        (IMAGE, "pooling_param { pool: AVE kernel_size: 9 stride: 4 }", 1),  # a single window, beyond the image
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
}


@pytest.mark.parametrize(("name", "shapes", "options", "tops"), examples(CASES))
def test_layer(name, shapes, options, tops, files):
    """The exported layer computes the same as netlib."""
    check(files, name, shapes, options, tops)


@pytest.mark.parametrize("kernel", ["kernel_size: 2 stride: 2", "kernel_size: 3 stride: 2"])
def test_upsampling_with_a_mask(kernel, files):
    """An Upsample with the mask of a Pooling computes the same, also where windows overlap."""
    options = "upsample_param { upsample_h: 7 upsample_w: 6 }"
    net = load(
        *files(
            f'layer {{ name: "p" type: "Pooling" bottom: "x0" top: "p" top: "mask" pooling_param {{ {kernel} }} }}'
            f'layer {{ name: "u" type: "Upsample" bottom: "p" bottom: "mask" top: "y" {options} }}',
            *IMAGE,
        )
    )
    found, _ = differences(onnx_image(net), net, (1, 3))
    assert set(found) == {"y"}
    assert found["y"].found <= 1e-5


def test_every_type_has_an_example():
    """Every layer type of layers/vision has an example."""
    assert set(CASES) == types_of("vision")
