"""Texts of random nets, for the tests that compare the engines."""

from __future__ import annotations

import re
from random import Random
from typing import Any

import numpy as np

import netlib
from netlib.proto import prototxt
from tests.support.nets import inputs

Weights = dict[str, int]  # how often a text is drawn, compared with the others

# Options of layers. One of the <alternatives|in angle brackets> is drawn. A layer reads the blob X
# and may read others, "B"; it writes Y, and may write "Z". The labels are "t1".
CONVOLUTION = """type: "Convolution" convolution_param { num_output: <1|2|3|4> bias_term: <true|false>
    weight_filler { type: "gaussian" std: 0.5 } bias_filler { type: "uniform" min: -1 max: 1 } """
PLAIN_CONVOLUTION = CONVOLUTION + "<kernel_size: 1|kernel_size: 3 pad: 1> }"
DEPTHWISE = CONVOLUTION.replace("Convolution", "DepthwiseConvolution") + "kernel_size: 3 pad: 1 }"
# for the algorithms that take many channels
WIDE = (
    CONVOLUTION.replace("<1|2|3|4>", "<24|48>") + "<kernel_size: 3 pad: 1|kernel_size: 5 pad: 2> }"
)
INNER_PRODUCT = (
    'type: "InnerProduct" inner_product_param { num_output: 3 weight_filler { type: "xavier" }'
)
RELU = 'type: <"ReLU" relu_param|"ReLU" relu_param|"ReLU6" relu6_param> { negative_slope: <0|0|0|0.1> }'
SCALE = 'type: "Scale" scale_param { bias_term: <true|false> filler { type: "uniform" min: -1 max: 2 } }'
BATCH_NORM = 'type: "BatchNorm" batch_norm_param { eps: 0.1 <|use_global_stats: <true|false>> <|||scale_bias: true> }'
LOSS = 'type: "Reduction" loss_weight: <1|2> reduction_param { operation: SUMSQ }'
PYTHON = 'type: "Python" python_param { module: "tests.support.random_layers" layer: "<Gain|Writer|Holder>" }'
IN_PLACE: Weights = {  # where possible
    RELU: 8,
    'type: "<TanH|Sigmoid|BNLL|PReLU|Bias|Softmax|Dropout|AbsVal|ELU|Swish>"': 8,
    'type: "Power" power_param { scale: <-1|0.5|1> shift: <0|0.5> power: <1|1|2> }': 2,
    'type: <"Exp" exp_param { scale: 0.1 }|"Clip" clip_param { min: -0.5 max: 1 }|"Threshold">': 1,
    'type: "Dropout" dropout_param { dropout_ratio: 0.3 <|scale_train: false> }': 1,
    SCALE: 3,
    BATCH_NORM: 3,
    'type: "BN" bn_param { <bn_mode: INFERENCE scale|<eps: 0.1|frozen: true> slope>_filler { value: 2 } }': 2,
    'type: "Normalize" norm_param { across_spatial: <true|false> channel_shared: false eps: 0.1 }': 1,
}
# Two or more layers with the same parameters.
SHARED: Weights = {
    CONVOLUTION.replace("<1|2|3|4>", "2")
    + 'kernel_size: 2 } param { name: "w" <||lr_mult: 0> }': 2,
    SCALE + ' param { name: "gain" <||lr_mult: 0> }': 1,
    BATCH_NORM + ' param { name: "mean" lr_mult: 0 } param { name: "variance" lr_mult: 0 }': 1,
    INNER_PRODUCT + ' transpose: <true|false> } param { name: "m" share_mode: PERMISSIVE }': 1,
}
SHAPES: Weights = {
    'type: "Reshape" reshape_param { shape { dim: 0 dim: <-1|0 dim: -1> } }': 1,
    'type: <"Flatten"|"Flatten"|"SPP" spp_param { pyramid_height: 2 }|"Silence">': 1,
    'type: "Permute" permute_param { order: 0 order: <2|3> }': 1,
    'type: "Tile" tile_param { axis: <1|2> tiles: 2 }': 1,
    'type: "Slice" top: "Z" slice_param { axis: <0|1|1|2> }': 2,
    'type: "Concat" bottom: "B" <|bottom: "B"> concat_param { axis: <0|1|1|2> }': 3,
    'type: "Crop" bottom: "B" crop_param { axis: <1|2> <|offset: 1> }': 1,
    'type: "Interp" interp_param { <zoom_factor: 2|shrink_factor: 2|pad_beg: -1> }': 1,
    'type: "ShuffleChannel" shuffle_channel_param { group: 2 }': 1,
    'type: "Filter" bottom: "t1"': 1,
    'type: "BatchReindex" bottom: "t1"': 1,
}
SUMS: Weights = {
    'type: "Eltwise" bottom: "B" eltwise_param { operation: <SUM|PROD|MAX> }': 3,
    'type: "Eltwise" bottom: "B" eltwise_param { coeff: <1|-1|0.5> coeff: <2|-1> }': 1,
    'type: "Eltwise" bottom: "B" bottom: "B" eltwise_param { coeff: 0.5 coeff: <2|-1> coeff: 1 }': 1,
    'type: "<Scale|Bias>" bottom: "B" <scale|bias>_param { axis: 0 }': 2,
    'type: "EuclideanLoss" loss_weight: 2 bottom: "B"': 1,
}
LAYERS: Weights = {
    **IN_PLACE,
    **SHARED,
    **SHAPES,
    **SUMS,
    CONVOLUTION + "kernel_size: <1|2|2|3|4> stride: <1|1|1|2> pad: <0|0|0|1> }": 7,
    CONVOLUTION.replace("<1|2|3|4>", "12")
    + "kernel_size: <2|3> pad: 1 group: <2|3|4> dilation: <1|1|2> }": 2,
    CONVOLUTION.replace("Conv", "Deconv")
    + "kernel_size: <1|2|3> stride: <1|2> pad: <0|1> group: <1|1|2> }": 2,
    DEPTHWISE: 1,
    CONVOLUTION + 'kernel_size: <2|3> } bottom: "B" top: "Z"': 1,
    'type: "Pooling" pooling_param { <kernel_size: 2 stride: 2|kernel_size: 3 stride: 3|kernel_size: 4 stride: 4> }': 4,
    """type: "Pooling" pooling_param { pool: <MAX|AVE> kernel_size: <2|3|4> stride: <1|2|3> pad: <0|1>
    <|round_mode: FLOOR> }""": 4,
    'type: "Pooling" pooling_param { <kernel_size: 2 } top: "Z"|pool: <MAX|AVE> global_pooling: true }>': 2,
    INNER_PRODUCT + " }": 2,
    'type: <"ReLU" relu_param { negative_slope: -0.5 }|"Im2col" convolution_param { kernel_size: 2 }>': 2,
    'type: "LRN" lrn_param { local_size: 3 <|norm_region: WITHIN_CHANNEL> }': 2,
    'type: "MVN" mvn_param { eps: 0.1 across_channels: <true|false> }': 1,
    'type: "ArgMax" argmax_param { axis: 1 }': 1,
    PYTHON: 3,
    LOSS: 9,
}
# Several layers that belong together.
LAYER = 'layer {{ name: "{0}" bottom: "{1}" top: "{0}" {2} }}\n'.format
RECURRENT = (
    LAYER("Ym", "X", 'type: "Reduction" reduction_param { operation: MEAN axis: 2 }')
    + LAYER("Yc", "Ym", 'type: "Threshold"')
    + LAYER("Y", "X", 'bottom: "Yc" type: "<LSTM|RNN>" recurrent_param { num_output: 2 FILLER }')
).replace("FILLER", 'weight_filler { type: "uniform" min: -0.5 max: 0.5 }')
GATE = (
    LAYER("Ym", "X", 'type: "Reduction" reduction_param { operation: MEAN axis: 2 }')
    + LAYER("Yg", "Ym", 'type: "Sigmoid"')
    + LAYER("Y", "X", 'bottom: "Yg" type: "Scale" scale_param { axis: 0 }')
)
CLASSES = LAYER("Ys", "X", INNER_PRODUCT + " }") + LAYER(
    "Y", "Ys", 'bottom: "t1" type: "<SoftmaxWithLoss|SoftmaxWithLoss|HingeLoss|Accuracy>"'
)
EMBED = LAYER(
    "Y", "t1", 'type: "Embed" embed_param { num_output: 3 input_dim: 2 weight_filler { value: 1 } }'
)
PARAMETER = 'layer { name: "Yp" type: "Parameter" top: "Yp" parameter_param { shape { dim: 2 } } }'
PARAMETER += LAYER("Y", "X", 'bottom: "Yp" type: "Bias"')
GROUPS: Weights = {RECURRENT: 1, GATE: 1, CLASSES: 3, EMBED: 1, PARAMETER: 1}
# Added to the options of a layer.
FROZEN = "param { lr_mult: 0 }"
EXTRA = (
    f"<{'|' * 20}{FROZEN}|{FROZEN}|{FROZEN} {FROZEN}|{FROZEN} {FROZEN}|param {{ lr_mult: 2 }} {FROZEN}"
    "|propagate_down: <true|false>|propagate_down: <true|false> propagate_down: <true|false>"
    "|loss_weight: <0.5|-1>|include { phase: <TRAIN|TEST> }>"
)


def pick(rng: Random, weights: Weights, count: int) -> list[str]:
    return rng.choices(list(weights), list(weights.values()), k=count)


def random_net(rng: Random) -> str:
    """Return the text of a random net.

    The name of an input ends in the step of its sizes: ``x1``. ``t1`` are labels.
    """
    kind = rng.choice(["any"] * 13 + ["chain"] * 10 + ["depth"] * 6 + ["large"])
    if kind == "depth":
        return depth_net(rng, rng.choice([2, 4]))
    if kind == "large":
        return large_net(rng)
    counts = [1] * 6 + [2, 2, 5, 5, 64] if rng.random() < 0.5 else [3]
    N, C = rng.choice(counts), rng.randint(1, 4)
    least = 1 if rng.random() < 0.2 else 6
    sizes = [rng.randrange(least, min(19, 4 * least)) for _ in range(2)]
    names = ["x1", "y1", "z1"][: rng.choice([1, 1, 1, 2, 3])]
    shapes = {name: (N, C, *rng.choice([sizes, sizes, sizes[::-1]])) for name in names}
    text = inputs(**shapes)
    if rng.random() < 0.4:
        text += inputs(t1=(N,))
    text += rng.choice(["", "", "", "force_backward: true "])
    layers = pick(rng, LAYERS | GROUPS, rng.randint(2, 10)) if kind == "any" else chains(rng)
    layers += [one for one in layers if one in SHARED]
    return extended(rng, text, names, layers, straight=kind == "chain")


def chains(rng: Random) -> list[str]:
    """Layers that the fast engine computes together, some left out, and others between them."""
    layers = []
    for _ in range(rng.randint(1, 3)):
        chain = [PLAIN_CONVOLUTION, BATCH_NORM, SCALE, RELU]
        layers += [one for one in chain if rng.random() < 0.8]
        layers += pick(rng, LAYERS, rng.choice([0, 0, 1, 2]))
    return layers + [LOSS] * rng.choice([0, 1, 1])


def depth_net(rng: Random, T: int) -> str:
    """A convolution and a pooling that fit together, whose windows of background the fast engine
    skips, with layers around them.

    A second max pooling would choose between values that differ only by rounding.
    """
    sizes = [rng.randrange(max(6, 2 * T), 19, T) for _ in range(2)]
    layers = [
        CONVOLUTION + f"kernel_size: {T + 1} }}",
        *[RELU] * rng.choice([0, 1, 1]),
        f'type: "Pooling" pooling_param {{ kernel_size: {T} stride: {T} }}',
        *pick(rng, IN_PLACE, rng.randint(0, 3)),
        CONVOLUTION + "kernel_size: 1 }",
        LOSS,
    ]
    return extended(rng, inputs(**{f"x{T}": (3, 1, *sizes)}), [f"x{T}"], layers, straight=True)


def large_net(rng: Random) -> str:
    """Convolutions of many channels, or of large maps, each by itself."""
    N, size, convolution = rng.choice([(3, 15, WIDE), (8, 10, WIDE), (2, 36, DEPTHWISE)])
    layers = [convolution, *pick(rng, IN_PLACE, 2), convolution, *[RELU] * rng.randint(0, 1), LOSS]
    return extended(rng, inputs(x1=(N, 3, size, size)), ["x1"], layers, straight=True)


def is_large(net: str) -> bool:
    """Whether threads share the sums of a layer on the whole batch."""
    return bool(re.search("num_output: (24|48)", net))


def has_depth(net: str) -> bool:
    """Whether an input is a depth image."""
    return bool(re.search('"x[24]"', net))


def extended(rng: Random, text: str, names: list[str], layers: list[str], straight: bool) -> str:
    """Append the layers that fit the blobs that they read; in a ``straight`` net these are mostly
    the last ones.
    """
    # the first half of the net, as in finetuning
    frozen = rng.random() < (0.4 if straight else 0.1)
    in_place = rng.choice([0.1, 0.5, 0.9])
    for number, options in enumerate(layers):
        bottom = names[-1] if straight else rng.choice([names[-1]] * 3 + names)
        group = options if options in GROUPS else LAYER("Y", "X", f"{options} EXTRA")
        if options in IN_PLACE and bottom[0] == "b" and rng.random() < in_place:
            group = group.replace('top: "Y"', f'top: "{bottom}"')
        if "Silence" in group:
            group = group.replace('top: "Y"', "")
        freezes = frozen and number < len(layers) / 2
        for extra in [FROZEN + FROZEN] if freezes else [EXTRA], [FROZEN if freezes else ""], [""]:
            drawn = group.replace("EXTRA", extra[0])
            added = filled(rng, drawn, names, f"b{number}", bottom)
            blobs = blobs_of(text + added)
            if blobs is not None:
                text, names = text + added, blobs
                break
    return text


def filled(rng: Random, group: str, names: list[str], top: str, bottom: str) -> str:
    """Replace the names of blobs and layers, and draw the alternatives."""
    group = alternatives(rng, group).replace('"X"', f'"{bottom}"')
    group = re.sub('"B"', lambda _: f'"{rng.choice(names)}"', group)
    return re.sub('"Y(.?)"', rf'"{top}\1"', group).replace('"Z"', f'"{top}z"')


def alternatives(rng: Random, text: str) -> str:
    """Draw one of each <alternatives|in angle brackets>."""
    while "<" in text:
        text = re.sub("<([^<>]*)>", lambda found: rng.choice(found[1].split("|")), text)
    return text


def blobs_of(text: str) -> list[str] | None:
    """The blobs that a further layer of a net may read; None if its layers do not fit together."""
    model = prototxt.parse(text)
    try:
        phases = (netlib.TRAIN, netlib.TEST) if "include" in text else (netlib.TRAIN,)
        nets = [netlib.Net(model, phase, engine="plain", seed=1) for phase in phases]
    except netlib.NetlibError:
        return None
    blobs = nets[0].blobs
    names = [name for name in blobs if all(name in net.blobs for net in nets)]
    return [name for name in names if blobs[name].shape and "split" not in name and name != "t1"]


def images(net: netlib.Net, rng: np.random.Generator, new: float = 0) -> dict[str, Any]:
    """Draw an array for each input: noise; for a depth image, before zeros as background, whose
    products are exact; labels 0 and 1.

    ``new`` is the probability of another size, and of another number of items.
    """
    change = rng.integers(-2, 3, 2) * (rng.random() < new)
    count = int(rng.choice([0, 1, 2, 3, 3, 5, 7])) if rng.random() < new else None
    batches = {}
    for name in net.inputs:
        N, *shape = net.blobs[name].shape
        N = N if count is None else count
        if not shape:
            batches[name] = rng.integers(0, 2, N).astype(float)
            continue
        C, *sizes = shape
        step = int(name[1:])
        least = 2 * step if step > 1 else 1
        H, W = (max(least, size + step * more) for size, more in zip(sizes, change))
        batch = rng.normal(size=(N, C, H, W))
        if step > 1:
            np.negative(abs(batch), out=batch)
            for image in batch:
                image[:, rng.integers(H) :] = 0
                image[..., rng.integers(W) :] = 0
        batches[name] = batch
    return batches
