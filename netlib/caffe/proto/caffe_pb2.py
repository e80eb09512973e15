"""caffe.proto.caffe_pb2: all of Caffe's messages and enums, with the interface of protobuf's generated classes.

Fields are declared where they are read: in netlib/proto/messages.py, netlib/proto/upgrade.py, and for the options of a
layer type in its file. This module adds the names of messages and enums, which only this interface needs.
"""

from __future__ import annotations

import functools
from typing import Any

from netlib.caffe.proto.descriptor import EnumType
from netlib.caffe.proto.message import Message, make_class
from netlib.fillers import Filler
from netlib.proto import messages, schema, upgrade
from netlib.proto.options import option_blocks

# Names of Caffe's enums: message -> field -> enum
_ENUMS = {
    "PoolingParameter": {"pool": "PoolMethod", "round_mode": "RoundMode"}, "SPPParameter": {"pool": "PoolMethod"},
    "LRNParameter": {"norm_region": "NormRegion"}, "EltwiseParameter": {"operation": "EltwiseOp"},
    "ReductionParameter": {"operation": "ReductionOp"}, "DataParameter": {"backend": "DB"},
    "FillerParameter": {"variance_norm": "VarianceNorm"}, "HingeLossParameter": {"norm": "Norm"},
    "LossParameter": {"normalization": "NormalizationMode"}, "ParamSpec": {"share_mode": "DimCheckMode"},
    "SolverParameter": {"snapshot_format": "SnapshotFormat", "solver_mode": "SolverMode", "solver_type": "SolverType"},
    "V1LayerParameter": {"type": "LayerType", "blob_share_mode": "DimCheckMode"},
    "V0LayerParameter": {"pool": "PoolMethod"},
}  # fmt: skip
_NAMES = {Filler: "FillerParameter", upgrade.AnyNetParameter: "NetParameter"}

Phase = EnumType("Phase", schema.enum_of(schema.Phase))
TRAIN, TEST = Phase.TRAIN, Phase.TEST


@functools.cache
def _class_of(cls: Any) -> type[Message]:
    """The message class of a dataclass."""
    if cls is messages.NetParameter:  # one class for nets in all formats
        return _class_of(upgrade.AnyNetParameter)
    name = _NAMES.get(cls, cls.__name__)
    enums = {"engine": "Engine", "phase": "Phase", **_ENUMS.get(name, {})}
    made: type[Message] = make_class(cls, name, enums, _class_of)
    return made


BlobShape: Any = _class_of(messages.BlobShape)
BlobProto: Any = _class_of(messages.BlobProto)
BlobProtoVector: Any = _class_of(messages.BlobProtoVector)
Datum: Any = _class_of(messages.Datum)
FillerParameter: Any = _class_of(Filler)
NetParameter: Any = _class_of(upgrade.AnyNetParameter)
SolverParameter: Any = _class_of(messages.SolverParameter)
SolverState: Any = _class_of(messages.SolverState)
NetState: Any = _class_of(messages.NetState)
NetStateRule: Any = _class_of(messages.NetStateRule)
ParamSpec: Any = _class_of(messages.ParamSpec)
LayerParameter: Any = _class_of(messages.LayerParameter)
V0LayerParameter: Any = _class_of(upgrade.V0LayerParameter)
V1LayerParameter: Any = _class_of(upgrade.V1LayerParameter)

# ConvolutionParameter, PoolingParameter ...: the options of all supported layer types
globals().update({cls.__name__: _class_of(cls) for cls in option_blocks().values()})
