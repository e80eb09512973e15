"""Weights and solver states in Caffe's binary format.

    .caffemodel     a NetParameter: every layer as the net runs it, with its parameters in ``blobs``
    .solverstate    a SolverState; its extra field ``netlib``, JSON, holds what an exact resume
                    needs; Caffe ignores it

Weights of Caffe's older formats are read too (netlib/proto/upgrade.py).
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
from netlib.proto.upgrade import AnyNetParameter, refuse_v0
from netlib.snapshots.solver_state import SolverState, Weights

T = TypeVar("T")
MAX_BYTES = 2**31 - 1  # limit of protobuf


def weights_image(
    name: str, layers: Iterable[tuple[LayerParameter, list[tuple[Array, Array | None]]]]
) -> bytes:
    """Content of the .caffemodel of a net: its layers with the data, and optionally the diffs, of
    their parameters.
    """
    fields = schema.to_tree(messages.NetParameter(name=name)).fields
    for spec, blobs in layers:
        tree = schema.to_tree(schema.changed(spec, blobs=()))
        values = [
            Field("blobs", binaryproto.tree_of(data, diff), tree.position) for data, diff in blobs
        ]
        tree = Message(tree.fields + values, tree.position)
        fields.append(Field("layer", tree, tree.position))
    return _fitting(wire.encode(Message(fields, schema.position_of(None)), messages.NetParameter))


def state_image(state: SolverState) -> bytes:
    """Content of a .solverstate file."""
    tree = schema.to_tree(
        messages.SolverState(state.iter, state.learned_net, (), state.current_step)
    )
    history = [
        Field("history", binaryproto.tree_of(array), tree.position) for array in state.history
    ]
    extra = schema.to_tree(messages.SolverState(netlib=json.dumps(state.extra)))
    # The extra field comes first, so that a truncated file does not look like one of Caffe's, which
    # has no checksum.
    parts = (extra, Message(tree.fields + history, tree.position))
    return _fitting(b"".join(wire.encode(part, messages.SolverState) for part in parts))


def _fitting(image: bytes) -> bytes:
    if len(image) > MAX_BYTES:
        raise WeightsError(
            f"a snapshot of {len(image)} bytes exceeds the limit of Caffe's binary format, 2 GB; "
            "expected snapshot_format: HDF5, or a file name that ends in .h5"
        )
    return image


def read_weights(data: bytes, path: str) -> Weights:
    """Decode weights: layer name -> parameter index -> array.

    Raises WeightsError if the data are not weights.
    """
    try:
        layers = _layers(data, path)
        if layers:
            keys = distinct([layer.name for layer in layers])
            return {
                key: {i: binaryproto.array_of(blob) for i, blob in enumerate(layer.blobs)}
                for key, layer in zip(keys, layers)
            }
        problem = f"{path}: it has no layers"
    except NetlibError as error:
        problem = str(error)
    state = _or_none(_state, data, path)
    if state is not None and state.history:
        raise WeightsError(
            f"{path}: this is a solver state, not weights; expected its pair, "
            f"{state.learned_net or '*.caffemodel'} (resume a training with --snapshot)"
        )
    raise WeightsError(f"{problem}; expected weights (.caffemodel){_looks(data)}")


def net_name(data: bytes, path: str) -> str:
    """The name of the net of weights. Raises WeightsError if the data are not a net."""
    return wire.decode(data, AnyNetParameter, path).text("name")


def read_state(data: bytes, path: str) -> SolverState:
    """Decode a solver state. Raises WeightsError if the data are not one."""
    try:
        state = _state(data, path)
        if state.history or state.learned_net:
            history = [binaryproto.array_of(blob) for blob in state.history]
            extra = json.loads(state.netlib or "{}")
            found = SolverState(state.iter, state.current_step, state.learned_net, history, extra)
            found.check()
            return found
        problem = f"{path}: it has no history"
    except NetlibError as error:
        problem = str(error)
    except (ValueError, RecursionError) as error:  # the JSON may be invalid
        problem = f"{path}: damaged: {reason_of(error)}"
    if _or_none(_layers, data, path):
        raise WeightsError(
            f"{path}: this is a weights file; pass it as --weights, or its pair *.solverstate here"
        )
    raise WeightsError(f"{problem}; expected a solver state (.solverstate){_looks(data)}")


def _layers(data: bytes, path: str) -> list[LayerParameter]:
    """Layers of a net in any of Caffe's formats, with only their names and parameters.

    Weights are copied by name, so types and options of Caffe's forks do not matter.
    """
    layers = []
    for item in wire.decode(data, AnyNetParameter, path).named("layer", "layers"):
        layer = schema.message_of(item)
        refuse_v0(layer)
        kept = layer.named("name", "blobs")
        layers.append(schema.read(Message(kept, layer.position), LayerParameter))
    return layers


def _state(data: bytes, path: str) -> messages.SolverState:
    return schema.read(
        wire.decode(data, messages.SolverState, path, strict=True), messages.SolverState
    )


def _or_none(read: Callable[[bytes, str], T], data: bytes, path: str) -> T | None:
    try:
        return read(data, path)
    except NetlibError:
        return None


def _looks(data: bytes) -> str:
    """Guess what a file of the wrong kind is, for an error message."""
    if not data:
        return "; the file is empty"
    if all(byte in b"\t\n\r" or 32 <= byte < 127 for byte in data[:256]):
        return "; it looks like a text file"
    return ""
