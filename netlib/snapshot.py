"""Weights and solver states to and from files, in either of Caffe's formats, atomically.

A name that ends in ``.h5`` is written as HDF5 (snapshot_hdf5.py), any other in Caffe's binary format
(snapshot_binary.py); what is read is what the file holds, whatever its name.

A file is made in memory, written beside its target, flushed to the disk and renamed. Of a pair the state is renamed
last, so a state that exists has its weights.
"""

from __future__ import annotations

import contextlib
import json
import os
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from netlib import snapshot_binary, snapshot_hdf5
from netlib.atomic import replace_all
from netlib.errors import WeightsError, reason_of
from netlib.saved import SolverState, Weights


def is_hdf5(path: str | Path) -> bool:
    """Does a file of this name hold HDF5?"""
    return str(path).endswith(".h5")


def write_weights(image: bytes, path: str | Path) -> None:
    """Write the weights of a net (``weights.image``). Raises WeightsError if the disk says no."""
    _replace([(Path(path), image)])


def write_pair(image: bytes, state: SolverState, weights_path: Path, state_path: Path) -> None:
    """Write weights and solver state, both or none. Raises WeightsError if the disk says no."""
    state.extra["weights_crc"] = zlib.crc32(image)
    layout = snapshot_hdf5 if is_hdf5(state_path) else snapshot_binary
    _replace([(weights_path, image), (state_path, layout.state_image(state))])


def checksum(path: str | Path) -> int:
    """CRC-32 of a weights file; a state remembers that of its pair. Raises WeightsError."""
    return zlib.crc32(_content(path, "weights"))


def _replace(files: Sequence[tuple[Path, bytes]]) -> None:
    """Write all files or none. Raises WeightsError if the disk says no."""
    try:
        replace_all(files)
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        name = getattr(error, "filename", None) or files[0][0]
        raise WeightsError(f"{name}: cannot write the snapshot: {reason_of(error)}") from error


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
    if _content(path, "weights", len(snapshot_hdf5.MAGIC)) == snapshot_hdf5.MAGIC:
        return snapshot_hdf5.read_weights(path)
    return snapshot_binary.read_weights(_content(path, "weights"), str(path))


def read_state(path: str | Path) -> SolverState:
    """Read a solver state. Raises WeightsError if the file is not one."""
    if _content(path, "a solver state", len(snapshot_hdf5.MAGIC)) == snapshot_hdf5.MAGIC:
        return snapshot_hdf5.read_state(path)
    return snapshot_binary.read_state(_content(path, "a solver state"), str(path))


def _content(path: str | Path, what: str, size: int = -1) -> bytes:
    """The first bytes of a file, or all. Raises WeightsError."""
    try:
        with open(path, "rb") as file:
            return file.read(size)
    except OSError as error:
        raise WeightsError(f"{path}: cannot read {what}: {reason_of(error)}") from error


def same_file_beside(state_path: str | Path, learned_net: str) -> Path:
    """Where the weights of a state are: as written, else beside the state under the same name."""
    written = Path(learned_net)
    beside = Path(state_path).parent / written.name
    return beside if beside.exists() or not written.exists() else written


def as_plain(value: Mapping[str, Any]) -> dict[str, Any]:
    """A copy that JSON can hold: NumPy integers and arrays become Python's."""
    plain: dict[str, Any] = json.loads(json.dumps(value, default=lambda x: x.tolist()))
    return plain
