"""Advice on unknown layer types: the known layers that compute the same, what else there is
instead, or the correct spelling.

The tables have the types that public forks of Caffe register and that converters from PyTorch
write. Another type is taken for a known one only if one letter differs: ``HSwish`` is not
``Swish``.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

MIN_SIMILARITY = 0.9  # of a misspelt name and the known one, as difflib computes it

# (names of a type, what it computes from x, the known layers that compute it, in order). A letter
# in an option is an option of the type, or a size. "with x": the bottoms are x and the top of the
# layer before.
EQUIVALENTS = (
    (
        "HSwish HardSwish",
        "x ReLU6(x + 3) / 6",
        "Power { shift: 3 }, ReLU6, Power { scale: 0.16666667 }, Eltwise { operation: PROD } with x",
    ),
    (
        "HSigmoid HardSigmoid",
        "min(max(a x + b, 0), 1), with a = 1/6 and b = 1/2 in PyTorch",
        "Power { scale: a shift: b }, Clip { min: 0 max: 1 }",
    ),
    ("Mish", "x tanh(ln(1 + exp(x)))", "BNLL, TanH, Eltwise { operation: PROD } with x"),
    ("SiLU", "x sigmoid(x)", "Swish"),
    ("SeLU", "scaled ELU", "ELU { alpha: 1.6732632 }, Power { scale: 1.050701 }"),
    (
        "CELU",
        "max(x, 0) + min(a (exp(x / a) - 1), 0)",
        "Power { scale: 1/a }, ELU, Power { scale: a }",
    ),
    ("SoftPlus", "ln(1 + exp(x))", "BNLL"),
    (
        "SoftSign",
        "x / (1 + |x|)",
        "AbsVal, Power { power: -1 shift: 1 }, Eltwise { operation: PROD } with x",
    ),
    ("LogSoftmax", "ln(softmax(x))", "Softmax, Log"),
    ("LogSigmoid", "ln(sigmoid(x))", "Power { scale: -1 }, BNLL, Power { scale: -1 }"),
    ("LeakyReLU", "max(x, 0) + a min(x, 0)", "ReLU { negative_slope: a }"),
    (
        "ThresholdedReLU",
        "x above a, else 0",
        "Threshold { threshold: a }, Eltwise { operation: PROD } with x",
    ),
    ("CReLU", "max(x, 0) and max(-x, 0) as channels", "Power { scale: -1 }, Concat with x, ReLU"),
    ("NegReLU", "min(x, 0)", "Power { scale: -1 }, ReLU, Power { scale: -1 }"),
    ("HardTanh", "min(max(x, -1), 1)", "Clip { min: -1 max: 1 }"),
    ("ReLU1", "min(max(x, 0), 1)", "Clip { min: 0 max: 1 }"),
    ("Clamp", "min(max(x, a), b)", "Clip { min: a max: b }"),
    ("Abs", "|x|", "AbsVal"),
    ("Square", "x^2", "Power { power: 2 }"),
    ("Sqrt", "x^(1/2)", "Power { power: 0.5 }"),
    ("Neg Negative", "-x", "Power { scale: -1 }"),
    ("Reciprocal", "1 / x", "Power { power: -1 }"),
    ("Tanhshrink", "x - tanh(x)", "TanH, Eltwise { coeff: 1 coeff: -1 } with x"),
    (
        "GlobalAveragePooling GlobalAvgPool AdaptiveAvgPool AdaptiveAvgPool2d",
        "the mean of each channel",
        "Pooling { pool: AVE global_pooling: true }",
    ),
    (
        "GlobalMaxPooling GlobalMaxPool AdaptiveMaxPool2d",
        "the maximum of each channel",
        "Pooling { pool: MAX global_pooling: true }",
    ),
    (
        "PixelShuffle",
        "s s channels as blocks of s x s pixels",
        "Reshape { shape { dim: 0 dim: C dim: s dim: s dim: H dim: W } }, "
        "Permute { order: 0 order: 1 order: 4 order: 2 order: 5 order: 3 }, "
        "Reshape { shape { dim: 0 dim: C dim: sH dim: sW } }",
    ),
    ("ChannelShuffle", "channels in another order", "ShuffleChannel { group: s }"),
    (
        "ChannelNorm",
        "the length of the vector of channels",
        "Power { power: 2 }, Convolution { num_output: 1 kernel_size: 1 bias_term: false weight_filler { value: 1 } }, "
        "Power { power: 0.5 }",
    ),
    (
        "L2Norm L2Normalize L2Normalization",
        "x divided by the length of its vector of channels",
        "Normalize { across_spatial: false }",
    ),
    ("Linear FullyConnected FC Dense Gemm", "W x + b", "InnerProduct { num_output: n }"),
    ("Conv Conv2d", "a convolution", "Convolution { num_output: n kernel_size: s }"),
    (
        "ConvTranspose ConvTranspose2d",
        "a transposed convolution",
        "Deconvolution { convolution_param: ... }",
    ),
    (
        "MaxPool MaxPool2d",
        "maxima of windows",
        "Pooling { pool: MAX kernel_size: s stride: s round_mode: FLOOR } (CEIL if the other program rounds up)",
    ),
    (
        "AvgPool AvgPool2d AveragePool",
        "means of windows",
        "Pooling { pool: AVE kernel_size: s stride: s round_mode: FLOOR } (CEIL if the other program rounds up)",
    ),
    (
        "BatchNorm1d BatchNorm2d BatchNormalization",
        "normalization by stored statistics, with a scale and a bias",
        "BatchNorm, Scale { bias_term: true }",
    ),
    ("Transpose", "another order of the axes", "Permute { order: ... }"),
    (
        "Squeeze Unsqueeze ExpandDims View",
        "the same numbers in another shape",
        "Reshape { shape { ... } }",
    ),
    ("Add Sum", "the sum of the bottoms", "Eltwise"),
    ("Sub", "the difference of two bottoms", "Eltwise { coeff: 1 coeff: -1 }"),
    ("Mul Multiply", "the product of bottoms of one shape", "Eltwise { operation: PROD }"),
    ("Cat Concatenate", "the bottoms side by side", "Concat"),
    ("Chunk", "parts of the channels", "Slice"),
    ("SoftmaxLoss", "the loss of a Softmax", "SoftmaxWithLoss"),
)

_BOTH = "HDF5Data reads arrays and labels of any shape from HDF5, and an Input layer takes arrays"
_SSD = "the training layers of SSD are not supported; its deploy nets are"
_YOLO = "the boxes of YOLO are computed outside the net; remove the layer"
_FACES = "a layer for the training of face descriptors; their deploy nets end before it"
_FLOW = "of FlowNet, which no layers here compute"
_EPS = (
    "MVN divides by the standard deviation + eps, others by sqrt(variance + eps), which is nearly the same if eps is "
    "small; a Scale { bias_term: true } follows"
)

# Names of types without an equivalent -> what they are, and what there is instead
UNSUPPORTED = {
    "DenseImageData": f"SegNet's and ENet's reader of images and label images; {_BOTH}",
    "ImageLabelmapData": f"HED's reader of images and label images; {_BOTH}",
    "ImageSegData": f"DeepLab's and PSPNet's reader of images and label images; {_BOTH}",
    "CPMData": f"OpenPose's reader of people and their joints; {_BOTH}",
    "WindowData": f"R-CNN's reader of windows of images (2014); {_BOTH}",
    "AnnotatedData MultiBoxLoss DetectionEvaluate": _SSD,
    "Yolov3DetectionOutput YoloDetectionOutput RegionYolo DetectionYolo": _YOLO,
    "RegionLoss Yolov3 GaussianYolov3 YoloSeg": "the loss of YOLO is not supported; a deploy net ends before it",
    "Reorg Passthrough ReorgYolo SpaceToDepth": "blocks of pixels become channels, in an order that programs differ "
    "about; Reshape, Permute and Reshape compute each of them",
    "DepthToSpace": "channels become blocks of pixels, in an order that programs differ about; Reshape, Permute and "
    "Reshape compute each of them",
    "MultiStageMeanfield MultiStageCRF": "the mean field of CRF-RNN, which no layers here compute; the net before it "
    "gives the scores that it refines",
    "DenseCRF": "the dense random field of DeepLab, which no layers here compute; the net before it gives the scores "
    "that it refines",
    "DomainTransform DomainTransformForwardOnly": "DeepLab's edge-preserving filter, which no layers here compute",
    "ContinuationIndicator": "crnn's markers of an LSTM, 0 in the first of T steps and 1 in the others; two DummyData "
    "layers of shape 1 x N with value 0 and T-1 x N with value 1, and a Concat { axis: 0 }, give them",
    "Lstm": "Lstm is junhyukoh's layer with one bottom of T N rows and other weights, LSTM is Caffe's",
    "BLSTM BiLSTM": "an LSTM in both directions; two LSTM layers, one on reversed steps, and a Concat",
    "GRU": "a recurrent layer that no layers here compute; RNN and LSTM are others",
    "CtcLoss WarpCTC WarpCTCLoss CTCGreedyDecoder CTCDecoder": "the loss and the decoding of label sequences "
    "are computed outside the net; a deploy net ends before it",
    "GELU": "x times the normal distribution's integral, which no layers here compute exactly; Swish { beta: 1.702 } "
    "differs by up to 0.02",
    "RReLU": "in phase TEST a ReLU whose negative_slope is the mean of lower and upper",
    "SpatialDropout ChannelDropout Dropout2d DropBlock DropPath": "in TEST it copies its bottom; remove the layer",
    "ROIAlign": "of Mask R-CNN; ROIPooling computes other values",
    "DeformableConvolution DeformablePSROIPooling DeformConv": "of deformable networks, which no layers here compute; "
    "Convolution and PSROIPooling compute other values",
    "Proposal": "the proposals of Faster R-CNN in C++; its Python layer rpn.proposal_layer computes them, too",
    "BoxAnnotatorOHEM SmoothL1LossOHEM SoftmaxWithLossOHEM": "the training layers of R-FCN are not supported; its "
    "deploy nets are",
    "Correlation Correlation1D FlowWarp Resample Downsample DataAugmentation FlowAugmentation": _FLOW,
    "MarginInnerProduct LargeMarginInnerProduct LargeMargin CenterLoss TripletLoss": _FACES,
    "LayerNorm LayerNormalization": f"over all channels and positions: MVN {{ across_channels: true }}; {_EPS}",
    "InstanceNorm InstanceNormalization InstanceNorm2d": f"over each channel: {_EPS}",
    "GroupNorm": "normalization of groups of channels: Reshape, MVN { across_channels: true }, Reshape and Scale",
    "ResizeBilinear BilinearInterpolation UpsamplingBilinear2d": "Interp, if the corners are aligned (align_corners)",
    "Resize UpsamplingNearest2d": "Upsample for nearest neighbours, Interp for bilinear with aligned corners",
    "AutoCrop": "a Crop that computes its offset; write it as Crop { offset: N }, with N by caffe.coord_map",
    "Padding Pad ZeroPad2d": "zeros around x are the option pad of the next Convolution or Pooling",
    "MatMul": "the product of two bottoms as matrices, which no layers here compute",
    "MKLBatchNorm": "Intel's BatchNorm; write BatchNorm",
}

# The ends of the names of types that are in no table -> what there is instead
ENDINGS = {
    "data": f"a reader of another program's files; {_BOTH}",
    "loss": "a loss of another program; a deploy net has none, and to train, a Python layer can compute it",
    "accuracy": "a score of another program; a deploy net has none",
    "evaluate": "a score of another program; a deploy net has none",
    "augmentation": "a layer for training of another program; a deploy net has none",
}


def _letters(name: str) -> str:
    """The name of a type as far as it identifies the type: ``hard-swish`` is ``HardSwish``."""
    return re.sub("[-_ ]", "", name.casefold())


def _advice_by_letters() -> dict[str, str]:
    """The two tables as one: the letters of each name -> advice."""
    advice = {names: f"{value}; write it as {layers}" for names, value, layers in EQUIVALENTS}
    advice |= UNSUPPORTED
    return {_letters(name): text for names, text in advice.items() for name in names.split()}


ADVICE = _advice_by_letters()


def type_advice(name: str, known: Iterable[str]) -> str:
    """Advice on an unknown layer type, in parentheses; empty if there is none.

    ``known`` are the types for which it may be a misspelling.
    """
    letters = _letters(name)
    if letters in ADVICE:
        return f" ({ADVICE[letters]})"
    known_by_letters = {_letters(known_name): known_name for known_name in known}
    for near in difflib.get_close_matches(letters, known_by_letters, n=3, cutoff=MIN_SIMILARITY):
        if _is_misspelling(letters, near):
            return f" (did you mean {known_by_letters[near]!r}?)"
    for ending, text in ENDINGS.items():
        if letters.endswith(ending):
            return f" ({text})"
    return ""


def v1_advice(name: str, v1_types: Iterable[str], known: Iterable[str]) -> str:
    """Advice on an unknown layer type in Caffe's older format, V1: as ``type_advice``, or that
    the current format has the type.
    """
    letters = _letters(name)
    if letters not in map(_letters, v1_types):
        for current in known:
            if _letters(current) == letters:
                return f' (the layer {current} needs the current format: layer {{ type: "{current}" ... }})'
    return type_advice(name, v1_types)


def _is_misspelling(name: str, known: str) -> bool:
    """Whether one letter of ``known`` is missing, doubled, wrong or in its neighbour's place.

    If only letters before or after it are added, or digits differ, the name is of another type.
    """
    if name.startswith(known) or name.endswith(known):
        return name == known
    removed = added = ""
    for kind, i, j, known_i, known_j in difflib.SequenceMatcher(None, name, known).get_opcodes():
        if kind != "equal":
            removed += name[i:j]
            added += known[known_i:known_j]
    if any(letter.isdigit() for letter in removed + added):
        return False
    return len(removed) <= 1 and len(added) <= 1
