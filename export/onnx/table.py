"""Table of layer types and the functions that add their ONNX operators, in modules named like the folders of layers/.

A function takes the graph and the layer's Place and returns the names of the tops' values. A layer without effect
returns the values of its bottoms. Options and formulas are documented in the layer's file in layers/; comments note
where ONNX's operators differ from Caffe's.
"""

from __future__ import annotations

from export.onnx import activation, common, detection, hand, normalization, vision
from export.onnx.graph import Translation

LAYERS: dict[str, Translation] = {
    "AbsVal": activation.of_each("Abs"),
    "ArgMax": common.arg_max,
    "Axpy": common.axpy,
    "BN": normalization.bn,
    "BNLL": activation.of_each("Softplus"),
    "BatchNorm": normalization.batch_norm,
    "BatchReindex": common.batch_reindex,
    "Bias": activation.bias,
    "Clip": activation.clip,
    "Concat": common.concat,
    "Convolution": vision.convolution,
    "ConvolutionDepthwise": vision.convolution,
    "Crop": vision.crop,
    "Deconvolution": vision.deconvolution,
    "DeepHandModel": hand.hand_model,  # name in the released system
    "DetectionOutput": detection.detection_output,
    "DepthwiseConvolution": vision.convolution,
    "Dropout": common.dropout,
    "ELU": activation.elu,
    "Eltwise": common.eltwise,
    "Embed": common.embed,
    "Exp": activation.exp,
    "Flatten": common.shaped_as_top,
    "HandModel": hand.hand_model,
    "InnerProduct": common.inner_product,
    "Input": common.nothing,  # inputs are part of the graph
    "Interp": vision.interp,
    "LRN": normalization.lrn,
    "Log": activation.log,
    "MVN": normalization.mvn,
    "Normalize": normalization.normalize,
    "PReLU": activation.prelu,
    "Parameter": common.parameter,
    "Permute": common.permute,
    "Pooling": vision.pooling,
    "Power": activation.power,
    "PriorBox": detection.prior_box,
    "ReLU": activation.relu,
    "ReLU6": activation.relu6,
    "Reduction": common.reduction,
    "Reshape": common.shaped_as_top,
    "SPP": vision.spp,
    "Scale": activation.scale,
    "ShuffleChannel": common.shuffle_channel,
    "Sigmoid": activation.of_each("Sigmoid"),
    "Silence": common.nothing,
    "Slice": common.slice,
    "Softmax": common.softmax,
    "Split": common.same,
    "Swish": activation.swish,
    "TanH": activation.of_each("Tanh"),
    "Threshold": activation.threshold,
    "Tile": common.tile,
    "Upsample": vision.upsample,
}
