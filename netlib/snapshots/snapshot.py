"""Reading and writing weights and solver states in both of Caffe's formats.

Names that end in ``.h5`` are written as HDF5 (hdf5_format.py), others in Caffe's binary format (binary_format.py). When
reading, the content decides, not the name.

A file is built in memory, written next to its target, flushed to the disk and renamed. Of a pair, the state is renamed
last, so if a state exists, so do its weights; it holds a checksum of them and of itself.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from netlib import files
from netlib.errors import WeightsError, reason_of
from netlib.files import Content, atomic, locks
from netlib.files.paths import exists, names_in
from netlib.snapshots import binary_format, hdf5_format
from netlib.snapshots.solver_state import SolverState, Weights
from netlib.system import memory


def is_hdf5(path: str | Path) -> bool:
    """Whether a file with this name is written as HDF5."""
    return str(path).endswith(".h5")


def write_weights(image: bytes, path: str | Path) -> None:
    """Write the weights of a net (``weights.image``). Raises WeightsError if writing fails."""
    with _writing(path):
        atomic.replace_bytes(Path(path), image)


def write_pair(image: bytes, state: SolverState, weights_path: Path, state_path: Path) -> None:
    """Write weights and solver state: both, or none. Raises WeightsError if writing fails."""
    state.extra["weights_crc"] = zlib.crc32(image)
    state.extra["checksum"] = state.checksum()
    layout = hdf5_format if is_hdf5(state_path) else binary_format
    with _writing(weights_path):
        atomic.replace_pair((weights_path, image), (state_path, layout.state_image(state)))


@contextlib.contextmanager
def _writing(path: str | Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        name = getattr(error, "filename", None) or path
        raise WeightsError(f"{name}: cannot write the snapshot: {reason_of(error)}") from error


def checksum(path: str | Path) -> int:
    """CRC-32 of a weights file, as stored in the state that belongs to it. Raises WeightsError."""
    crc = 0
    for piece in files.read_pieces(path, "weights", WeightsError, _max_bytes(path)):
        crc = zlib.crc32(piece, crc)
    return crc


def _max_bytes(path: str | Path) -> float:
    return memory.available()[0] if begins_as_hdf5(path, "weights") else files.MAX_BYTES


@contextlib.contextmanager
def prefix_in_use(prefix: Path) -> Iterator[None]:
    """Reserve this prefix within the block: clean up after a killed training, and reject a second training.

    Raises WeightsError, also if snapshots cannot be written there, before the training starts.
    """
    folder = Path(f"{prefix}_").parent
    path = folder / f".{prefix.name}.netlib.lock"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = locks.Lock(path)
    except (OSError, ValueError) as error:
        what = f"{path.name}: " if os.path.lexists(path) else ""  # the file of another user, or a link
        raise WeightsError(f"{folder}: cannot write snapshots there: {what}{reason_of(error)}") from error
    if not lock.taken:
        raise WeightsError(f"{prefix}: another training is writing its snapshots there (process {lock.holder}); wait "
                           "for it, or choose another snapshot_prefix")
    try:
        probe(prefix)
        _repair(prefix)
        yield
    finally:
        lock.release()


def probe(prefix: Path) -> None:
    """Raise WeightsError if snapshots cannot be written at ``prefix``."""
    folder, longest = Path(f"{prefix}_").parent, f"{Path(prefix).name}_iter_{10**9}.solverstate.h5"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with atomic.temporary(folder / longest) as fresh:
            fresh.write_bytes(b"\0" * 4096)
    except (OSError, ValueError) as error:
        raise WeightsError(f"{folder}: cannot write snapshots there: {reason_of(error)}") from error


def _repair(prefix: Path) -> None:
    """Clean up after killed processes: remove temporary files, and complete or undo the replacement of a pair."""
    folder = Path(f"{prefix}_").parent
    atomic.clear_leftovers(folder)
    pattern = re.compile(re.escape(prefix.name) + r"_iter_\d+\.caffemodel(\.h5)?")
    for name in names_in(folder):
        found = atomic.BACKUP.fullmatch(name)
        if found and pattern.fullmatch(found[1]):
            with contextlib.suppress(OSError, WeightsError), locks.held(folder / name) as locked:
                if locked:
                    _choose(folder / found[1], folder / name)


def _choose(weights: Path, old: Path) -> None:
    """Restore old weights if they belong to the current state; else remove them."""
    state = weights.with_name(weights.name.replace(".caffemodel", ".solverstate"))
    if weights.exists() and (old.samefile(weights) or not state.exists()):
        old.unlink()
    elif not weights.exists() or weights_of(state, read_state(state), weights) == old:
        os.replace(old, weights)
    else:
        old.unlink()


# ---------------------------------------------------------------------------------------------- reading


def read_content(path: str | Path) -> Content:
    """Read a weights file once, for its checksum, its weights and its other groups. Raises WeightsError."""
    return files.read_content(path, "weights", WeightsError, _max_bytes(path))


def read_weights(path: str | Path | Content) -> Weights:
    """Read weights: layer name -> parameter index -> array. Raises WeightsError if the file does not hold weights."""
    if begins_as_hdf5(path, "weights"):
        return hdf5_format.read_weights(path)
    data = path.data if isinstance(path, Content) else files.read_bytes(path, "weights", WeightsError)
    return binary_format.read_weights(data, str(path))


def net_name(path: str | Path) -> str:
    """The name of the net whose weights a file holds; empty if it is not stored. Raises WeightsError."""
    if begins_as_hdf5(path, "weights"):
        return hdf5_format.net_name(path)
    return binary_format.net_name(files.read_bytes(path, "weights", WeightsError), str(path))


def read_state(path: str | Path) -> SolverState:
    """Read and check a solver state. Raises WeightsError if the file is not one or is damaged."""
    if begins_as_hdf5(path, "a solver state"):
        return hdf5_format.read_state(path)
    return binary_format.read_state(files.read_bytes(path, "a solver state", WeightsError), str(path))


def begins_as_hdf5(path: str | Path | Content, what: str) -> bool:
    """Whether the content of the file is HDF5. Raises WeightsError if it cannot be read."""
    magic = hdf5_format.MAGIC
    if isinstance(path, Content):
        return path.data.startswith(magic)
    return files.read_bytes(path, what, WeightsError, first=len(magic)) == magic


def pair_of(state_path: str | Path, state: SolverState) -> Path:
    """Find the weights of a state: next to it, or at the path that it names. Raises WeightsError if they do not match.

    After a process was killed while it replaced the pair, they may be the backup of the old weights.
    """
    written = Path(state.learned_net)
    sibling = Path(state_path).parent / written.name
    return weights_of(state_path, state, sibling if exists(sibling) or not exists(written) else written)


def weights_of(state_path: str | Path, state: SolverState, named: Path) -> Path:
    """The file ``named`` or its backup, whichever has the checksum in the state. Raises WeightsError."""
    expected, old = state.extra.get("weights_crc"), atomic.backups(named)
    if expected is None:  # written by Caffe
        return old[0] if old else named
    for path in (named, *old):
        if checksum(path) == expected:
            return path
    raise WeightsError(f"{state_path}: the weights next to it, {named}, belong to another snapshot")


def as_plain(value: Mapping[str, Any]) -> dict[str, Any]:
    """Convert to JSON values: NumPy numbers and arrays become Python's."""
    plain: dict[str, Any] = json.loads(json.dumps(value, default=lambda x: x.tolist()))
    return plain
