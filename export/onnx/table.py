"""One table: layer type → the function that adds its ONNX operators. They stand in rooms as those of layers/ do.

Such a function gets the graph and the layer at its place, and returns the names of the values that the tops are. A
layer that changes nothing returns the values of its bottoms. Options and formulas are those of the layer's own file in
layers/; a comment says where ONNX's operator differs from Caffe's.
"""

from __future__ import annotations

from export.onnx import activation, common, hand, normalization, vision
from export.onnx.graph import Translation

LAYERS: dict[str, Translation] = {
    "AbsVal": activation.of_each("Abs"),
    "ArgMax": common.arg_max,
    "Axpy": common.axpy,
    "BNLL": activation.of_each("Softplus"),
    "BatchNorm": normalization.batch_norm,
    "BatchReindex": common.batch_reindex,
    "Bias": activation.bias,
    "Clip": activation.clip,
    "Concat": common.concat,
    "Convolution": vision.convolution,
    "Crop": vision.crop,
    "Deconvolution": vision.deconvolution,
    "DeepHandModel": hand.hand_model,  # the released system's name
    "Dropout": common.dropout,
    "ELU": activation.elu,
    "Eltwise": common.eltwise,
    "Embed": common.embed,
    "Exp": activation.exp,
    "Flatten": common.shaped_as_top,
    "HandModel": hand.hand_model,
    "InnerProduct": common.inner_product,
    "Input": common.nothing,  # inputs are the graph's own
    "LRN": normalization.lrn,
    "Log": activation.log,
    "MVN": normalization.mvn,
    "PReLU": activation.prelu,
    "Parameter": common.parameter,
    "Pooling": vision.pooling,
    "Power": activation.power,
    "ReLU": activation.relu,
    "Reduction": common.reduction,
    "Reshape": common.shaped_as_top,
    "SPP": vision.spp,
    "Scale": activation.scale,
    "Sigmoid": activation.of_each("Sigmoid"),
    "Silence": common.nothing,
    "Slice": common.slice,
    "Softmax": common.softmax,
    "Split": common.same,
    "Swish": activation.swish,
    "TanH": activation.of_each("Tanh"),
    "Threshold": activation.threshold,
    "Tile": common.tile,
}
