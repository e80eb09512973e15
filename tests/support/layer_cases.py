"""A small example of every layer type, for tests that hold for all of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from netlib import gradcheck
from netlib.blob import Blob, Blobs
from netlib.layer import Layer
from tests.support.nets import inputs

RNG = np.random.default_rng(0)


def off_zero(*shape: int) -> np.ndarray:
    """Return random numbers away from 0."""
    return RNG.choice([-1.0, 1.0], shape) * RNG.uniform(0.2, 1, shape)


def different(*shape: int) -> np.ndarray:
    """Return numbers far apart from each other."""
    return RNG.permutation(int(np.prod(shape))).reshape(shape) / 7.0


# options, a function that makes the bottoms for N items, and ``tops``, their number, or ``wanted``,
# the bottoms with a gradient
Case = tuple[str, Callable[[int], list[Any]], dict[str, Any]]


def of(*shapes: tuple[int, ...]) -> Callable[[int], list[Any]]:
    """Return a function that makes bottoms of these shapes for N items."""
    return lambda N: [off_zero(N, *shape) for shape in shapes]


def labelled(N: int) -> list[Any]:
    """Return scores of three classes, and labels."""
    return [off_zero(N, 3), RNG.integers(0, 3, N)]


VECTORS = of((3,))


def case(options: str = "", bottoms: Callable[[int], list[Any]] = VECTORS, **more: Any) -> Case:
    return options, bottoms, more


CASES: dict[str, Case] = {
    "AbsVal": case(),
    "Accuracy": case(bottoms=labelled, wanted=[False, False]),
    "BN": case('bn_param { bn_mode: LEARN scale_filler { type: "gaussian" } }', of((3, 2, 4))),
    "BNLL": case(),
    "Bias": case(bottoms=of((2, 3))),
    "Clip": case("clip_param { min: -2 max: 0.1 }"),
    "Axpy": case(bottoms=of((2,), (2, 3, 2), (2, 3, 2))),
    "BatchNorm": case(bottoms=of((3, 2, 4))),
    "ArgMax": case("argmax_param { top_k: 2 }", lambda N: [different(N, 3)], wanted=[False]),
    "BatchReindex": case(
        bottoms=lambda N: [off_zero(3, 2), RNG.integers(0, 3, N)], wanted=[True, False]
    ),
    "Concat": case(bottoms=of((2,), (3,))),
    "ContrastiveLoss": case(
        "contrastive_loss_param { margin: 3 legacy_version: true }",
        lambda N: [off_zero(N, 3), off_zero(N, 3), RNG.integers(0, 2, N)],
        wanted=[True, True, False],
    ),
    "Convolution": case(
        'convolution_param { num_output: 2 kernel_size: 2 weight_filler { type: "gaussian" } }',
        of((2, 3, 4)),
    ),
    "ConvolutionDepthwise": case(
        'convolution_param { kernel_size: 2 pad: 1 weight_filler { type: "gaussian" } }',
        of((3, 3, 4)),
    ),
    "Crop": case("crop_param { offset: 1 }", of((2, 4, 5), (2, 2, 3))),
    "Deconvolution": case(
        'convolution_param { num_output: 2 kernel_size: 3 stride: 2 pad: 1 weight_filler { type: "gaussian" } }',
        of((2, 3, 2)),
    ),
    "DeepHandModel": case(bottoms=of((47,))),
    "DeepHandModelDofConstraintLoss": case(bottoms=lambda N: [3 * off_zero(N, 47)]),
    "DetectionOutput": case(
        "detection_output_param { num_classes: 3 code_type: CENTER_SIZE nms_param { top_k: 3 } keep_top_k: 4 }",
        lambda N: [
            off_zero(N, 5 * 4),
            off_zero(N, 5 * 3),
            np.tile([0.1, 0.2, 0.5, 0.9], (1, 2, 5)),
        ],
        wanted=[False, False, False],
    ),
    "DepthwiseConvolution": case(
        'convolution_param { num_output: 4 group: 2 kernel_size: 2 stride: 2 weight_filler { type: "gaussian" } }',
        of((2, 3, 4)),
    ),
    "Dropout": case(bottoms=of((5,))),
    "ELU": case("elu_param { alpha: 0.7 }"),
    "Eltwise": case("eltwise_param { operation: MAX }", of((3,), (3,))),
    "Embed": case(
        'embed_param { num_output: 2 input_dim: 3 weight_filler { type: "gaussian" } }',
        lambda N: [RNG.integers(0, 3, N)],
        wanted=[False],
    ),
    "EuclideanLoss": case(bottoms=of((3,), (3,))),
    "Exp": case("exp_param { base: 2 scale: 3 shift: 1 }"),
    "Filter": case(bottoms=lambda N: [off_zero(N, 3), np.arange(N) % 2 == 0], wanted=[True, False]),
    "Flatten": case(bottoms=of((2, 3))),
    "HandAugment": case(
        "hand_augment_param { rotation: 20 scale: 0.1 shift: 1 depth: 0.1 }",
        of((1, 6, 6), (6,)),
        tops=2,
        wanted=[False, False],
    ),
    "HandModel": case(bottoms=of((47,))),
    "HingeLoss": case("hinge_loss_param { norm: L2 }", labelled, wanted=[True, False]),
    "InfogainLoss": case(
        bottoms=lambda N: [off_zero(N, 3), RNG.integers(0, 3, N), off_zero(3, 3)],
        wanted=[True, False, False],
    ),
    "Im2col": case("convolution_param { kernel_size: 2 pad: 1 }", of((2, 3, 2))),
    "InnerProduct": case(
        'inner_product_param { num_output: 2 weight_filler { type: "gaussian" } }', of((2, 3))
    ),
    "Interp": case("interp_param { zoom_factor: 2 shrink_factor: 3 pad_beg: -1 }", of((2, 6, 5))),
    "Log": case("log_param { base: 2 scale: 3 shift: 4 }"),
    "MultinomialLogisticLoss": case(
        bottoms=lambda N: [abs(off_zero(N, 3)), RNG.integers(0, 3, N)], wanted=[True, False]
    ),
    "PReLU": case(bottoms=of((2, 3))),
    "LRN": case(bottoms=of((7, 2, 3))),
    "LSTM": case(
        'recurrent_param { num_output: 3 weight_filler { type: "gaussian" } }',
        lambda N: [off_zero(4, N, 2), RNG.integers(0, 2, (4, N))],
        wanted=[True, False],
    ),
    "LSTMUnit": case(
        bottoms=lambda N: [off_zero(1, N, 3), off_zero(1, N, 12), RNG.integers(0, 2, (1, N))],
        tops=2,
        wanted=[True, True, False],
    ),
    "MVN": case(bottoms=of((2, 3, 4))),
    "Normalize": case(
        'norm_param { across_spatial: false channel_shared: false scale_filler { type: "uniform" min: 1 max: 3 } }',
        of((3, 2, 4)),
    ),
    "Permute": case("permute_param { order: 0 order: 2 order: 3 }", of((2, 3, 4))),
    "PhysLimit": case(bottoms=lambda N: [3 * off_zero(N, 47)]),
    "Pooling": case(
        "pooling_param { kernel_size: 2 stride: 2 }", lambda N: [different(N, 2, 5, 3)]
    ),
    "Power": case("power_param { power: 2 shift: 3 }"),
    "PriorBox": case(
        "prior_box_param { min_size: 3 max_size: 5 aspect_ratio: 2 }", of((2, 2, 3), (1, 9, 12))
    ),
    "RNN": case(
        'recurrent_param { num_output: 3 weight_filler { type: "gaussian" } }',
        lambda N: [off_zero(4, N, 2), RNG.integers(0, 2, (4, N)), off_zero(N, 2)],
        wanted=[True, False, True],
    ),
    "PSROIPooling": case(
        "psroi_pooling_param { spatial_scale: 0.5 output_dim: 2 group_size: 2 }",
        lambda N: [
            different(N, 8, 4, 5),
            np.array([[0, 0, 1, 9, 8], [N - 1, 3, 4, 20, 4.4], [0, 90, 0, 99, 9]]),
        ],
        wanted=[True, False],
    ),
    "ROIPooling": case(
        "roi_pooling_param { pooled_h: 2 pooled_w: 3 spatial_scale: 0.5 }",
        lambda N: [
            different(N, 2, 5, 6),
            np.array([[0, 0, 1, 9, 8], [N - 1, 3, 4, 20, 4.5], [0, 90, 0, 99, 9]]),
        ],
        wanted=[True, False],
    ),
    "ReLU": case(),
    "ReLU6": case("relu6_param { negative_slope: 0.2 }", lambda N: [off_zero(N, 3) * 10]),
    "Reduction": case("reduction_param { operation: SUMSQ axis: 1 coeff: 2 }", of((2, 3))),
    "Reshape": case("reshape_param { shape { dim: 0 dim: -1 } }", of((2, 3))),
    "SPP": case("spp_param { pyramid_height: 2 }", lambda N: [different(N, 2, 5, 4)]),
    "Scale": case("scale_param { bias_term: true }", of((2, 3))),
    "ShuffleChannel": case("shuffle_channel_param { group: 2 }", of((6, 2, 3))),
    "Sigmoid": case(),
    "SigmoidCrossEntropyLoss": case(
        bottoms=lambda N: [off_zero(N, 3), abs(off_zero(N, 3))], wanted=[True, False]
    ),
    "Silence": case(tops=0),
    "Slice": case(bottoms=of((4,)), tops=2),
    "SmoothL1Loss": case("smooth_l1_loss_param { sigma: 1.3 }", of((3,), (3,))),
    "Softmax": case(),
    "SoftmaxWithLoss": case(bottoms=labelled, wanted=[True, False]),
    "Split": case(tops=2),
    "Swish": case("swish_param { beta: 1.7 }"),
    "TanH": case(),
    "Threshold": case(wanted=[False]),
    "Tile": case("tile_param { tiles: 3 }", of((2, 2))),
    "Upsample": case(
        "upsample_param { pad_out_h: true }",
        lambda N: [
            off_zero(N, 2, 2, 3),
            np.stack([RNG.permutation(18)[:6].reshape(2, 3) for _ in range(2 * N)]).reshape(
                N, 2, 2, 3
            ),
        ],
        wanted=[True, False],
    ),
}
# Types without bottoms, or with a file that is written once, are covered by their own tests.
SOURCES = {
    "Data",
    "DummyData",
    "HDF5Data",
    "HDF5Output",
    "ImageData",
    "Input",
    "MemoryData",
    "Parameter",
}


def made(name: str, N: int = 2) -> tuple[Layer, list[np.ndarray]]:
    """Return a layer of this type, and bottoms for N items."""
    options, bottoms, more = CASES[name]
    arrays = bottoms(N)
    return gradcheck.make_layer(f'type: "{name}" {options}', arrays, more.get("tops", 1)), arrays


def net_text(name: str, arrays: list[Any]) -> str:
    """Return a net with inputs x0, x1 ... of these arrays, and the layer, with tops y0, y1 ..."""
    options, _, more = CASES[name]
    shapes = {f"x{i}": np.shape(array) for i, array in enumerate(arrays)}
    bottoms = "".join(f'bottom: "{blob}" ' for blob in shapes)
    tops = "".join(f'top: "y{i}" ' for i in range(more.get("tops", 1)))
    return f'{inputs(**shapes)} layer {{ name: "it" type: "{name}" {bottoms} {tops} {options} }}'


def forward(layer: Layer, arrays: list[np.ndarray], tops: int, in_place: bool) -> list[np.ndarray]:
    """Run the layer forward and return the tops: new blobs, or the bottoms."""
    bottom = Blobs([Blob(np.shape(x), np.float64) for x in arrays])
    for blob, x in zip(bottom, arrays):
        blob.data[...] = x
    top = Blobs(bottom[:tops]) if in_place else Blobs([Blob((), np.float64) for _ in range(tops)])
    start = layer.state()
    layer.reshape(bottom, top)
    layer.forward(bottom, top)
    layer.restore(start)
    return [blob.data for blob in top]
