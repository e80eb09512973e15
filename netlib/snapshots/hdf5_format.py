"""Weights and solver states in HDF5, in Caffe's own layout.

weights       /data/<layer>/<index>            layers without parameters are empty groups
              attribute net                    name of the net; Caffe ignores it
solver state  /iter /current_step /learned_net /history/<index>
              /netlib                          extra JSON for an exact resume
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import h5py
import numpy as np

from netlib.blob import Array
from netlib.errors import WeightsError
from netlib.files import Content, hdf5
from netlib.snapshots.solver_state import SolverState, Weights

STATE = ("iter", "current_step", "learned_net", "history", "netlib")  # items of a solver state
MAGIC = b"\x89HDF\r\n\x1a\n"  # signature at the start of a file


def check_names(weights: Weights) -> None:
    """Raise WeightsError if the name of a layer with parameters cannot be the name of a group."""
    for name, arrays in weights.items():
        if arrays and (fault := name_fault(name)):
            raise WeightsError(
                f"layer {name!r}: {fault}; expected another name, or snapshot_format: BINARYPROTO"
            )


def name_fault(name: str) -> str:
    """Describe why a layer's name cannot be the name of an HDF5 group; empty if it can."""
    parts = name.split("/")
    if any(part in ("", ".", "..") for part in parts) or not name.isprintable():
        return "HDF5 cannot store this name"
    if parts[-1].isdigit() and len(parts) > 1:
        return "in HDF5 the part after the last slash must not be a number: it would look like a parameter"
    return ""


def weights_image(name: str, weights: Weights) -> bytes:
    """Content of the HDF5 file of the weights of the net ``name``.

    Raises WeightsError for layers whose names HDF5 cannot store.
    """
    check_names(weights)
    with hdf5.in_memory() as (file, image):
        file.attrs["net"] = np.bytes_(name.encode())  # fixed length, as all texts here
        data = file.create_group("data")
        for layer, arrays in weights.items():
            if not arrays and name_fault(layer):
                continue
            group = data.require_group(layer)
            for i, array in arrays.items():
                group[str(i)] = array
    return hdf5.sealed(image.getvalue())


def state_image(state: SolverState) -> bytes:
    """Content of the HDF5 file of a solver state."""
    with hdf5.in_memory() as (file, image):
        file["iter"] = np.array([state.iter], dtype=np.int32)
        file["current_step"] = np.array([state.current_step], dtype=np.int32)
        file["learned_net"] = _c_string(state.learned_net)
        history = file.create_group("history")
        for i, array in enumerate(state.history):
            history[str(i)] = array
        file["netlib"] = _c_string(json.dumps(state.extra))
    return hdf5.sealed(image.getvalue())


def _c_string(text: str) -> Array:
    """A text with its terminating zero, of fixed length, as Caffe reads it."""
    raw = os.fsencode(text)
    return np.array(raw, dtype=f"S{len(raw) + 1}")


# ------------------------------------------------------------------------------------------ reading


def read_weights(path: str | Path | Content) -> Weights:
    """Read weights: layer name -> parameter index -> array.

    Raises WeightsError if the file does not hold weights.
    """
    with hdf5.opened(path, "weights", WeightsError) as file:
        if "history" in file and "data" not in file:
            pair = _learned_net(file) or "*.caffemodel.h5"
            raise WeightsError(
                f"{path}: this is a solver state, not weights; expected its pair, {pair} "
                "(resume a training with --snapshot)"
            )
        if not isinstance(file.get("data"), h5py.Group):
            raise WeightsError(
                f"{path}: no group /data; expected weights in the layout of Caffe's HDF5 snapshots"
            )
        layers = _layers(file["data"])
        return {name: _parameters(group, f"{path}: layer {name!r}") for name, group in layers}


def _parameters(group: Mapping[str, h5py.Dataset], where: str) -> dict[int, Array]:
    """The parameters of a layer by their indices; ``where`` begins errors. Raises WeightsError."""
    found = {}
    for key in sorted(group):
        if not key.isdecimal() or str(int(key)) != key:
            raise WeightsError(f"{where} has a parameter {key!r}; expected numbers from 0 on")
        array = np.asarray(group[key][...])
        if array.dtype.kind not in "fiu":
            raise WeightsError(f"{where} parameter {key} holds {array.dtype}, expected numbers")
        found[int(key)] = array
    return found


def net_name(path: str | Path | Content) -> str:
    """The name of the net of a weights file; empty if it is not stored. Raises WeightsError."""
    with hdf5.opened(path, "weights", WeightsError) as file:
        raw = file.attrs.get("net", b"")
        return raw.decode("utf-8", "replace") if isinstance(raw, bytes) else ""


def _layers(group: h5py.Group, prefix: str = "") -> Iterator[tuple[str, dict[str, h5py.Dataset]]]:
    """Layers in /data with their data sets.

    HDF5 nests groups for slashes in names: ``inception/1x1``. A group that holds only groups is
    a part of such a name, not a layer.
    """
    for name, item in list(group.items()):  # h5py's iterator blocks other threads
        if not isinstance(item, h5py.Group):
            continue
        inner = [k for k, v in item.items() if isinstance(v, h5py.Group)]
        if not inner or len(inner) < len(item):
            yield prefix + name, {k: v for k, v in item.items() if isinstance(v, h5py.Dataset)}
        if inner:
            yield from _layers(item, f"{prefix}{name}/")


def read_state(path: str | Path | Content) -> SolverState:
    """Read a solver state. Raises WeightsError if the file is not one."""
    with hdf5.opened(path, "a solver state", WeightsError) as file:
        if "history" not in file or "iter" not in file:
            hint = "this is a weights file; pass it as --weights, or its pair *.solverstate.h5 here"
            raise WeightsError(f"{path}: {hint if 'data' in file else 'not a solver state'}")
        if unknown := sorted(set(file) - set(STATE)):
            raise WeightsError(
                f"{path}: damaged: it holds {unknown[0]!r}; a solver state has {', '.join(STATE)}"
            )
        group = file["history"]
        history = [np.asarray(group[str(i)][()]) for i in range(len(group))]
        step = _number(file, "current_step") if "current_step" in file else 0
        extra = json.loads(file["netlib"][()]) if "netlib" in file else {}
        state = SolverState(_number(file, "iter"), step, _learned_net(file), history, extra)
        state.check()
        return state


def _number(file: h5py.File, name: str) -> int:
    values = np.ravel(file[name][()])
    if values.size != 1 or values.dtype.kind not in "iu":
        raise ValueError(
            f"{name} holds {values.size} values of {values.dtype}, expected one whole number"
        )
    return int(values[0])


def _learned_net(file: h5py.File) -> str:
    if "learned_net" not in file:
        return ""
    raw = file["learned_net"][()]
    return os.fsdecode(raw) if isinstance(raw, bytes) else str(raw)
