"""Weights and solver states to and from HDF5, in Caffe's own layout, atomically.

    weights       /data/<layer>/<index>            an empty group for a layer without parameters
    solver state  /iter /current_step /learned_net /history/<index>
                  /netlib                          ours, JSON: all else that an exact resume needs

A file is made in memory, written beside its target, flushed to the disk and renamed. Of a pair the state is
renamed last, so a state that exists has its weights.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from netlib.atomic import replace_all
from netlib.blob import Array
from netlib.errors import WeightsError, reason_of

Weights = dict[str, dict[int, Array]]  # layer name -> parameter index -> array


@dataclass
class SolverState:
    """What a solver state file holds."""

    iter: int
    current_step: int
    learned_net: str  # path of the weights, as written by the solver
    history: list[Array]
    extra: dict[str, Any] = field(default_factory=dict)  # /netlib; empty in a file that Caffe wrote


def write_weights(weights: Weights, path: str | Path) -> None:
    """Write the weights of a net. Raises WeightsError if the disk says no."""
    _replace([(Path(path), weights_image(weights))])


def write_pair(weights: Weights, state: SolverState, weights_path: Path, state_path: Path) -> None:
    """Write weights and solver state, both or none. Raises WeightsError if the disk says no."""
    image = weights_image(weights)
    state.extra["weights_crc"] = zlib.crc32(image)
    _replace([(weights_path, image), (state_path, _state_image(state))])


def checksum(path: str | Path) -> int:
    """CRC-32 of a weights file; a state remembers that of its pair. Raises WeightsError."""
    try:
        return zlib.crc32(Path(path).read_bytes())
    except OSError as error:
        raise WeightsError(f"{path}: cannot read weights: {reason_of(error)}") from error


def weights_image(weights: Weights) -> bytes:
    """The HDF5 file of a net's weights, as bytes."""
    with _in_memory() as (file, image):
        data = file.create_group("data")
        for layer, arrays in weights.items():
            group = data.require_group(layer)
            for i, array in arrays.items():
                group[str(i)] = array
    return image.getvalue()


def _state_image(state: SolverState) -> bytes:
    with _in_memory() as (file, image):
        file["iter"] = np.array([state.iter], dtype=np.int32)
        file["current_step"] = np.array([state.current_step], dtype=np.int32)
        _write_c_string(file, "learned_net", state.learned_net)
        history = file.create_group("history")
        for i, array in enumerate(state.history):
            history[str(i)] = array
        file["netlib"] = json.dumps(state.extra)
    return image.getvalue()


@contextlib.contextmanager
def _in_memory() -> Iterator[tuple[h5py.File, io.BytesIO]]:
    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        yield file, image


def _write_c_string(file: h5py.File, name: str, text: str) -> None:
    """A fixed-length, null-terminated string, as Caffe's H5LT calls write and read it."""
    raw = os.fsencode(text)
    kind = h5py.h5t.C_S1.copy()
    kind.set_size(len(raw) + 1)
    kind.set_strpad(h5py.h5t.STR_NULLTERM)
    space = h5py.h5s.create(h5py.h5s.SCALAR)
    dataset = h5py.h5d.create(file.id, name.encode(), kind, space)
    dataset.write(h5py.h5s.ALL, h5py.h5s.ALL, np.array(raw, dtype=f"S{len(raw) + 1}"))


def _replace(files: Sequence[tuple[Path, bytes]]) -> None:
    """Write all files or none. Raises WeightsError if the disk says no."""
    try:
        replace_all(files)
    except OSError as error:
        raise WeightsError(f"{error.filename}: cannot write the snapshot: {reason_of(error)}") from error


def probe_directory(prefix: str | Path) -> None:
    """Raise WeightsError now, before hours of training, if snapshots cannot be written at ``prefix``."""
    directory = Path(f"{prefix}_").parent
    longest = f".{Path(prefix).name}_iter_{10**9}.solverstate.h5.{os.getpid()}.tmp"
    probe = directory / longest
    try:
        directory.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"\0" * 4096)
        probe.unlink()
    except (OSError, ValueError) as error:
        with contextlib.suppress(OSError, ValueError):
            probe.unlink(missing_ok=True)
        raise WeightsError(f"{directory}: cannot write snapshots there: {reason_of(error)}") from error


# ---------------------------------------------------------------------------------------------- reading


def read_weights(path: str | Path) -> Weights:
    """Layer name -> parameter index -> array. Raises WeightsError if the file is not such a file."""
    with _open(path, "weights") as file:
        if "history" in file and "data" not in file:
            pair = _learned_net(file) or "*.caffemodel.h5"
            raise WeightsError(f"{path}: this is a solver state, not weights; expected its pair, {pair} "
                               "(resume a training with --snapshot)")  # fmt: skip
        if not isinstance(file.get("data"), h5py.Group):
            raise WeightsError(f"{path}: no group /data in it; expected weights as Caffe's HDF5 snapshots have them")
        found: Weights = {}
        for name, group in _layers(file["data"]):
            found[name] = {}
            for key in sorted(group):
                if not key.isdecimal() or not key.isascii() or str(int(key)) != key:
                    raise WeightsError(f"{path}: layer {name!r} has a parameter {key!r}; expected numbers from 0 on")
                array = np.asarray(group[key][...])
                if array.dtype.kind not in "fiu":
                    raise WeightsError(f"{path}: layer {name!r} parameter {key} holds {array.dtype}, expected numbers")
                found[name][int(key)] = array
        return found


def _layers(group: h5py.Group, prefix: str = "") -> Iterator[tuple[str, h5py.Group]]:
    """Layers of /data. A slash in a layer's name makes HDF5 nest groups: ``inception/1x1``."""
    for name, item in group.items():
        if not isinstance(item, h5py.Group):
            continue
        inner = [k for k, v in item.items() if isinstance(v, h5py.Group)]
        if not inner or len(inner) < len(item):
            yield prefix + name, item if not inner else _Only(item)
        yield from _layers(item, f"{prefix}{name}/") if inner else ()


class _Only(dict[str, Any]):
    """The data sets of a group, without the groups in it."""

    def __init__(self, group: h5py.Group) -> None:
        super().__init__({k: v for k, v in group.items() if isinstance(v, h5py.Dataset)})


def read_state(path: str | Path) -> SolverState:
    """Read a solver state. Raises WeightsError if the file is not one."""
    with _open(path, "a solver state") as file:
        if "history" not in file or "iter" not in file:
            hint = "this is a weights file; pass it as --weights, or its pair *.solverstate.h5 here"
            raise WeightsError(f"{path}: {hint if 'data' in file else 'not a solver state'}")
        group = file["history"]
        extra = json.loads(file["netlib"][()]) if "netlib" in file else {}
        if not isinstance(extra, dict) or int(np.ravel(file["iter"][()])[0]) < 0:
            raise ValueError("the state makes no sense")
        return SolverState(
            iter=int(np.ravel(file["iter"][()])[0]),
            current_step=int(np.ravel(file["current_step"][()])[0]) if "current_step" in file else 0,
            learned_net=_learned_net(file),
            history=[group[str(i)][...] for i in range(len(group))],
            extra=extra,
        )


def _learned_net(file: h5py.File) -> str:
    if "learned_net" not in file:
        return ""
    raw = file["learned_net"][()]
    return os.fsdecode(raw) if isinstance(raw, bytes) else str(raw)


@contextlib.contextmanager
def _open(path: str | Path, what: str) -> Iterator[h5py.File]:
    """Open an HDF5 file; whatever is wrong with it becomes one WeightsError."""
    try:
        with open(path, "rb") as probe:
            magic = probe.read(8)
    except OSError as error:
        raise WeightsError(f"{path}: cannot read {what}: {reason_of(error)}") from error
    if magic != b"\x89HDF\r\n\x1a\n":
        binary = str(path).endswith((".caffemodel", ".solverstate"))
        hint = "; this looks like Caffe's binary format, write it with 'snapshot_format: HDF5'" if binary else ""
        raise WeightsError(f"{path}: not an HDF5 file; expected {what}{hint}")
    try:
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, LookupError, TypeError, ValueError, RuntimeError, AttributeError) as error:
        raise WeightsError(f"{path}: damaged or truncated ({' '.join(str(error).split())}); expected {what}") from error


def same_file_beside(state_path: str | Path, learned_net: str) -> Path:
    """Where the weights of a state are: as written, else beside the state under the same name."""
    written = Path(learned_net)
    beside = Path(state_path).parent / written.name
    return beside if beside.exists() or not written.exists() else written


def as_plain(value: Mapping[str, Any]) -> dict[str, Any]:
    """A copy that JSON can hold: NumPy integers and arrays become Python's."""
    plain: dict[str, Any] = json.loads(json.dumps(value, default=lambda x: x.tolist()))
    return plain
