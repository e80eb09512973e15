"""caffe.proto.caffe_pb2: all of Caffe's messages and enums, as classes of the package protobuf.

There is no caffe.proto and no generated code: the file descriptor is built on import from the
dataclasses that read and write the files of this project (netlib/proto/messages.py,
netlib/proto/upgrade.py, and the options of the layer types), so names, numbers, types and defaults
are declared once. This module adds the names of the enums, the classes of SSD's detectors (ssd.py),
and what scripts of other forks write (forks.py).
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from netlib.caffe.proto import forks, ssd
from netlib.errors import NetlibError
from netlib.fillers import Filler
from netlib.proto import messages, schema, upgrade, wire
from netlib.proto.options import option_blocks


class MissingProtobufError(NetlibError, ImportError):
    """The package protobuf is not installed."""


try:
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from google.protobuf.internal.enum_type_wrapper import EnumTypeWrapper
except ImportError as error:
    raise MissingProtobufError(
        "caffe.proto and NetSpec need the package protobuf: pip install 'protobuf>=4.25'; Net, the solvers, Classifier "
        "and the images of caffe.io work without it"
    ) from error


# Names of Caffe's enums: message -> field -> enum
_ENUMS = {
    "PoolingParameter": {"pool": "PoolMethod", "round_mode": "RoundMode"},
    "SPPParameter": {"pool": "PoolMethod"},
    "LRNParameter": {"norm_region": "NormRegion"},
    "EltwiseParameter": {"operation": "EltwiseOp"},
    "ReductionParameter": {"operation": "ReductionOp"},
    "DataParameter": {"backend": "DB"},
    "FillerParameter": {"variance_norm": "VarianceNorm"},
    "HingeLossParameter": {"norm": "Norm"},
    "LossParameter": {"normalization": "NormalizationMode"},
    "ParamSpec": {"share_mode": "DimCheckMode"},
    "SolverParameter": {
        "snapshot_format": "SnapshotFormat",
        "solver_mode": "SolverMode",
        "solver_type": "SolverType",
    },
    "V1LayerParameter": {"type": "LayerType", "blob_share_mode": "DimCheckMode"},
    "BlobProto": {"raw_data_type": "Type"},
    "ResizeParameter": {
        "resize_mode": "Resize_mode",
        "pad_mode": "Pad_mode",
        "interp_mode": "Interp_mode",
    },
}
# enums that are inside another message
_OWNERS = {("DetectionOutputParameter", "code_type"): "PriorBoxParameter"}
# Defaults in caffe.proto that the dataclass does not have, because there None stands for an option
# that is not given
_DEFAULTS = {
    ("ConcatParameter", "concat_dim"): 1,
    ("SliceParameter", "slice_dim"): 1,
    ("SolverParameter", "solver_mode"): "GPU",
}
_NAMES = {
    Filler: "FillerParameter",
    upgrade.AnyNetParameter: "NetParameter",
    messages.NetParameter: "NetParameter",
}
_PACKAGE = "caffe"
_TYPES = {
    float: "FLOAT",
    schema.Double: "DOUBLE",
    schema.Floats: "FLOAT",
    schema.Doubles: "DOUBLE",
    int: "INT32",
    schema.Natural: "INT32",
    schema.UInt: "UINT32",
    schema.Int64: "INT64",
    bool: "BOOL",
    str: "STRING",
    bytes: "BYTES",
}
_MESSAGES = [
    messages.BlobShape,
    messages.BlobProto,
    messages.BlobProtoVector,
    messages.Datum,
    Filler,
    upgrade.AnyNetParameter,
    messages.SolverParameter,
    messages.SolverState,
    messages.NetState,
    messages.NetStateRule,
    messages.ParamSpec,
    messages.LayerParameter,
    upgrade.V1LayerParameter,
    ssd.LabelMap,
]


def file_descriptor() -> Any:
    """The FileDescriptorProto of all messages, as protoc would compile it from caffe.proto."""
    file = descriptor_pb2.FileDescriptorProto(name="caffe.proto", package=_PACKAGE, syntax="proto2")
    _add_enum(file, "Phase", schema.enum_of(schema.Phase))
    classes: list[type] = [*_MESSAGES, *option_blocks().values()]
    known: dict[str, type] = {}
    for cls in classes:  # grows by the messages inside messages
        if _name_of(cls) not in known:
            known[_name_of(cls)] = cls
            classes += [
                field.kind
                for field in wire.fields_of(cls).values()
                if schema.is_message(field.kind)
            ]
    described = {name: file.message_type.add(name=name) for name in known}
    for name, cls in known.items():
        _describe(described, name, cls)
    forks.add_to(file)
    return file


def _name_of(cls: type) -> str:
    return _NAMES.get(cls, cls.__name__)


def _describe(described: dict[str, Any], name: str, cls: type) -> None:
    """Describe the message that a dataclass reads; enums are defined inside it, as in
    caffe.proto, except Phase.
    """
    message = described[name]
    for known in wire.fields_of(cls).values():
        field = message.field.add(name=known.name, number=known.number)
        field.label = field.LABEL_REPEATED if known.repeated else field.LABEL_OPTIONAL
        if known.packed:
            field.options.packed = True
        if schema.is_message(known.kind):
            field.type = field.TYPE_MESSAGE
            field.type_name = f".{_PACKAGE}.{_name_of(known.kind)}"
            continue
        if values := schema.enum_of(known.kind):
            owner = described[_OWNERS.get((name, known.name), name)]
            field.type = field.TYPE_ENUM
            field.type_name = _enum_type(owner, known.name, known.kind, values)
        else:
            field.type = getattr(field, f"TYPE_{_TYPES[known.kind]}")
        default = _DEFAULTS.get((name, known.name), known.default)
        if not known.repeated and default not in (None, dataclasses.MISSING, "", b""):
            text = str(default)
            field.default_value = text.lower() if isinstance(default, bool) else text


def _enum_type(message: Any, field: str, kind: Any, values: dict[str, int]) -> str:
    """Full name of the enum of a field, which is added to the message at its first use."""
    if kind == schema.Phase:
        return f".{_PACKAGE}.Phase"
    usual = "Engine" if field == "engine" else field.title().replace("_", "")
    name = _ENUMS.get(message.name, {}).get(field, usual)
    if name not in (enum.name for enum in message.enum_type):
        _add_enum(message, name, values)
    return f".{_PACKAGE}.{message.name}.{name}"


def _add_enum(parent: Any, name: str, values: dict[str, int]) -> None:
    enum = parent.enum_type.add(name=name)
    for value, number in values.items():
        enum.value.add(name=value, number=number)


def _classes() -> dict[str, Any]:
    """The names that protoc's generated module would define.

    The pool of descriptors is our own, so that another caffe_pb2 can be imported in
    the same process.
    """
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file_descriptor())
    file = pool.FindFileByName("caffe.proto")
    names: dict[str, Any] = {"DESCRIPTOR": file}
    for name, enum in file.enum_types_by_name.items():
        names |= {name: EnumTypeWrapper(enum), f"_{name.upper()}": enum}
        names |= {value.name: value.number for value in enum.values}
    for name, message in file.message_types_by_name.items():
        cls = names[name] = message_factory.GetMessageClass(message)
        cls.__module__ = __name__  # for pickle
        descriptor = f"_{name.upper()}"
        names[descriptor] = message
        for inner, enum in message.enum_types_by_name.items():
            names[f"{descriptor}_{inner.upper()}"] = enum
    return names


globals().update(_classes())

if TYPE_CHECKING:

    def __getattr__(name: str) -> Any: ...
