"""Upgrade of nets in Caffe's older format V1 (2014) to the current one, for text and binary files.

    layers { type: CONVOLUTION blobs_lr: 1 blobs_lr: 2 weight_decay: 1 convolution_param { ... } }

The upgrade works on trees, so a mistake in an old file is reported at its position. Options that
Caffe drops are dropped here too, with the same note.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Literal

from netlib.errors import PrototxtError
from netlib.proto import scaled_batch_norm, schema
from netlib.proto.fork_types import v1_advice
from netlib.proto.messages import BlobProto, NetParameter, NetStateRule
from netlib.proto.options import layer_types
from netlib.proto.prototxt import Field, Message, Scalar, Unknown
from netlib.proto.schema import numbered

log = logging.getLogger("netlib")

# The enum of layer types, in the order of its numbers, with their current names
V1_TYPES = {
    "NONE": "",
    "ACCURACY": "Accuracy",
    "BNLL": "BNLL",
    "CONCAT": "Concat",
    "CONVOLUTION": "Convolution",
    "DATA": "Data",
    "DROPOUT": "Dropout",
    "EUCLIDEAN_LOSS": "EuclideanLoss",
    "FLATTEN": "Flatten",
    "HDF5_DATA": "HDF5Data",
    "HDF5_OUTPUT": "HDF5Output",
    "IM2COL": "Im2col",
    "IMAGE_DATA": "ImageData",
    "INFOGAIN_LOSS": "InfogainLoss",
    "INNER_PRODUCT": "InnerProduct",
    "LRN": "LRN",
    "MULTINOMIAL_LOGISTIC_LOSS": "MultinomialLogisticLoss",
    "POOLING": "Pooling",
    "RELU": "ReLU",
    "SIGMOID": "Sigmoid",
    "SOFTMAX": "Softmax",
    "SOFTMAX_LOSS": "SoftmaxWithLoss",
    "SPLIT": "Split",
    "TANH": "TanH",
    "WINDOW_DATA": "WindowData",
    "ELTWISE": "Eltwise",
    "POWER": "Power",
    "SIGMOID_CROSS_ENTROPY_LOSS": "SigmoidCrossEntropyLoss",
    "HINGE_LOSS": "HingeLoss",
    "MEMORY_DATA": "MemoryData",
    "ARGMAX": "ArgMax",
    "THRESHOLD": "Threshold",
    "DUMMY_DATA": "DummyData",
    "SLICE": "Slice",
    "MVN": "MVN",
    "ABSVAL": "AbsVal",
    "SILENCE": "Silence",
    "CONTRASTIVE_LOSS": "ContrastiveLoss",
    "EXP": "Exp",
    "DECONVOLUTION": "Deconvolution",
}
V1Type = Annotated[str, tuple(V1_TYPES)]  # an enum
_V1_WORDS = {("word", name) for name in V1_TYPES}
V1_BLOCKS = {  # numbers of the options blocks in a V1 layer
    "accuracy_param": 27,
    "argmax_param": 23,
    "concat_param": 9,
    "contrastive_loss_param": 40,
    "convolution_param": 10,
    "data_param": 11,
    "dropout_param": 12,
    "dummy_data_param": 26,
    "eltwise_param": 24,
    "exp_param": 41,
    "hdf5_data_param": 13,
    "hdf5_output_param": 14,
    "hinge_loss_param": 29,
    "image_data_param": 15,
    "infogain_loss_param": 16,
    "inner_product_param": 17,
    "lrn_param": 18,
    "memory_data_param": 22,
    "mvn_param": 34,
    "pooling_param": 19,
    "power_param": 21,
    "relu_param": 30,
    "sigmoid_param": 38,
    "softmax_param": 39,
    "slice_param": 31,
    "tanh_param": 37,
    "threshold_param": 25,
    "transform_param": 36,
    "loss_param": 42,
}
# V1 types -> the block with the options that are now in transform_param
TRANSFORMED = {"DATA": "data_param", "IMAGE_DATA": "image_data_param"}
MOVED = ("scale", "mean_file", "crop_size", "mirror")
V0_KEY = b"\x0a"  # of field 1, the V0 layer, in a binary file
# V1 fields with one value per parameter -> their current names in ``param { ... }``
PER_PARAMETER = {
    "param": "name",
    "blob_share_mode": "share_mode",
    "blobs_lr": "lr_mult",
    "weight_decay": "decay_mult",
}


@dataclass(frozen=True)
class V1LayerParameter:
    """A V1 layer (2014): types are an enum, rates and decays are lists."""

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
    """A net in either format, as stored in a file."""

    layers: tuple[V1LayerParameter, ...] = numbered(2, ())


def upgraded(net: Message) -> Message:
    """Convert the tree of a net to the current format. Raises PrototxtError if it is in neither."""
    old = net.named("layers")
    if old and net.named("layer"):
        raise PrototxtError(
            old[0].position,
            "this net has both 'layer' and 'layers' (Caffe's V1 format); expected one of them",
        )
    if not old:
        return Message(list(_with_scales(net)), net.position)
    fields = net.without("layers").fields
    for item in old:
        layer = schema.message_of(item)
        refuse_v0(layer)
        _check_type(layer)
        # reports mistakes at their positions
        typed = schema.read(layer, V1LayerParameter, "layers")
        fields.append(Field("layer", _layer(layer, typed.type), layer.position))
    return Message(fields, net.position)


def refuse_v0(layer: Message) -> None:
    """Raise PrototxtError for a layer of 2013: ``layers { layer { name: "conv1"
    type: "conv" } }``.
    """
    for item in layer.fields:
        value = item.value
        is_encoded_v0 = isinstance(value, Unknown) and value.encoded.startswith(V0_KEY)
        if item.name == "layer" or is_encoded_v0:
            raise PrototxtError(
                layer.position,
                "this net is in Caffe's format of 2013 (V0); convert it by Caffe 1.0's "
                "upgrade_net_proto_text or upgrade_net_proto_binary",
            )


def _check_type(layer: Message) -> None:
    """Raise PrototxtError if the type of a V1 layer is not a word of the format."""
    for value in layer.values("type"):
        if not isinstance(value, Scalar) or value.kind == "number":
            continue  # ``schema.read`` checks it
        if (value.kind, value.text) not in _V1_WORDS:
            advice = v1_advice(value.text, V1_TYPES, layer_types())
            all_known = f"; known values: {', '.join(V1_TYPES)}"
            raise schema.wrong_name(value, "type", advice or all_known)


# ------------------------------------------------------------------------------------- V1 → current


def _layer(old: Message, type_name: str) -> Message:
    """Convert a V1 layer of this type."""
    fields: list[Field] = []
    specs: dict[int, list[Field]] = {}  # by the number of the parameter
    seen = dict.fromkeys(PER_PARAMETER, 0)
    for item in old.fields:
        if isinstance(item.value, Unknown):
            # Its number means another field in the current format.
            log.warning(
                "%s: a field that is unknown in Caffe's older formats is dropped, as in Caffe",
                item.position,
            )
        elif item.name == "type":
            name = Scalar("string", V1_TYPES[type_name], item.position)
            fields.append(Field("type", name, item.position))
        elif item.name in PER_PARAMETER:
            spec = specs.setdefault(seen[item.name], [])
            spec.append(Field(PER_PARAMETER[item.name], item.value, item.position))
            seen[item.name] += 1
        elif item.name == TRANSFORMED.get(type_name):
            fields += _without_transform(item)
        else:
            fields.append(item)
    fields += [Field("param", Message(spec, old.position), old.position) for spec in specs.values()]
    return Message(fields, old.position)


def _without_transform(item: Field) -> list[Field]:
    """A data_param without scale, mean, crop and mirror, and a transform_param with them."""
    options = schema.message_of(item)
    place = item.position
    moved = options.named(*MOVED)
    fields = [Field(item.name, options.without(*MOVED), place)]
    if moved:
        fields.append(Field("transform_param", Message(moved, options.position), place))
    return fields


def _with_scales(net: Message) -> Iterator[Field]:
    """The fields of a net, with a Scale after each BatchNorm that has a scale of its own
    (scaled_batch_norm.py).
    """
    names = [v.text("name") for v in net.values("layer") if isinstance(v, Message)]
    for item in net.fields:
        if item.name == "layer" and isinstance(item.value, Message):
            for layer in scaled_batch_norm.separated(item.value, names):
                yield Field("layer", _with_fixed_statistics(layer), item.position)
        else:
            yield item


def _with_fixed_statistics(layer: Message) -> Message:
    """Freeze the three parameters that older nets declare for BatchNorm: they are
    statistics, not weights.
    """
    if layer.text("type") != "BatchNorm" or len(layer.values("param")) != 3:
        return layer
    zero = Scalar("number", "0", layer.position)
    frozen = [Field(name, zero, layer.position) for name in ("lr_mult", "decay_mult")]
    fields = []
    for item in layer.fields:
        if item.name == "param" and isinstance(item.value, Message):
            rates = item.value.without("lr_mult", "decay_mult")
            rates.fields.extend(frozen)
            item = Field("param", rates, item.position)
        fields.append(item)
    return Message(fields, layer.position)
