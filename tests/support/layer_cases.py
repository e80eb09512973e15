"""A small example of every layer type, for tests that hold for all of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from netlib import gradcheck
from netlib.blob import Blob, Blobs
from netlib.layer import Layer

RNG = np.random.default_rng(0)


def off_zero(*shape: int) -> np.ndarray:
    """Return random numbers away from 0."""
    return RNG.choice([-1.0, 1.0], shape) * RNG.uniform(0.2, 1, shape)


def different(*shape: int) -> np.ndarray:
    """Return numbers far apart from each other."""
    return RNG.permutation(int(np.prod(shape))).reshape(shape) / 7.0


# type -> options, functions that make the bottoms for N items, number of tops; ``wanted``: bottoms
# with a gradient
CASES: dict[str, tuple[str, Any, dict[str, Any]]] = {
    "AbsVal": ("", lambda N: [off_zero(N, 3)], {}),
    "Accuracy": ("", lambda N: [off_zero(N, 3), RNG.integers(0, 3, N)], {"wanted": [False, False]}),
    "BN": (
        'bn_param { bn_mode: LEARN scale_filler { type: "gaussian" } }',
        lambda N: [off_zero(N, 3, 2, 4)],
        {},
    ),
    "BNLL": ("", lambda N: [off_zero(N, 3)], {}),
    "Bias": ("", lambda N: [off_zero(N, 2, 3)], {}),
    "Clip": ("clip_param { min: -2 max: 0.1 }", lambda N: [off_zero(N, 3)], {}),
    "Axpy": ("", lambda N: [off_zero(N, 2), off_zero(N, 2, 3, 2), off_zero(N, 2, 3, 2)], {}),
    "BatchNorm": ("", lambda N: [off_zero(N, 3, 2, 4)], {}),
    "ArgMax": ("argmax_param { top_k: 2 }", lambda N: [different(N, 3)], {"wanted": [False]}),
    "BatchReindex": (
        "",
        lambda N: [off_zero(3, 2), RNG.integers(0, 3, N)],
        {"wanted": [True, False]},
    ),
    "Concat": ("", lambda N: [off_zero(N, 2), off_zero(N, 3)], {}),
    "ContrastiveLoss": (
        "contrastive_loss_param { margin: 3 legacy_version: true }",
        lambda N: [off_zero(N, 3), off_zero(N, 3), RNG.integers(0, 2, N)],
        {"wanted": [True, True, False]},
    ),
    "Convolution": (
        'convolution_param { num_output: 2 kernel_size: 2 weight_filler { type: "gaussian" } }',
        lambda N: [off_zero(N, 2, 3, 4)],
        {},
    ),
    "ConvolutionDepthwise": (
        'convolution_param { kernel_size: 2 pad: 1 weight_filler { type: "gaussian" } }',
        lambda N: [off_zero(N, 3, 3, 4)],
        {},
    ),
    "Crop": (
        "crop_param { offset: 1 }",
        lambda N: [off_zero(N, 2, 4, 5), off_zero(N, 2, 2, 3)],
        {},
    ),
    "Deconvolution": (
        'convolution_param { num_output: 2 kernel_size: 3 stride: 2 pad: 1 weight_filler { type: "gaussian" } }',
        lambda N: [off_zero(N, 2, 3, 2)],
        {},
    ),
    "DeepHandModel": ("", lambda N: [off_zero(N, 47)], {}),
    "DeepHandModelDofConstraintLoss": ("", lambda N: [3 * off_zero(N, 47)], {}),
    "DetectionOutput": (
        "detection_output_param { num_classes: 3 code_type: CENTER_SIZE nms_param { top_k: 3 } keep_top_k: 4 }",
        lambda N: [
            off_zero(N, 5 * 4),
            off_zero(N, 5 * 3),
            np.tile([0.1, 0.2, 0.5, 0.9], (1, 2, 5)),
        ],
        {"wanted": [False, False, False]},
    ),
    "DepthwiseConvolution": (
        'convolution_param { num_output: 4 group: 2 kernel_size: 2 stride: 2 weight_filler { type: "gaussian" } }',
        lambda N: [off_zero(N, 2, 3, 4)],
        {},
    ),
    "Dropout": ("", lambda N: [off_zero(N, 5)], {}),
    "ELU": ("elu_param { alpha: 0.7 }", lambda N: [off_zero(N, 3)], {}),
    "Eltwise": ("eltwise_param { operation: MAX }", lambda N: [off_zero(N, 3), off_zero(N, 3)], {}),
    "Embed": (
        'embed_param { num_output: 2 input_dim: 3 weight_filler { type: "gaussian" } }',
        lambda N: [RNG.integers(0, 3, N)],
        {"wanted": [False]},
    ),
    "EuclideanLoss": ("", lambda N: [off_zero(N, 3), off_zero(N, 3)], {}),
    "Exp": ("exp_param { base: 2 scale: 3 shift: 1 }", lambda N: [off_zero(N, 3)], {}),
    "Filter": ("", lambda N: [off_zero(N, 3), np.arange(N) % 2 == 0], {"wanted": [True, False]}),
    "Flatten": ("", lambda N: [off_zero(N, 2, 3)], {}),
    "HandAugment": (
        "hand_augment_param { rotation: 20 scale: 0.1 shift: 1 depth: 0.1 }",
        lambda N: [off_zero(N, 1, 6, 6), off_zero(N, 6)],
        {"tops": 2, "wanted": [False, False]},
    ),
    "HandModel": ("", lambda N: [off_zero(N, 47)], {}),
    "HingeLoss": (
        "hinge_loss_param { norm: L2 }",
        lambda N: [off_zero(N, 3), RNG.integers(0, 3, N)],
        {"wanted": [True, False]},
    ),
    "InfogainLoss": (
        "",
        lambda N: [off_zero(N, 3), RNG.integers(0, 3, N), off_zero(3, 3)],
        {"wanted": [True, False, False]},
    ),
    "Im2col": ("convolution_param { kernel_size: 2 pad: 1 }", lambda N: [off_zero(N, 2, 3, 2)], {}),
    "InnerProduct": (
        'inner_product_param { num_output: 2 weight_filler { type: "gaussian" } }',
        lambda N: [off_zero(N, 2, 3)],
        {},
    ),
    "Interp": (
        "interp_param { zoom_factor: 2 shrink_factor: 3 pad_beg: -1 }",
        lambda N: [off_zero(N, 2, 6, 5)],
        {},
    ),
    "Log": ("log_param { base: 2 scale: 3 shift: 4 }", lambda N: [off_zero(N, 3)], {}),
    "MultinomialLogisticLoss": (
        "",
        lambda N: [abs(off_zero(N, 3)), RNG.integers(0, 3, N)],
        {"wanted": [True, False]},
    ),
    "PReLU": ("", lambda N: [off_zero(N, 2, 3)], {}),
    "LRN": ("", lambda N: [off_zero(N, 7, 2, 3)], {}),
    "LSTM": (
        'recurrent_param { num_output: 3 weight_filler { type: "gaussian" } }',
        lambda N: [off_zero(4, N, 2), RNG.integers(0, 2, (4, N))],
        {"wanted": [True, False]},
    ),
    "LSTMUnit": (
        "",
        lambda N: [off_zero(1, N, 3), off_zero(1, N, 12), RNG.integers(0, 2, (1, N))],
        {"tops": 2, "wanted": [True, True, False]},
    ),
    "MVN": ("", lambda N: [off_zero(N, 2, 3, 4)], {}),
    "Normalize": (
        'norm_param { across_spatial: false channel_shared: false scale_filler { type: "uniform" min: 1 max: 3 } }',
        lambda N: [off_zero(N, 3, 2, 4)],
        {},
    ),
    "Permute": (
        "permute_param { order: 0 order: 2 order: 3 }",
        lambda N: [off_zero(N, 2, 3, 4)],
        {},
    ),
    "PhysLimit": ("", lambda N: [3 * off_zero(N, 47)], {}),
    "Pooling": (
        "pooling_param { kernel_size: 2 stride: 2 }",
        lambda N: [different(N, 2, 5, 3)],
        {},
    ),
    "Power": ("power_param { power: 2 shift: 3 }", lambda N: [off_zero(N, 3)], {}),
    "PriorBox": (
        "prior_box_param { min_size: 3 max_size: 5 aspect_ratio: 2 }",
        lambda N: [off_zero(N, 2, 2, 3), off_zero(N, 1, 9, 12)],
        {},
    ),
    "RNN": (
        'recurrent_param { num_output: 3 weight_filler { type: "gaussian" } }',
        lambda N: [off_zero(4, N, 2), RNG.integers(0, 2, (4, N)), off_zero(N, 2)],
        {"wanted": [True, False, True]},
    ),
    "PSROIPooling": (
        "psroi_pooling_param { spatial_scale: 0.5 output_dim: 2 group_size: 2 }",
        lambda N: [
            different(N, 8, 4, 5),
            np.array([[0, 0, 1, 9, 8], [N - 1, 3, 4, 20, 4.4], [0, 90, 0, 99, 9]]),
        ],
        {"wanted": [True, False]},
    ),
    "ROIPooling": (
        "roi_pooling_param { pooled_h: 2 pooled_w: 3 spatial_scale: 0.5 }",
        lambda N: [
            different(N, 2, 5, 6),
            np.array([[0, 0, 1, 9, 8], [N - 1, 3, 4, 20, 4.5], [0, 90, 0, 99, 9]]),
        ],
        {"wanted": [True, False]},
    ),
    "ReLU": ("", lambda N: [off_zero(N, 3)], {}),
    "ReLU6": ("relu6_param { negative_slope: 0.2 }", lambda N: [off_zero(N, 3) * 10], {}),
    "Reduction": (
        "reduction_param { operation: SUMSQ axis: 1 coeff: 2 }",
        lambda N: [off_zero(N, 2, 3)],
        {},
    ),
    "Reshape": ("reshape_param { shape { dim: 0 dim: -1 } }", lambda N: [off_zero(N, 2, 3)], {}),
    "SPP": ("spp_param { pyramid_height: 2 }", lambda N: [different(N, 2, 5, 4)], {}),
    "Scale": ("scale_param { bias_term: true }", lambda N: [off_zero(N, 2, 3)], {}),
    "ShuffleChannel": ("shuffle_channel_param { group: 2 }", lambda N: [off_zero(N, 6, 2, 3)], {}),
    "Sigmoid": ("", lambda N: [off_zero(N, 3)], {}),
    "SigmoidCrossEntropyLoss": (
        "",
        lambda N: [off_zero(N, 3), abs(off_zero(N, 3))],
        {"wanted": [True, False]},
    ),
    "Silence": ("", lambda N: [off_zero(N, 3)], {"tops": 0}),
    "Slice": ("", lambda N: [off_zero(N, 4)], {"tops": 2}),
    "SmoothL1Loss": (
        "smooth_l1_loss_param { sigma: 1.3 }",
        lambda N: [off_zero(N, 3), off_zero(N, 3)],
        {},
    ),
    "Softmax": ("", lambda N: [off_zero(N, 3)], {}),
    "SoftmaxWithLoss": (
        "",
        lambda N: [off_zero(N, 3), RNG.integers(0, 3, N)],
        {"wanted": [True, False]},
    ),
    "Split": ("", lambda N: [off_zero(N, 3)], {"tops": 2}),
    "Swish": ("swish_param { beta: 1.7 }", lambda N: [off_zero(N, 3)], {}),
    "TanH": ("", lambda N: [off_zero(N, 3)], {}),
    "Threshold": ("", lambda N: [off_zero(N, 3)], {"wanted": [False]}),
    "Tile": ("tile_param { tiles: 3 }", lambda N: [off_zero(N, 2, 2)], {}),
    "Upsample": (
        "upsample_param { pad_out_h: true }",
        lambda N: [
            off_zero(N, 2, 2, 3),
            np.stack([RNG.permutation(18)[:6].reshape(2, 3) for _ in range(2 * N)]).reshape(
                N, 2, 2, 3
            ),
        ],
        {"wanted": [True, False]},
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
