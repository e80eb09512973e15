"""Weights and solver states in Caffe's binary format.

    .caffemodel     a NetParameter: every layer as the net runs it, with its parameters in ``blobs``
    .solverstate    a SolverState; its field ``netlib`` is ours, JSON: what an exact resume needs. Caffe skips it

Weights of Caffe's older formats are read as well (netlib/proto/upgrade.py).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from typing import TypeVar

from netlib.blob import Array
from netlib.errors import NetlibError, WeightsError, reason_of
from netlib.proto import binaryproto, messages, schema, wire
from netlib.proto.messages import LayerParameter
from netlib.proto.net_parameter import distinct
from netlib.proto.prototxt import Field, Message
from netlib.proto.upgrade import AnyNetParameter
from netlib.snapshots.solver_state import SolverState, Weights

T = TypeVar("T")
LARGEST = 2**31 - 1  # bytes of a message, a limit of protobuf's


def weights_image(name: str, layers: Iterable[tuple[LayerParameter, list[tuple[Array, Array | None]]]]) -> bytes:
    """The .caffemodel of a net: its layers, each with the data, and if wanted the diffs, of its parameters."""
    fields = schema.to_tree(messages.NetParameter(name=name)).fields
    for spec, blobs in layers:
        tree = schema.to_tree(schema.changed(spec, blobs=()))
        values = [Field("blobs", binaryproto.tree_of(data, diff), tree.position) for data, diff in blobs]
        tree = Message(tree.fields + values, tree.position)
        fields.append(Field("layer", tree, tree.position))
    return _fitting(wire.encode(Message(fields, schema.position_of(None)), messages.NetParameter))


def state_image(state: SolverState) -> bytes:
    """The .solverstate of a training."""
    tree = schema.to_tree(messages.SolverState(state.iter, state.learned_net, (), state.current_step))
    history = [Field("history", binaryproto.tree_of(array), tree.position) for array in state.history]
    extra = schema.to_tree(messages.SolverState(netlib=json.dumps(state.extra)))
    # Ours comes first: a file that has lost its end must not look like one of Caffe's, which has no checksum.
    parts = (extra, Message(tree.fields + history, tree.position))
    return _fitting(b"".join(wire.encode(part, messages.SolverState) for part in parts))


def _fitting(image: bytes) -> bytes:
    if len(image) > LARGEST:
        raise WeightsError(f"a snapshot of {len(image)} bytes is more than Caffe's binary format can hold, "
                           "2 GB; expected snapshot_format: HDF5, or a file name that ends in .h5")  # fmt: skip
    return image


def read_weights(data: bytes, path: str) -> Weights:
    """Layer name -> parameter index -> array. Raises WeightsError if these are no weights."""
    try:
        layers = _layers(data, path)
        if layers:
            keys = distinct([layer.name for layer in layers])
            return {
                key: {i: binaryproto.array_of(blob) for i, blob in enumerate(layer.blobs)}
                for key, layer in zip(keys, layers)
            }
        problem = f"{path}: no layer in it"
    except NetlibError as error:
        problem = str(error)
    state = _or_none(_state, data, path)
    if state is not None and state.history:
        raise WeightsError(f"{path}: this is a solver state, not weights; expected its pair, "
                           f"{state.learned_net or '*.caffemodel'} (resume a training with --snapshot)")  # fmt: skip
    raise WeightsError(f"{problem}; expected weights (.caffemodel){_looks(data)}")


def read_state(data: bytes, path: str) -> SolverState:
    """The state. Raises WeightsError if it is none."""
    try:
        state = _state(data, path)
        if state.history or state.learned_net:
            history = [binaryproto.array_of(blob) for blob in state.history]
            extra = json.loads(state.netlib or "{}")
            found = SolverState(state.iter, state.current_step, state.learned_net, history, extra)
            found.check()
            return found
        problem = f"{path}: no history in it"
    except NetlibError as error:
        problem = str(error)
    except (ValueError, RecursionError) as error:  # of the JSON, too
        problem = f"{path}: damaged: {reason_of(error)}"
    if _or_none(_layers, data, path):
        raise WeightsError(f"{path}: this is a weights file; pass it as --weights, or its pair *.solverstate here")
    raise WeightsError(f"{problem}; expected a solver state (.solverstate){_looks(data)}")


def _layers(data: bytes, path: str) -> list[LayerParameter]:
    """The layers of a net in any of Caffe's formats, with their names and parameters alone: weights are copied by
    name, so types and options that only a fork of Caffe knows do no harm."""
    layers = []
    for item in wire.decode(data, AnyNetParameter, path).fields:
        if item.name in ("layer", "layers"):
            layer = schema.message_of(item)
            fields = next((v.fields for v in layer.values("layer") if isinstance(v, Message)), layer.fields)  # V0
            kept = [field for field in fields if field.name in ("name", "blobs")]
            layers.append(schema.read(Message(kept, layer.position), LayerParameter))
    return layers


def _state(data: bytes, path: str) -> messages.SolverState:
    return schema.read(wire.decode(data, messages.SolverState, path, strict=True), messages.SolverState)


def _or_none(read: Callable[[bytes, str], T], data: bytes, path: str) -> T | None:
    try:
        return read(data, path)
    except NetlibError:
        return None


def _looks(data: bytes) -> str:
    """What a file of the wrong kind looks like."""
    if not data:
        return "; the file is empty"
    if all(byte in b"\t\n\r" or 32 <= byte < 127 for byte in data[:256]):
        return "; this looks like a text"
    return ""
