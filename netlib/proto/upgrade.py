"""Upgrade of nets in Caffe's two older formats to the current one, for text and binary files.

    V1  layers { type: CONVOLUTION blobs_lr: 1 blobs_lr: 2 weight_decay: 1 convolution_param { ... } }       (2014)
    V0  layers { layer { name: "conv1" type: "conv" num_output: 20 kernelsize: 5 } bottom: "data" top: "conv1" }  (2013)

The upgrade works on trees, so a mistake in an old file is reported at its position. Options that Caffe drops are
dropped here too, with the same note.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from netlib.errors import PrototxtError, did_you_mean
from netlib.proto import schema
from netlib.proto.messages import BlobProto, Filler, NetParameter, NetStateRule
from netlib.proto.options import option_blocks
from netlib.proto.prototxt import Field, Message, Scalar, Unknown
from netlib.proto.schema import UInt, numbered

log = logging.getLogger("netlib")

# The enum of layer types, in the order of its numbers, with their current names
V1_TYPES = {
    "NONE": "", "ACCURACY": "Accuracy", "BNLL": "BNLL", "CONCAT": "Concat", "CONVOLUTION": "Convolution",
    "DATA": "Data", "DROPOUT": "Dropout", "EUCLIDEAN_LOSS": "EuclideanLoss", "FLATTEN": "Flatten",
    "HDF5_DATA": "HDF5Data", "HDF5_OUTPUT": "HDF5Output", "IM2COL": "Im2col", "IMAGE_DATA": "ImageData",
    "INFOGAIN_LOSS": "InfogainLoss", "INNER_PRODUCT": "InnerProduct", "LRN": "LRN",
    "MULTINOMIAL_LOGISTIC_LOSS": "MultinomialLogisticLoss", "POOLING": "Pooling", "RELU": "ReLU",
    "SIGMOID": "Sigmoid", "SOFTMAX": "Softmax", "SOFTMAX_LOSS": "SoftmaxWithLoss", "SPLIT": "Split", "TANH": "TanH",
    "WINDOW_DATA": "WindowData", "ELTWISE": "Eltwise", "POWER": "Power",
    "SIGMOID_CROSS_ENTROPY_LOSS": "SigmoidCrossEntropyLoss", "HINGE_LOSS": "HingeLoss", "MEMORY_DATA": "MemoryData",
    "ARGMAX": "ArgMax", "THRESHOLD": "Threshold", "DUMMY_DATA": "DummyData", "SLICE": "Slice", "MVN": "MVN",
    "ABSVAL": "AbsVal", "SILENCE": "Silence", "CONTRASTIVE_LOSS": "ContrastiveLoss", "EXP": "Exp",
    "DECONVOLUTION": "Deconvolution",
}
V1Type = Annotated[str, tuple(V1_TYPES)]  # an enum
V1_BLOCKS = {  # numbers of the options blocks in a V1 layer
    "accuracy_param": 27, "argmax_param": 23, "concat_param": 9, "contrastive_loss_param": 40, "convolution_param": 10,
    "data_param": 11, "dropout_param": 12, "dummy_data_param": 26, "eltwise_param": 24, "exp_param": 41,
    "hdf5_data_param": 13, "hdf5_output_param": 14, "hinge_loss_param": 29, "image_data_param": 15,
    "infogain_loss_param": 16, "inner_product_param": 17, "lrn_param": 18, "memory_data_param": 22, "mvn_param": 34,
    "pooling_param": 19, "power_param": 21, "relu_param": 30, "sigmoid_param": 38, "softmax_param": 39,
    "slice_param": 31, "tanh_param": 37, "threshold_param": 25, "window_data_param": 20, "transform_param": 36,
    "loss_param": 42,
}
V0_TYPES = {  # V0 type -> V1 type
    "accuracy": "ACCURACY", "bnll": "BNLL", "concat": "CONCAT", "conv": "CONVOLUTION", "data": "DATA",
    "dropout": "DROPOUT", "euclidean_loss": "EUCLIDEAN_LOSS", "flatten": "FLATTEN", "hdf5_data": "HDF5_DATA",
    "hdf5_output": "HDF5_OUTPUT", "im2col": "IM2COL", "images": "IMAGE_DATA", "infogain_loss": "INFOGAIN_LOSS",
    "innerproduct": "INNER_PRODUCT", "lrn": "LRN", "multinomial_logistic_loss": "MULTINOMIAL_LOGISTIC_LOSS",
    "pool": "POOLING", "relu": "RELU", "sigmoid": "SIGMOID", "softmax": "SOFTMAX", "softmax_loss": "SOFTMAX_LOSS",
    "split": "SPLIT", "tanh": "TANH", "window_data": "WINDOW_DATA",
}
V0_BLOCKS = {  # V0 type -> its options block
    "conv": "convolution_param", "innerproduct": "inner_product_param", "pool": "pooling_param", "lrn": "lrn_param",
    "dropout": "dropout_param", "concat": "concat_param", "data": "data_param", "images": "image_data_param",
    "hdf5_data": "hdf5_data_param", "window_data": "window_data_param", "infogain_loss": "infogain_loss_param",
}
V0_RENAMED = {  # V0 option -> its name in the block
    "biasterm": "bias_term", "kernelsize": "kernel_size", "batchsize": "batch_size", "shuffle_images": "shuffle",
    "det_fg_threshold": "fg_threshold", "det_bg_threshold": "bg_threshold", "det_fg_fraction": "fg_fraction",
    "det_context_pad": "context_pad", "det_crop_mode": "crop_mode",
}
# V0 option -> its name in transform_param
V0_TRANSFORM = {"scale": "scale", "meanfile": "mean_file", "cropsize": "crop_size", "mirror": "mirror"}
V0_LAYER = {"name", "blobs", "blobs_lr", "weight_decay", "hdf5_output_param"}  # fields that are the same in V1
# V1 types -> the block with the options that are now in transform_param
TRANSFORMED = {"DATA": "data_param", "IMAGE_DATA": "image_data_param", "WINDOW_DATA": "window_data_param"}
# V1 fields with one value per parameter -> their current names in ``param { ... }``
PER_PARAMETER = {"param": "name", "blob_share_mode": "share_mode", "blobs_lr": "lr_mult", "weight_decay": "decay_mult"}


@dataclass(frozen=True)
class V0LayerParameter:
    """A V0 layer (2013), with the options of all types together."""

    name: str = numbered(1, "")
    type: str = numbered(2, "")
    num_output: UInt = numbered(3, 0)
    biasterm: bool = numbered(4, True)
    weight_filler: Filler = numbered(5, Filler())
    bias_filler: Filler = numbered(6, Filler())
    pad: UInt = numbered(7, 0)
    kernelsize: UInt = numbered(8, 0)
    group: UInt = numbered(9, 1)
    stride: UInt = numbered(10, 1)
    pool: Literal["MAX", "AVE", "STOCHASTIC"] = numbered(11, "MAX")
    dropout_ratio: float = numbered(12, 0.5)
    local_size: UInt = numbered(13, 5)
    alpha: float = numbered(14, 1.0)
    beta: float = numbered(15, 0.75)
    k: float = numbered(22, 1.0)
    source: str = numbered(16, "")
    scale: float = numbered(17, 1.0)
    meanfile: str = numbered(18, "")
    batchsize: UInt = numbered(19, 0)
    cropsize: UInt = numbered(20, 0)
    mirror: bool = numbered(21, False)
    blobs: tuple[BlobProto, ...] = numbered(50, ())
    blobs_lr: tuple[float, ...] = numbered(51, ())
    weight_decay: tuple[float, ...] = numbered(52, ())
    rand_skip: UInt = numbered(53, 0)
    det_fg_threshold: float = numbered(54, 0.5)
    det_bg_threshold: float = numbered(55, 0.5)
    det_fg_fraction: float = numbered(56, 0.25)
    det_context_pad: UInt = numbered(58, 0)
    det_crop_mode: str = numbered(59, "warp")
    new_num: int = numbered(60, 0)
    new_channels: int = numbered(61, 0)
    new_height: int = numbered(62, 0)
    new_width: int = numbered(63, 0)
    shuffle_images: bool = numbered(64, False)
    concat_dim: UInt = numbered(65, 1)
    blocks: dict[str, Message] = field(default_factory=dict, metadata={"numbers": {"hdf5_output_param": 1001}})


@dataclass(frozen=True)
class V1LayerParameter:
    """A V1 layer (2014): types are an enum, rates and decays are lists."""

    layer: V0LayerParameter | None = numbered(1, None)  # a V0 layer, in place of all fields but bottom and top
    bottom: tuple[str, ...] = numbered(2, ())
    top: tuple[str, ...] = numbered(3, ())
    name: str = numbered(4, "")
    type: V1Type = numbered(5, "NONE")
    blobs: tuple[BlobProto, ...] = numbered(6, ())
    blobs_lr: tuple[float, ...] = numbered(7, ())
    weight_decay: tuple[float, ...] = numbered(8, ())
    include: tuple[NetStateRule, ...] = numbered(32, ())
    exclude: tuple[NetStateRule, ...] = numbered(33, ())
    loss_weight: tuple[float, ...] = numbered(35, ())
    param: tuple[str, ...] = numbered(1001, ())  # names of shared parameters
    blob_share_mode: tuple[Literal["STRICT", "PERMISSIVE"], ...] = numbered(1002, ())
    blocks: dict[str, Message] = field(default_factory=dict, metadata={"numbers": V1_BLOCKS})


@dataclass(frozen=True)
class AnyNetParameter(NetParameter):
    """A net in any of the three formats, as stored in a file."""

    layers: tuple[V1LayerParameter, ...] = numbered(2, ())


def upgraded(net: Message) -> Message:
    """Convert the tree of a net to the current format. Raises PrototxtError if it is in none of the three."""
    old = [item for item in net.fields if item.name == "layers"]
    new = [item for item in net.fields if item.name == "layer"]
    if old and new:
        raise PrototxtError(old[0].position, "this net has both 'layer' and 'layers' (Caffe's V1 format); "
                                             "expected one of them")
    if not old:
        return Message([_with_fixed_statistics(item) for item in net.fields], net.position)
    layers = [schema.message_of(item) for item in old]
    for layer in layers:
        schema.read(layer, V1LayerParameter, "layers")  # reports every mistake at its position
    if any(layer.values("layer") for layer in layers):
        layers = [_v1_layer(layer) for layer in _without_padding(layers)]
    rest = [item for item in net.fields if item.name != "layers"]
    return Message([*rest, *(Field("layer", _layer(layer), layer.position) for layer in layers)], net.position)


# ---------------------------------------------------------------------------------------------- V1 → current


def _layer(old: Message) -> Message:
    """Convert a V1 layer."""
    type_name = ["NONE", *(_enum_name(v) for v in old.values("type"))][-1]
    old = _with_transform(old, TRANSFORMED.get(type_name))
    fields: list[Field] = []
    specs: list[list[Field]] = []  # one per parameter
    seen = dict.fromkeys(PER_PARAMETER, 0)
    for item in old.fields:
        if isinstance(item.value, Unknown):
            _warn_of_dropped(item)
        elif item.name == "type":
            fields.append(Field("type", Scalar("string", V1_TYPES[type_name], item.position), item.position))
        elif item.name in PER_PARAMETER:
            index = seen[item.name]
            seen[item.name] += 1
            while len(specs) <= index:
                specs.append([])
            specs[index].append(Field(PER_PARAMETER[item.name], item.value, item.position))
        else:
            fields.append(item)
    fields += [Field("param", Message(spec, old.position), old.position) for spec in specs]
    return Message(fields, old.position)


def _warn_of_dropped(item: Field) -> None:
    """Warn of a field of a fork: its number means another field in the current format."""
    log.warning("%s: a field that is unknown in Caffe's older formats is dropped, as in Caffe", item.position)


def _enum_name(value: Any) -> str:
    name: str = schema.scalar_value(value, V1Type)
    return name


def _with_transform(old: Message, block: str | None) -> Message:
    """Move scale, mean, crop and mirror from data_param to transform_param."""
    if block is None:
        return old
    moved: list[Field] = []
    fields: list[Field] = []
    for item in old.fields:
        if item.name == block and isinstance(item.value, Message):
            moved += [f for f in item.value.fields if f.name in V0_TRANSFORM.values()]
            stay = [f for f in item.value.fields if f.name not in V0_TRANSFORM.values()]
            item = Field(item.name, Message(stay, item.value.position), item.position)
        fields.append(item)
    return Message([*fields, *_block("transform_param", moved, old)], old.position)


def _block(name: str, options: list[Field], layer: Message) -> list[Field]:
    return [Field(name, Message(options, layer.position), layer.position)] if options else []


def _with_fixed_statistics(item: Field) -> Field:
    """Freeze the three parameters that older nets declare for BatchNorm: they are statistics, not weights."""
    layer = item.value
    if item.name != "layer" or not isinstance(layer, Message) or _text(layer, "type") != "BatchNorm":
        return item
    if len(layer.values("param")) != 3:
        return item
    zero = Scalar("number", "0", layer.position)
    frozen = [Field(name, zero, layer.position) for name in ("lr_mult", "decay_mult")]
    fields = []
    for one in layer.fields:
        if one.name == "param" and isinstance(one.value, Message):
            others = [f for f in one.value.fields if f.name not in ("lr_mult", "decay_mult")]
            one = Field("param", Message([*others, *frozen], one.value.position), one.position)
        fields.append(one)
    return Field("layer", Message(fields, layer.position), item.position)


def _text(message: Message, name: str) -> str:
    """The last value of a string field; empty if there is none."""
    return next((v.text for v in reversed(message.values(name)) if isinstance(v, Scalar)), "")


# ---------------------------------------------------------------------------------------------- V0 → V1


def _inner(connection: Message) -> Message:
    """The V0 layer inside a connection."""
    return next((v for v in connection.values("layer") if isinstance(v, Message)), Message([], connection.position))


def _without_padding(connections: Iterable[Message]) -> list[Message]:
    """Replace padding layers by the option ``pad`` of the convolution or pooling that reads them."""
    padding: dict[str, tuple[str, Field | None]] = {}  # padded blob -> (original blob, padding)
    result = []
    for connection in connections:
        inner, kind = _inner(connection), _text(_inner(connection), "type")
        bottoms, tops = ([v.text for v in connection.values(w) if isinstance(v, Scalar)] for w in ("bottom", "top"))
        if kind == "padding":
            if len(bottoms) != 1 or len(tops) != 1:
                raise PrototxtError(connection.position, "a padding layer has one bottom and one top")
            padding[tops[0]] = (bottoms[0], next((f for f in inner.fields if f.name == "pad"), None))
            continue
        read = [name for name in bottoms if name in padding]
        if read and (kind not in ("conv", "pool") or len(bottoms) != 1):
            raise PrototxtError(connection.position, f"a layer of type {kind!r} reads {read[0]!r} of a padding layer; "
                                                     "expected a conv or pool layer with one bottom")
        result.append(_padded(connection, *padding[read[0]]) if read else connection)
        for name in tops:  # a blob that is overwritten is no longer the padded one
            padding.pop(name, None)
    return result


def _padded(connection: Message, below: str, pad: Field | None) -> Message:
    """Make a layer read ``below`` and pad it itself."""
    fields = []
    for item in connection.fields:
        if item.name == "layer":
            inner = _inner(connection)
            own = [f for f in inner.fields if f.name != "pad"]
            item = Field("layer", Message([*own, *([pad] if pad else [])], inner.position), item.position)
        elif item.name == "bottom":
            item = Field("bottom", Scalar("string", below, item.position), item.position)
        fields.append(item)
    return Message(fields, connection.position)


def _v1_layer(connection: Message) -> Message:
    """Convert a V0 layer to a V1 layer."""
    inner = _inner(connection)
    kind = _text(inner, "type")
    if kind not in V0_TYPES:
        raise PrototxtError(inner.position, f"unknown V0 layer type {kind!r}{did_you_mean(kind, V0_TYPES)}")
    fields = [item for item in connection.fields if item.name in ("bottom", "top")]
    for item in connection.unknown():
        _warn_of_dropped(item)
    fields.append(Field("type", Scalar("word", V0_TYPES[kind], inner.position), inner.position))
    block, blocks = V0_BLOCKS.get(kind, ""), option_blocks()
    options = schema.hints_of(blocks[block]) if block in blocks else {}
    own: list[Field] = []
    transform: list[Field] = []
    for item in inner.fields:
        name = V0_RENAMED.get(item.name, item.name)
        if item.name in V0_LAYER:
            fields.append(item)
        elif item.name in V0_TRANSFORM:
            transform.append(Field(V0_TRANSFORM[item.name], item.value, item.position))
        elif name in options:
            own.append(Field(name, item.value, item.position))
        elif isinstance(item.value, Unknown):
            _warn_of_dropped(item)
        elif item.name != "type":
            log.warning("%s: %r does not apply to a layer of type %r; dropped", item.position, item.name, kind)
    return Message([*fields, *_block(block, own, inner), *_block("transform_param", transform, inner)], inner.position)
