"""Layers that cannot be built or run: options, shapes or values of the bottoms, and the
line of the error.
"""

import numpy as np

from netlib.errors import DataError, LayerError, PrototxtError
from tests.layers.conftest import Run
from tests.support.bad_input import bad_inputs
from tests.support.nets import inputs

IMAGE, ITEMS, NEAR = (1, 1, 5, 5), (2, 3), (1, 1, 2, 2)
PRIOR = [(1, 4), (1, 2), [[[0, 0, 1, 1], [0.1] * 4]]]  # one box and its two confidences
X4, CONT = (4, 2, 5), (4, 2)  # a sequence of 4 steps of 2 streams, and its marks
KERNEL = "needs kernel_size, or kernel_h and kernel_w"
STRIDE = "stride is {}; expected stride, or stride_h and stride_w, of at least 1"
ITEM = "bottoms 'bottom0' {} and 'bottom1' {} must have the same number of items and of values per item"
LABELS = "labels 'bottom1' {} do not fit scores 'bottom0' {}; expected {}"
SHAPE = "bottom 'bottom{}' has shape {}, expected {}"
RANGE = "axis {} is out of range for a blob of {} axes {}"
GROUP = "num_output and group must be at least 1"
POOL = "STOCHASTIC pooling is not supported, as in Caffe on a CPU; expected MAX or AVE"
MASK = "needs the mask of a Pooling, its second top, as second bottom; with one bottom, Upsample reads only scale"
ORDER = "must name axes of 'bottom0' (2, 3, 4), 0 to 2, each at most once"
BN = "expected options of SegNet's BN (bn_mode, ...) or of PSPNet's (slope_filler, ...), found "
RECURRENT = "recurrent_param { num_output: 3 }"
DETECTION = "detection_output_param { num_classes: 2 }"
MARKS = "bottom 'bottom{}' (cont) has no gradient; set propagate_down: false"
INSIDE = "bottom 'bottom0' (1, 1, 4, 5) does not contain 'bottom1' {} at offset {}, from axis 2 on"
REGION = "expected an item from 0 to 0 and four finite coordinates"
AT = ": error: layer 'it': "
NO_GRADIENT = "has no gradient; set propagate_down: false, or remove it from the training net"
NONE_FOR = "has no gradient for its {}; set propagate_down: false for them"


def of(layer, *rows):
    """Rows (text, bottoms, line, tops) of a layer type, from rows
    (options, bottoms, line[, tops]).
    """
    kind, *field = layer.split(maxsplit=1)
    texts = [
        f'type: "{kind}"' + "".join(f" {field[0]} {{ {options} }}" for _ in field)
        for options, *_ in rows
    ]
    return [(text, *row[1:3], row[3] if len(row) == 4 else 1) for text, row in zip(texts, rows)]


def arrays(bottoms):
    """Bottoms of zeros for shapes, and of the values for lists."""
    return [np.zeros(b) if isinstance(b, tuple) else np.asarray(b) for b in bottoms]


BAD = [
    *of(
        "Bias bias_param",
        ("axis: 1 num_axes: 3", [(2, 3, 4)], "axis 1, num_axes 3 do not fit (2, 3, 4)"),
        ("num_axes: -2", [(2, 3, 4)], "axis 1, num_axes -2 do not fit (2, 3, 4)"),
        ("axis: 3", [(2, 3, 4)], RANGE.format(3, 3, (2, 3, 4))),
        ("", [(2, 3, 4), (4,)], "bias (4,) does not fit axes 1 to 2 of bottom 'bottom0' (2, 3, 4)"),
        (
            "axis: 2",
            [(2, 3, 4), (4, 1)],
            "bias (4, 1) does not fit axes 2 to 4 of bottom 'bottom0' (2, 3, 4)",
        ),
    ),
    *of(
        "Scale",
        ("", [(2, 3, 4), (4,)], "gain (4,) does not fit axes 1 to 2 of bottom 'bottom0' (2, 3, 4)"),
    ),
    *of(
        "Exp exp_param",
        *(
            (f"base: {base}", [(1,)], f"36: base {base} must be positive and finite, or -1 for e")
            for base in ("0", "-2", "inf", "nan")
        ),
    ),
    *of(
        "Log log_param",
        *(
            (
                f"base: {base}",
                [(1,)],
                f"36: base {base} must be positive, finite and not 1, or -1 for e",
            )
            for base in ("0", "-2", "inf", "nan", "1")
        ),
    ),
    *of("PReLU", ("", [(3,)], SHAPE.format(0, (3,), "(N, C, ...)"))),
    *of(
        "ArgMax argmax_param",
        (
            "top_k: 0",
            [(2, 2, 2)],
            "top_k 0 must be from 1 to the 4 values of an item of 'bottom0' (2, 2, 2)",
        ),
        (
            "top_k: 5",
            [(2, 2, 2)],
            "top_k 5 must be from 1 to the 4 values of an item of 'bottom0' (2, 2, 2)",
        ),
        (
            "top_k: 3 axis: 1",
            [(2, 2, 2)],
            "top_k 3 must be from 1 to the 2 values along axis 1 of 'bottom0' (2, 2, 2)",
        ),
        ("axis: 3", [(2, 2, 2)], RANGE.format(3, 3, (2, 2, 2))),
    ),
    *of(
        "Axpy",
        *(
            (
                "",
                [first, (2, 3, 4, 4), (2, 3, 4, 4)],
                f"bottom 'bottom0' {first} must have one number per item and channel of 'bottom1' (2, 3, 4, 4)",
            )
            for first in ((2, 4), (2, 3, 4, 4))
        ),
        (
            "",
            [(2,)] * 3,
            "bottom 'bottom0' (2,) must have one number per item and channel of 'bottom1' (2,)",
        ),
        (
            "",
            [(2, 3), (2, 3, 4, 4), (2, 3, 4, 5)],
            "bottoms 'bottom1' (2, 3, 4, 4) and 'bottom2' (2, 3, 4, 5) must have the same shape",
        ),
    ),
    *of(
        "BatchReindex",
        *(
            (
                "",
                [(3, 2), [i]],
                f"bottom 'bottom1' has index {i}, but 'bottom0' (3, 2) has items 0 to 2",
            )
            for i in (3, -1, np.nan)
        ),
        (
            "",
            [(3, 2), (2, 1)],
            "bottoms 'bottom0' (3, 2) and 'bottom1' (2, 1) must be items (N, ...) and their indices (M,)",
        ),
    ),
    *of(
        "Concat concat_param",
        *(
            (
                "",
                [ITEMS, shape],
                f"bottom 'bottom1' {shape} and 'bottom0' (2, 3) may differ only along axis 1",
            )
            for shape in ((3, 3), (2, 3, 1))
        ),
        ("axis: 2", [ITEMS], RANGE.format(2, 2, ITEMS)),
        (
            "axis: 1 concat_dim: 1",
            [ITEMS],
            "axis and concat_dim are the same option; expected only one of them",
        ),
    ),
    *of(
        "Dropout dropout_param",
        *(
            (
                f"dropout_ratio: {ratio}",
                [(3,)],
                f"dropout_ratio {ratio} must be at least 0 and less than 1",
            )
            for ratio in (1, -0.1, 2)
        ),
    ),
    *of(
        "Eltwise eltwise_param",
        ("", [(3,), (2,)], "bottom 'bottom1' (2,) and 'bottom0' (3,) must have the same shape"),
        ("coeff: 1", [(3,), (3,)], "has 2 bottoms, but 1 coeff"),
        (
            "operation: PROD coeff: 1 coeff: 1",
            [(3,), (3,)],
            "coeff is only valid with operation SUM",
        ),
    ),
    *of(
        "Embed embed_param",
        *(
            (
                "num_output: 2 input_dim: 3",
                [[index]],
                f"bottom 'bottom0' holds {index}, expected whole numbers from 0 to 2 (input_dim 3)",
            )
            for index in (3, -1, 0.5, np.nan, np.inf)
        ),
        ("num_output: 0 input_dim: 3", [(1,)], "num_output must be at least 1"),
        ("num_output: 3 input_dim: 0", [(1,)], "input_dim must be at least 1"),
    ),
    *of(
        "Filter",
        (
            "",
            [(3,), (3,)],
            "has 2 bottoms, the last of them the selector, and 2 tops; expected 1 tops",
            2,
        ),
        (
            "",
            [(3,), (3, 2)],
            "the selector 'bottom1' (3, 2) must have one value per item, (N,) or (N, 1, ...)",
        ),
        (
            "",
            [ITEMS, (3,)],
            "bottom 'bottom0' (2, 3) and the selector 'bottom1' (3,) must have the same number of items",
        ),
    ),
    *of(
        "Flatten flatten_param",
        ("axis: 2 end_axis: 0", [(2, 3, 4, 5)], "end_axis 0 comes before axis 2"),
        ("axis: 4", [(2, 3, 4, 5)], RANGE.format(4, 4, (2, 3, 4, 5))),
        ("end_axis: 4", [(2, 3, 4, 5)], f"end_{RANGE.format(4, 4, (2, 3, 4, 5))}"),
    ),
    *of(
        "InnerProduct inner_product_param",
        ("num_output: 0", [ITEMS], "num_output must be at least 1"),
        ("num_output: 3 axis: 2", [ITEMS], RANGE.format(2, 2, ITEMS)),
    ),
    *of(
        "Permute permute_param",
        ("order: 0 order: 1 order: 0", [(2, 3, 4)], f"order [0, 1, 0] {ORDER}"),
        ("order: 0 order: 3", [(2, 3, 4)], f"order [0, 3] {ORDER}"),
    ),
    *of(
        "Reduction reduction_param",
        ("axis: 2", [(2, 2)], RANGE.format(2, 2, (2, 2))),
        (
            "operation: MEAN axis: 1",
            [(2, 0)],
            "bottom 'bottom0' (2, 0) has no values, so no mean exists",
        ),
    ),
    *of(
        "Reshape reshape_param",
        ("shape { dim: 5 }", [(2, 3, 4)], "cannot give 24 values (2, 3, 4) the shape (5,)"),
        (
            "shape { dim: 5 dim: -1 }",
            [(2, 3, 4)],
            "cannot give 24 values (2, 3, 4) the shape (5, 4)",
        ),
        (
            "shape { dim: -1 dim: -1 }",
            [(2, 3, 4)],
            "shape [-1, -1] may contain one -1 and no smaller number",
        ),
        ("shape { dim: -2 }", [(2, 3, 4)], "shape [-2] may contain one -1 and no smaller number"),
        (
            "shape { dim: 1 dim: 1 dim: 1 dim: 0 }",
            [(2, 3, 4)],
            "shape [1, 1, 1, 0]: 0 at index 3, but the bottom has shape (2, 3, 4)",
        ),
        ("axis: 4", [(2, 3, 4)], "axis 4, num_axes -1 do not fit a bottom of shape (2, 3, 4)"),
        (
            "axis: 1 num_axes: 3",
            [(2, 3, 4)],
            "axis 1, num_axes 3 do not fit a bottom of shape (2, 3, 4)",
        ),
        (
            "shape { dim: 24 } num_axes: -2",
            [(2, 3, 4)],
            "axis 0, num_axes -2 do not fit a bottom of shape (2, 3, 4)",
        ),
    ),
    *of(
        "ShuffleChannel shuffle_channel_param",
        ("group: 4", [(1, 6, 2, 2)], "group is 4; expected a divisor of the 6 channels"),
        ("group: 0", [(1, 6, 2, 2)], "group is 0; expected a divisor of the 6 channels"),
        ("group: 1", [(6,)], SHAPE.format(0, (6,), "(N, C, ...)")),
    ),
    *of(
        "Slice slice_param",
        ("", [(4, 6)], "axis 1 of (4, 6) cannot be split into 4 equal parts", 4),
        *(
            (
                "".join(f"slice_point: {n} " for n in points),
                [(4, 6)],
                f"slice_point {points} must be {tops - 1} increasing numbers from 1 to 6, and {tops} tops at most 6",
                tops,
            )
            for points, tops in (([2], 3), ([4, 2], 3), ([7], 2), ([0], 2))
        ),
        (
            "axis: 0 slice_point: 1 slice_point: 2 slice_point: 3 slice_point: 4",
            [(4, 6)],
            "slice_point [1, 2, 3, 4] must be 4 increasing numbers from 1 to 4, and 5 tops at most 4",
            5,
        ),
        (
            "axis: 1 slice_dim: 1",
            [(4, 6)],
            "axis and slice_dim are the same option; expected only one of them",
            2,
        ),
        ("axis: 2", [(4, 6)], RANGE.format(2, 2, (4, 6)), 2),
    ),
    *of("Softmax", ("", [(3,)], RANGE.format(1, 1, (3,)))),
    *of(
        "Tile tile_param",
        ("tiles: 0", [ITEMS], "tiles 0 must be at least 1"),
        ("tiles: -2", [ITEMS], "tiles -2 must be at least 1"),
        ("tiles: 2 axis: 2", [ITEMS], RANGE.format(2, 2, ITEMS)),
    ),
    *of(
        "Accuracy accuracy_param",
        ("", [(4, 3), (2,)], LABELS.format((2,), (4, 3), (4,))),
        ("top_k: 4", [(4, 3), (4,)], "top_k 4 is more than the 3 classes"),
    ),
    *of(
        "ContrastiveLoss",
        ("", [ITEMS, (2, 4), (2,)], ITEM.format(ITEMS, (2, 4))),
        ("", [ITEMS, (3, 3), (2,)], ITEM.format(ITEMS, (3, 3))),
        ("", [(2, 3, 2), (2, 3, 2), (2,)], SHAPE.format(0, (2, 3, 2), "(N, C), two axes")),
        ("", [ITEMS, (2, 1, 3), (2,)], SHAPE.format(1, (2, 1, 3), "(N, C), two axes")),
        *(
            ("", [ITEMS, ITEMS, pairs], SHAPE.format(2, pairs, "(2,), one value per pair"))
            for pairs in ((3,), (2, 2), (1, 2))
        ),
    ),
    *of(
        "EuclideanLoss",
        *(
            ("", [ITEMS, target], ITEM.format(ITEMS, target))
            for target in ((2, 4), (3, 2), (6,), (6, 1), ())
        ),
    ),
    *(
        row
        for kind in ("SmoothL1Loss", "SigmoidCrossEntropyLoss")
        for row in of(kind, ("", [ITEMS, (2, 4)], ITEM.format(ITEMS, (2, 4))))
    ),
    *of(
        "SmoothL1Loss smooth_l1_loss_param",
        *(
            (f"sigma: {text}", [ITEMS] * 2, f"sigma {value} must be above 0, with a finite square")
            for text, value in (("0", "0"), ("-1", "-1"), ("1e200", "inf"), ("1e-200", "0"))
        ),
    ),
    *of(
        "HingeLoss",
        *(
            ("", [ITEMS, labels], LABELS.format(labels, ITEMS, (2,)))
            for labels in ((3,), (2, 3), (1, 2))
        ),
        ("", [(), ()], "scores 'bottom0' have shape (), expected (N, classes)"),
        ("", [(0, 3), (0,)], "scores 'bottom0' have shape (0, 3), expected (N, classes)"),
    ),
    *of("MultinomialLogisticLoss", ("", [ITEMS, (3,)], LABELS.format((3,), ITEMS, (2,)))),
    *of(
        "SoftmaxWithLoss",
        *(("", [ITEMS, labels], LABELS.format(labels, ITEMS, (2,))) for labels in ((1,), (1, 2))),
    ),
    *(
        row
        for kind in ("SoftmaxWithLoss", "HingeLoss", "MultinomialLogisticLoss", "Accuracy")
        for row in of(
            kind,
            *(
                ("", [ITEMS, [0, label]], f"label {label:.9g} in 'bottom1'; expected 0 to 2")
                for label in (3, -1, 1e9, np.nan, np.inf, -np.inf)
            ),
        )
    ),
    *of(
        "InfogainLoss infogain_loss_param",
        ("", [ITEMS, (1,), (3, 3)], LABELS.format((1,), ITEMS, (2,))),
        ("", [ITEMS, [0, 3], (3, 3)], "label 3 in 'bottom1'; expected 0 to 2"),
        ("", [ITEMS, (2,), (2, 2)], "H 'bottom2' (2, 2) has 4 values, expected 3 x 3"),
        (
            "",
            [ITEMS, (2,)],
            "needs the matrix H, as a third bottom or as infogain_loss_param { source: ... }",
        ),
        ("axis: 2", [ITEMS, (2,), (3, 3)], RANGE.format(2, 2, ITEMS)),
    ),
    *of(
        "InfogainLoss loss_param",
        (
            "normalize: true",
            [ITEMS, (2,), (3, 3)],
            "InfogainLoss does not support normalize; expected normalization: VALID or BATCH_SIZE",
        ),
    ),
    *of(
        "BatchNorm",
        ("", [(3,)], SHAPE.format(0, (3,), "(N, C, ...)")),
        ("", [(0, 2)], "bottom 'bottom0' (0, 2) has no values, so no mean exists"),
    ),
    *of(
        "BN bn_param",
        ("", [NEAR], f"{BN}neither"),
        ("bn_mode: LEARN eps: 1", [NEAR], f"{BN}bn_mode and eps"),
        ("eps: 1", [NEAR], "has 2 tops, but only SegNet's BN has tops for mean and variance", 2),
        ("bn_mode: LEARN", [(1, 2)], SHAPE.format(0, (1, 2), "(N, C, H, W)")),
        (
            "bn_mode: LEARN",
            [(0, 2, 2, 2)],
            "bottom 'bottom0' (0, 2, 2, 2) has no values, so no mean exists",
        ),
    ),
    *of(
        "LRN lrn_param",
        ("local_size: 4", [(1, 2, 3, 4)], "local_size 4 is even; expected an odd number"),
        ("", [(3, 5)], SHAPE.format(0, (3, 5), "(N, C, H, W)")),
    ),
    *of(
        "MVN",
        ("", [(1, 2, 3, 4, 5)], SHAPE.format(0, (1, 2, 3, 4, 5), "at most 4 axes, in place 4")),
    ),
    *of("Normalize", ("", [(3,)], SHAPE.format(0, (3,), "(N, C, ...)"))),
    *of(
        "LSTM recurrent_param",
        *(
            ("num_output: 3 expose_hidden: true", [X4, CONT, *states], line, tops)
            for states, line, tops in (
                ([(1, 2, 3)], "has 3 bottoms and 3 tops, expected 4 or 5 and 3", 3),
                ([(1, 2, 3), (1, 2, 3)], "has 4 bottoms and 1 tops, expected 4 or 5 and 3", 1),
                ([(1, 2, 3), (1, 2, 4)], SHAPE.format(3, (1, 2, 4), (1, 2, 3)), 3),
                (
                    [(3, 1), (1, 2, 3), (1, 2, 3)],
                    SHAPE.format(2, (3, 1), f"(2, ...), the streams of 'bottom0' {X4}"),
                    3,
                ),
            )
        ),
    ),
    *of(
        "LSTMUnit",
        *(
            ("", shapes, line, 2)
            for shapes, line in (
                (
                    [(2, 3), (1, 2, 12), (1, 2)],
                    SHAPE.format(0, (2, 3), "(1, N, D), one step of N streams"),
                ),
                (
                    [(4, 2, 3), (4, 2, 12), (4, 2)],
                    SHAPE.format(0, (4, 2, 3), "(1, N, D), one step of N streams"),
                ),
                (
                    [(1, 2, 3), (1, 2, 9), (1, 2)],
                    SHAPE.format(1, (1, 2, 9), "(1, 2, 12) to match 'bottom0' (1, 2, 3)"),
                ),
                (
                    [(1, 2, 3), (1, 2, 12), (1, 2, 1)],
                    SHAPE.format(2, (1, 2, 1), "(1, 2) to match 'bottom0' (1, 2, 3)"),
                ),
            )
        ),
    ),
    *(
        row
        for kind in ("RNN", "LSTM")
        for row in of(
            f"{kind} recurrent_param",
            ("num_output: 3", [(4, 2), (4, 2)], SHAPE.format(0, (4, 2), "(4, N, ...)")),
            (
                "num_output: 3",
                [X4, (2, 4)],
                SHAPE.format(1, (2, 4), f"(4, 2) as steps, streams of 'bottom0' {X4}"),
            ),
            (
                "num_output: 3",
                [X4, CONT, (4, 3)],
                SHAPE.format(2, (4, 3), f"(2, ...), the streams of 'bottom0' {X4}"),
            ),
            (
                "num_output: 3",
                [X4, CONT, (2, 3), (1, 2, 3)],
                "has 4 bottoms and 1 tops, expected 2 or 3 and 1",
            ),
            ("", [X4, CONT], "num_output must be at least 1"),
        )
    ),
    *(
        row
        for kind in ("Convolution", "Deconvolution")
        for row in of(
            f"{kind} convolution_param",
            ("num_output: 2", [(1, 3, 5, 5)], f"{KERNEL}, of at least 1"),
            (
                "num_output: 2 kernel_size: 2 group: 2",
                [(1, 3, 5, 5)],
                "group 2 must divide 3 channels and num_output 2",
            ),
        )
    ),
    *of(
        "Convolution convolution_param",
        *(
            (f"num_output: 2 {options}", [(1, 3, 5, 5)], line)
            for options, line in (
                ("kernel_h: 3", f"{KERNEL}, of at least 1"),
                ("kernel_size: 3 stride_h: 2", STRIDE.format((2, 0))),
                ("kernel_size: 3 kernel_h: 3", "give either kernel_size, or kernel_h and kernel_w"),
                ("kernel_size: 2 pad: [1, 1, 1]", "3 values of pad for 2 spatial axes"),
                ("kernel_size: 2 stride: 0", STRIDE.format((0, 0))),
                ("kernel_size: 2 dilation: [1, 0]", "dilation is (1, 0), expected at least 1"),
                ("kernel_size: 2 group: 0", GROUP),
                (
                    "kernel_size: 6",
                    "kernel (6, 6) is larger than the padded bottom 'bottom0' (1, 3, 5, 5)",
                ),
                (
                    "kernel_h: 2 kernel_w: 2 axis: 2",
                    "kernel_h and kernel_w are for 2 spatial axes, found 1; expected kernel_size",
                ),
                ("kernel_size: [2, 2] axis: 2", "2 values of kernel_size for 1 spatial axes"),
                ("kernel_size: 2 axis: 4", RANGE.format(4, 4, (1, 3, 5, 5))),
            )
        ),
        ("num_output: 0 kernel_size: 2", [(1, 3, 5, 5)], GROUP),
        ("kernel_size: 2", [IMAGE], GROUP),
        (
            "num_output: 2 kernel_size: 2",
            [IMAGE],
            "has 1 bottoms and 2 tops, expected equal numbers of them",
            2,
        ),
    ),
    *of(
        "Deconvolution convolution_param",
        (
            "num_output: 2 kernel_size: 2 pad: 3",
            [(1, 3, 5, 5)],
            "pad (3, 3) leaves no output of bottom 'bottom0' (1, 3, 5, 5)",
        ),
    ),
    *of(
        "DepthwiseConvolution convolution_param",
        *(
            (
                f"num_output: 4 group: {group} kernel_size: 1",
                [(1, 4, 3, 3)],
                f"group is {group}, but bottom 'bottom0' has 4 channels; expected group: 4, or the type Convolution",
            )
            for group in (1, 2)
        ),
    ),  # forks compute another group differently on a CPU and on a GPU
    *of(
        "ConvolutionDepthwise convolution_param",
        ("kernel_size: 1", [(1, 4, 3)], SHAPE.format(0, (1, 4, 3), "(N, C, H, W)")),
    ),
    *of(
        "Crop crop_param",
        *(
            (options, [(1, 1, 4, 5), size], line)
            for options, size, line in (
                ("offset: 3", NEAR, INSIDE.format(NEAR, (3, 3))),
                ("", (1, 1, 4, 6), INSIDE.format((1, 1, 4, 6), (0, 0))),
                ("", (1, 1, 4), INSIDE.format((1, 1, 4), (0, 0))),
                (
                    "offset: 1 offset: 1 offset: 1",
                    NEAR,
                    "3 values of offset for 2 axes from axis 2 of (1, 1, 4, 5) on",
                ),
                ("axis: 4", NEAR, RANGE.format(4, 4, (1, 1, 4, 5))),
            )
        ),
    ),
    *of(
        "Im2col convolution_param",
        ("", [(1, 3, 5, 5)], f"{KERNEL}, of at least 1"),
        (
            "kernel_size: 6",
            [(1, 3, 5, 5)],
            "kernel (6, 6) is larger than the padded bottom 'bottom0' (1, 3, 5, 5)",
        ),
        (
            "kernel_size: 2 axis: 3",
            [(1, 3, 5, 5)],
            "no spatial axis after axis 3 of bottom 'bottom0' (1, 3, 5, 5)",
        ),
    ),
    *of(
        "Interp interp_param",
        (
            "",
            [NEAR],
            "needs height and width, zoom_factor, shrink_factor, or a second bottom with the size",
        ),
        ("height: 3", [NEAR], "needs both height and width"),
        ("use_blob_size: true", [NEAR], "use_blob_size needs a second bottom with the size"),
        ("zoom_factor: 0", [NEAR], "zoom_factor is 0, expected at least 1"),
        ("shrink_factor: -2", [NEAR], "shrink_factor is -2, expected at least 1"),
        (
            "zoom_factor: 2 pad_beg: 1",
            [NEAR],
            "pad_beg is 1; as in Caffe's forks, only cropping is supported: expected 0 or less",
        ),
        (
            "zoom_factor: 2 pad_end: -2",
            [NEAR],
            f"bottom 'bottom0' {NEAR} is empty after cropping by pad_beg 0 and pad_end -2",
        ),
        ("height: 0 width: 3", [NEAR], "the size of the top is 0 x 3, expected at least 1 x 1"),
        ("zoom_factor: 2", [(1, 2, 2)], SHAPE.format(0, (1, 2, 2), "(N, C, H, W)")),
    ),
    *of(
        "Upsample upsample_param",
        ("scale: 0", [NEAR], "scale must be at least 1"),
        ("upsample_h: 4 upsample_w: 4", [NEAR], f"upsample_h {MASK}"),
        ("scale: 2 pad_out_w: true", [NEAR], f"pad_out_w {MASK}"),
        ("scale: 2", [(4,)], SHAPE.format(0, (4,), "(..., H, W)")),
        ("scale_h: 2", [NEAR, NEAR], "needs scale_h and scale_w"),
        ("upsample_w: 2", [NEAR, NEAR], "needs upsample_h and upsample_w"),
        (
            "scale: 2 scale_h: 2 scale_w: 2",
            [NEAR, NEAR],
            "give either scale, or scale_h and scale_w",
        ),
        ("scale: 1", [NEAR, NEAR], "scale must be at least 2"),
        (
            "upsample_h: 1 upsample_w: 4",
            [NEAR, NEAR],
            "upsample_h and upsample_w must be at least 2",
        ),
        (
            "scale: 3 pad_out_h: true",
            [NEAR, NEAR],
            "pad_out_h is for scale 2, not 3; expected upsample_h and ...",
        ),
        ("", [(2, 2, 2)] * 2, SHAPE.format(0, (2, 2, 2), "(N, C, H, W)")),
        (
            "",
            [NEAR, (1, 1, 2, 3)],
            f"bottoms 'bottom0' {NEAR} and 'bottom1' (1, 1, 2, 3), the mask of a Pooling, must have the same shape",
        ),
        *(
            (
                "",
                [NEAR, [[[[0, 2], [wrong, 10]]]]],
                (
                    f"mask 'bottom1' is {wrong} at (0, 0, 1, 0), expected 0 to 15 for a top of 4 "
                    "x 4; its Pooling must read ..."
                ),
            )
            for wrong in (-1, 16, np.nan)
        ),
    ),
    *of(
        "Pooling pooling_param",
        *(
            (options, [IMAGE], line)
            for options, line in (
                ("", f"{KERNEL}, of at least 1"),
                ("kernel_h: 2", KERNEL),
                ("kernel_size: 2 stride_h: 2", "needs stride, or stride_h and stride_w"),
                ("kernel_size: 2 pad_w: 1", "needs pad, or pad_h and pad_w"),
                ("kernel_size: 2 stride: 0", STRIDE.format((0, 0))),
                ("kernel_size: 2 pad: 2", "pad (2, 2) must be smaller than the kernel (2, 2)"),
                (
                    "kernel_size: 2 global_pooling: true",
                    "global_pooling does not allow a kernel size",
                ),
                ("global_pooling: true pad: 1", "global_pooling needs pad 0 and stride 1"),
                ("pool: STOCHASTIC kernel_size: 2", POOL),
                ("kernel_size: 6", "kernel 6 is larger than the padded bottom (5 + 2 * 0)"),
                (
                    "kernel_size: 2 kernel_h: 3 kernel_w: 3",
                    "give either kernel_size, or kernel_h and kernel_w",
                ),
                (
                    "kernel_size: 3 stride: 2 stride_h: 1",
                    "give either stride, or stride_h and stride_w",
                ),
                ("kernel_size: 3 pad: 1 pad_w: 1", "give either pad, or pad_h and pad_w"),
                (
                    "kernel_size: 3 ceil_mode: false round_mode: CEIL",
                    "ceil_mode: false is round_mode: FLOOR, but round_mode: CEIL is given; expected one of them",
                ),
            )
        ),
        (
            "pool: AVE kernel_size: 2",
            [IMAGE],
            "has 2 tops, but only MAX pooling has a mask, not AVE",
            2,
        ),
        ("kernel_size: 2", [(3, 5)], SHAPE.format(0, (3, 5), "(N, C, H, W)")),
        ("global_pooling: true", [(1, 1, 0, 2)], SHAPE.format(0, (1, 1, 0, 2), "(N, C, H, W)")),
    ),
    *of(
        "PriorBox prior_box_param",
        *(
            (options, [(2, 3, 1, 1), (2, 1, 10, 20)], line)
            for options, line in (
                ("", "min_size [] must be one or more sizes above 0"),
                (
                    "min_size: 3 min_size: 0",
                    "min_size [3.0, 0.0] must be one or more sizes above 0",
                ),
                (
                    "min_size: 3 min_size: 4 max_size: 5",
                    "max_size [5.0] must have a larger size for each min_size [3.0, 4.0], or none",
                ),
                (
                    "min_size: 3 max_size: 3",
                    "max_size [3.0] must have a larger size for each min_size [3.0], or none",
                ),
                ("min_size: 3 aspect_ratio: 0", "aspect_ratio [0.0] must be above 0"),
                (
                    "min_size: 3 variance: [1, 2]",
                    "variance [1.0, 2.0] must be one or four numbers above 0",
                ),
                ("min_size: 3 variance: 0", "variance [0.0] must be one or four numbers above 0"),
                (
                    "min_size: 3 img_size: 3 img_h: 3",
                    "img_size and img_h, img_w are the same option; expected only ...",
                ),
                ("min_size: 3 img_h: 3", "expected img_size, or img_h and img_w, above 0"),
                ("min_size: 3 img_size: 0", "expected img_size, or img_h and img_w, above 0"),
                (
                    "min_size: 3 step: 3 step_w: 3",
                    "step and step_h, step_w are the same option; expected only one of them",
                ),
                ("min_size: 3 step_w: 3", "expected step, or step_h and step_w, above 0"),
            )
        ),
        (
            "min_size: 3",
            [(2, 3, 0, 4), (2, 1, 10, 20)],
            SHAPE.format(0, (2, 3, 0, 4), "(N, C, H, W)"),
        ),
        ("min_size: 3", [(2, 3, 4, 4), (2, 1, 4)], SHAPE.format(1, (2, 1, 4), "(N, C, H, W)")),
    ),
    *of(
        "DetectionOutput detection_output_param",
        ("num_classes: 0", PRIOR, "num_classes must be at least 1"),
        (
            "num_classes: 2 nms_param { nms_threshold: -0.1 }",
            PRIOR,
            "nms_threshold -0.1 must not be negative",
        ),
        ("num_classes: 2 nms_param { eta: 0 }", PRIOR, "eta 0 must be above 0 and at most 1"),
        ("num_classes: 2 nms_param { eta: 1.5 }", PRIOR, "eta 1.5 must be above 0 and at most 1"),
        (
            "num_classes: 3",
            PRIOR,
            SHAPE.format(1, (1, 2), "3 confidences per item: 3 for each of the 1 priors"),
        ),
        (
            "num_classes: 2 share_location: false",
            PRIOR,
            SHAPE.format(0, (1, 4), "8 locations per item: 8 for each of the 1 priors"),
        ),
        (
            "num_classes: 2",
            [(2, 4), (3, 2), (1, 2, 4)],
            SHAPE.format(1, (3, 2), "2 confidences per item: 2 for each of the 1 priors"),
        ),
        *(
            (
                "num_classes: 2",
                [(1, 4), (1, 2), priors],
                SHAPE.format(2, priors, "(1, 2, 4 per prior)"),
            )
            for priors in ((8,), (2, 2, 4), (1, 1, 8), (1, 2, 6), (1, 2, 4, 2))
        ),
        *(
            (
                f"num_classes: 2 code_type: {code}",
                [(1, 8), (1, 4), [[[0, 0, 1, 1, 0.5, 0, 0.5, 1], [0.1] * 8]]],
                f"prior 1 of 'bottom2' is (0.5, 0, 0.5, 1); {code} needs xmin < xmax and ymin < ymax",
            )
            for code in ("CENTER_SIZE", "CORNER_SIZE")
        ),
    ),
    *of(
        "PSROIPooling psroi_pooling_param",
        (
            "spatial_scale: 1 output_dim: 0 group_size: 2",
            [(1, 4, 4, 4), (1, 5)],
            "output_dim and group_size must be at least 1",
        ),
        (
            "spatial_scale: 1 output_dim: 2 group_size: 2",
            [(1, 4, 4, 4), (1, 5)],
            SHAPE.format(0, (1, 4, 4, 4), "(N, 8, H, W) for output_dim 2 and group_size 2"),
        ),
        (
            "spatial_scale: 1 output_dim: 1 group_size: 2",
            [(1, 4, 4, 4), (2, 4)],
            SHAPE.format(1, (2, 4), "(R, 5)"),
        ),
        (
            "spatial_scale: 1 output_dim: 1 group_size: 2",
            [(1, 4, 4, 4), [[1, 0, 0, 1, 1]]],
            f"row 0 of 'bottom1' is (1, 0, 0, 1, 1); {REGION}",
        ),
    ),
    *of(
        "ROIPooling roi_pooling_param",
        ("pooled_h: 2", [(1, 1, 4, 4), (1, 5)], "needs pooled_h and pooled_w of at least 1"),
        ("pooled_h: 2 pooled_w: 2", [(4, 4), (1, 5)], SHAPE.format(0, (4, 4), "(N, C, H, W)")),
        ("pooled_h: 2 pooled_w: 2", [(1, 1, 4, 4), (2, 4)], SHAPE.format(1, (2, 4), "(R, 5)")),
        *(
            (
                "pooled_h: 2 pooled_w: 2",
                [(1, 1, 4, 4), [[0, 0, 0, 1, 1], row]],
                f"row 1 of 'bottom1' is ({shown}); {REGION}",
            )
            for row, shown in (
                ([1, 0, 0, 1, 1], "1, 0, 0, 1, 1"),
                ([0, 0, np.nan, 1, 1], "0, 0, nan, 1, 1"),
            )
        ),
    ),
    *of(
        "SPP spp_param",
        ("", [IMAGE], "pyramid_height must be at least 1"),
        ("pyramid_height: 2 pool: STOCHASTIC", [IMAGE], POOL),
        (
            "pyramid_height: 3",
            [IMAGE],
            "bottom 'bottom0' is too small for a level of 4 x 4 windows: 5 in 4 parts of 2 need a padding of 2",
        ),
        ("pyramid_height: 2", [(3, 5)], SHAPE.format(0, (3, 5), "(N, C, H, W)")),
    ),
]


@bad_inputs(
    LayerError,
    {
        f"{text[6:]} {bottoms} {tops}": (
            (text, bottoms, tops),
            f"<gradcheck>:1:{line if ': base' in line else '...: ' + line}".replace(": ", AT, 1),
        )
        for text, bottoms, line, tops in BAD
    },
)
def test_invalid_layers_are_rejected(given, rejected):
    text, bottoms, tops = given
    with rejected:
        Run(text, arrays(bottoms), tops)


@bad_inputs(
    PrototxtError,
    {
        'type: "Clip" clip_param { min: 0 }': "<gradcheck>:1:...: error: missing required field 'max' in clip_param",
        'type: "Tile" tile_param { axis: 1 }': "<gradcheck>:1:36: error: missing required field 'tiles' in tile_param",
        'type: "Reduction" reduction_param { operation: MAX }': (
            "<gradcheck>:1:59: error: unknown value MAX of 'operation'; known values: SUM, ASUM, "
            "SUMSQ, MEAN"
        ),
        'type: "HingeLoss" hinge_loss_param { norm: 0 }':
        # in numbers L1 is 1 and L2 is 2
        "<gradcheck>:1:55: error: unknown value 0 of 'norm'; known values: L1, L2",
        'type: "DetectionOutput"': (
            "<gradcheck>:1:1: error: missing required field 'num_classes' in detection_output_param"
        ),
        "no H": (
            'type: "InfogainLoss" infogain_loss_param { source: "H.binaryproto" }',
            DataError,
            "H.binaryproto: cannot read the blob: No such file...",
        ),
        "MVN in place": (
            'type: "MVN"',
            LayerError,
            "<gradcheck>:1:1: error: layer 'it': bottom 'bottom0' has shape (2, 3), expected ..., in place 4",
        ),
    },
)
def test_invalid_options_are_rejected(given, rejected):
    count = 3 if "Output" in given else 2 if "Loss" in given else 1
    with rejected:
        Run(given, [np.zeros((2, 3))] * count, in_place="MVN" in given)


@bad_inputs(
    LayerError,
    {
        f"{text[6:]} {bottoms} {later}": (
            (text, bottoms, later),
            f"<gradcheck>:1:1: error: layer 'it': {line}",
        )
        for text, bottoms, later, line in (
            (
                'type: "PReLU"',
                [(2, 3)],
                [(2, 4)],
                "bottom 'bottom0' has 4 channels (2, 4), its slopes expect 3",
            ),
            (
                'type: "Scale" scale_param { bias_term: true }',
                [(2, 1), (1,)],
                [(2, 4), (4,)],
                "gain 'bottom1' (4,) does not fit the bias (1,)",
            ),
            (
                'type: "InnerProduct" inner_product_param { num_output: 3 }',
                [(2, 3)],
                [(2, 2, 2)],
                "bottom 'bottom0' has 4 features (2, 2), its weights expect 3",
            ),
            (
                'type: "BatchNorm"',
                [(2, 3)],
                [(2, 4)],
                "bottom 'bottom0' has shape (2, 4), its statistics are of 3 channels: expected (N, 3, ...)",
            ),
            (
                'type: "Normalize" norm_param { channel_shared: false }',
                [(2, 3)],
                [(2, 4)],
                "bottom 'bottom0' has shape (2, 4), its scale expects (N, 3, ...)",
            ),
            *(
                (f'type: "{kind}" recurrent_param {{ num_output: 3 }}', [X4, CONT], later, line)
                for kind in ("RNN", "LSTM")
                for later, line in (
                    ([(3, 2, 5), (3, 2)], SHAPE.format(0, (3, 2, 5), "(4, N, ...)")),
                    (
                        [(4, 2, 6), (4, 2)],
                        "bottom 'bottom0' has 6 features (4, 2, 6), its weights ... 5",
                    ),
                )
            ),
            (
                'type: "Convolution" convolution_param { num_output: 2 kernel_size: 2 }',
                [(1, 3, 5, 5)],
                [(3, 5)],
                SHAPE.format(0, (3, 5), "2 spatial axes after axis 1"),
            ),
            (
                'type: "Convolution" convolution_param { num_output: 2 kernel_size: 2 }',
                [(1, 2, 5, 5)],
                [(1, 3, 5, 5)],
                "bottom 'bottom0' has 3 channels (1, 3, 5, 5), its weights (2, 2, 2, 2) expect 2",
            ),
        )
    },
)
def test_shapes_that_must_stay(given, rejected):
    """What the shapes of the parameters depend on may not change after setup;
    nothing is broadcast.
    """
    text, bottoms, later = given
    done = Run(text, arrays(bottoms))
    for blob, shape in zip(done.bottom, later):
        blob.reshape(shape)
    with rejected:
        done.layer.reshape(done.bottom, done.top)


@bad_inputs(
    LayerError,
    {
        f"{text} {wanted}": (
            (text, bottoms, wanted, tops),
            f"<gradcheck>:1:1: error: layer 'it': {line}",
        )
        for text, bottoms, wanted, tops, line in (
            ("Threshold", [(1,)], None, 1, NO_GRADIENT),
            ("ArgMax", [(2, 2)], None, 1, NO_GRADIENT),
            ("Accuracy", [(4, 3), (4,)], None, 1, NO_GRADIENT),
            ("DetectionOutput", PRIOR, None, 1, NO_GRADIENT),
            (
                "BatchReindex",
                [(3, 2), (1,)],
                None,
                1,
                "the indices 'bottom1' have no gradient; set propagate_down: false",
            ),
            (
                "Embed",
                [(1,)],
                None,
                1,
                "the indices 'bottom0' have no gradient; set propagate_down: false",
            ),
            (
                "Filter",
                [(2,), (2,)],
                None,
                1,
                "the selector 'bottom1' has no gradient; set propagate_down: false",
            ),
            ("ContrastiveLoss", [(4, 2), (4, 2), (4,)], None, 1, NONE_FOR.format("labels")),
            *(
                (
                    "InfogainLoss",
                    [(2, 3), (2,), (3, 3)],
                    wanted,
                    1,
                    NONE_FOR.format("labels and for H"),
                )
                for wanted in ([True, True, False], [True, False, True])
            ),
            ("SmoothL1Loss", [(1, 2)] * 4, None, 1, NONE_FOR.format("weights")),
            *(
                (kind, [(2, 3), (2,)], None, 1, NONE_FOR.format("labels"))
                for kind in ("SoftmaxWithLoss", "HingeLoss", "MultinomialLogisticLoss")
            ),
            ("SigmoidCrossEntropyLoss", [(2, 3), (2, 3)], None, 1, NONE_FOR.format("targets")),
            ("LSTMUnit", [(1, 2, 3), (1, 2, 12), (1, 2)], None, 2, MARKS.format(2)),
            ("RNN", [X4, CONT], None, 1, MARKS.format(1)),
            ("LSTM", [X4, CONT], None, 1, MARKS.format(1)),
        )
    },
)
def test_backward_without_a_gradient_is_an_error(given, rejected):
    kind, bottoms, wanted, tops = given
    options = {
        "Embed": "embed_param { num_output: 2 input_dim: 3 }",
        "DetectionOutput": DETECTION,
        **dict.fromkeys(("RNN", "LSTM"), RECURRENT),
    }
    done = Run(f'type: "{kind}" {options.get(kind, "")}', arrays(bottoms), tops)
    with rejected:
        done.backward(*(np.ones(blob.shape) for blob in done.top), wanted=wanted)


@bad_inputs(
    LayerError,
    {
        # the sign of x would be lost; Caffe rejects it, too
        "AbsVal": (
            'name: "a" type: "AbsVal" bottom: "x" top: "x"',
            "net.prototxt:2:7: error: layer 'a': AbsVal cannot run in place, but 'x' is both bottom and top",
        ),
        # y does not determine x
        "ReLU": (
            'name: "r" type: "ReLU" bottom: "x" top: "x" relu_param { negative_slope: -1 }',
            "net.prototxt:2:...: error: layer 'r': a negative negative_slope cannot run in place",
        ),
        "ReLU6": (
            'name: "r" type: "ReLU6" bottom: "x" top: "x" relu6_param { negative_slope: -1 }',
            "net.prototxt:2:...: error: layer 'r': a negative negative_slope cannot run in place",
        ),
        "Parameter": (
            'name: "w" type: "Parameter" top: "w" parameter_param { shape { dim: -2 dim: 3 } }',
            "net.prototxt:2:...: error: layer 'w': shape (-2, 3) has a negative size",
        ),
        "lr_mult": (
            'name: "b" bottom: "x" top: "y" type: "BatchNorm" param { lr_mult: 2 }',
            "net.prototxt:2:...: error: layer 'b': param 0 has lr_mult 2, but statistics are not learned: expected 0",
        ),
        "named": (
            'name: "b" bottom: "x" top: "y" type: "BatchNorm" param { name: "m" }',
            "net.prototxt:2:...: error: layer 'b': param 0 has lr_mult 1, but statistics are not learned: expected 0",
        ),
        "bn_param": (
            'name: "b" type: "BatchNorm" bottom: "x" bn_param {}',
            "...error: layer 'b': bn_param "
            'belongs to the type BN; expected batch_norm_param, or type: "BN"',
        ),
    },
)
def test_invalid_nets_are_rejected(net_of, given, rejected):
    """Layers that cannot run in place, statistics with a learning rate, and options of another
    type are an error.
    """
    with rejected:
        net_of(inputs(x=(2, 3)) + f"\nlayer {{ {given} }}")
