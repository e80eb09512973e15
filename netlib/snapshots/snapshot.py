"""Weights and solver states to and from files, in either of Caffe's formats, atomically.

A name that ends in ``.h5`` is written as HDF5 (hdf5_format.py), any other in Caffe's binary format
(binary_format.py); what is read is what the file holds, whatever its name.

A file is made in memory, written beside its target, flushed to the disk and renamed. Of a pair the state is renamed
last, so a state that exists has its weights; it holds a checksum of them, and one of itself.
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
from netlib.files import atomic, locks
from netlib.files.paths import exists, names_in
from netlib.snapshots import binary_format, hdf5_format
from netlib.snapshots.solver_state import SolverState, Weights
from netlib.system import memory


def is_hdf5(path: str | Path) -> bool:
    """Does a file of this name hold HDF5?"""
    return str(path).endswith(".h5")


def write_weights(image: bytes, path: str | Path) -> None:
    """Write the weights of a net (``weights.image``). Raises WeightsError if the disk says no."""
    with _saying(path):
        atomic.replace_bytes(Path(path), image)


def write_pair(image: bytes, state: SolverState, weights_path: Path, state_path: Path) -> None:
    """Write weights and solver state, both or none. Raises WeightsError if the disk says no."""
    state.extra["weights_crc"] = zlib.crc32(image)
    state.extra["checksum"] = state.checksum()
    layout = hdf5_format if is_hdf5(state_path) else binary_format
    with _saying(weights_path):
        atomic.replace_pair((weights_path, image), (state_path, layout.state_image(state)))


@contextlib.contextmanager
def _saying(path: str | Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        name = getattr(error, "filename", None) or path
        raise WeightsError(f"{name}: cannot write the snapshot: {reason_of(error)}") from error


def checksum(path: str | Path) -> int:
    """CRC-32 of a weights file; a state remembers that of its pair. Raises WeightsError."""
    limit = memory.available()[0] if begins_as_hdf5(path, "weights") else files.LARGEST  # what can be read at all
    crc = 0
    for piece in files.read_pieces(path, "weights", WeightsError, limit):
        crc = zlib.crc32(piece, crc)
    return crc


@contextlib.contextmanager
def prefix_in_use(prefix: Path) -> Iterator[None]:
    """Within it this prefix is ours: what a killed training left of it is put right, a second training is refused.

    Raises WeightsError, also if snapshots cannot be written there: now, before hours of training.
    """
    folder = Path(f"{prefix}_").parent
    path = folder / f".{prefix.name}.netlib.lock"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = locks.Lock(path)
    except (OSError, ValueError) as error:
        what = f"{path.name}: " if os.path.lexists(path) else ""  # left by another user, or a link
        raise WeightsError(f"{folder}: cannot write snapshots there: {what}{reason_of(error)}") from error
    if not lock.taken:
        raise WeightsError(f"{prefix}: another training is writing its snapshots there (process {lock.holder}); wait "
                           "for it, or choose another snapshot_prefix")  # fmt: skip
    try:
        probe(prefix)
        _put_right(prefix)
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


def _put_right(prefix: Path) -> None:
    """What killed processes left: temporary files go, and where a pair was being replaced it is the old or the new."""
    folder = Path(f"{prefix}_").parent
    atomic.clear_leftovers(folder)
    pattern = re.compile(re.escape(prefix.name) + r"_iter_\d+\.caffemodel(\.h5)?")
    for name in names_in(folder):
        found = atomic.KEPT.fullmatch(name)
        if found and pattern.fullmatch(found[1]):
            with contextlib.suppress(OSError, WeightsError), locks.held(folder / name) as locked:
                if locked:
                    _choose(folder / found[1], folder / name)


def _choose(weights: Path, old: Path) -> None:
    """Give old weights their name back if the state beside them is theirs; else remove them."""
    state = weights.with_name(weights.name.replace(".caffemodel", ".solverstate"))
    if weights.exists() and (old.samefile(weights) or not state.exists()):
        old.unlink()
    elif not weights.exists() or weights_of(state, read_state(state), weights) == old:
        os.replace(old, weights)
    else:
        old.unlink()


# ---------------------------------------------------------------------------------------------- reading


def read_weights(path: str | Path) -> Weights:
    """Layer name -> parameter index -> array. Raises WeightsError if the file is not such a file."""
    if begins_as_hdf5(path, "weights"):
        return hdf5_format.read_weights(path)
    return binary_format.read_weights(files.read_bytes(path, "weights", WeightsError), str(path))


def read_state(path: str | Path) -> SolverState:
    """Read a solver state and check it. Raises WeightsError if the file is not one, or damaged."""
    if begins_as_hdf5(path, "a solver state"):
        return hdf5_format.read_state(path)
    return binary_format.read_state(files.read_bytes(path, "a solver state", WeightsError), str(path))


def begins_as_hdf5(path: str | Path, what: str) -> bool:
    """Does the file hold HDF5, whatever its name? Raises WeightsError if it cannot be read."""
    magic = hdf5_format.MAGIC
    return files.read_bytes(path, what, WeightsError, first=len(magic)) == magic


def pair_of(state_path: str | Path, state: SolverState) -> Path:
    """The weights that belong to a state: where it says, else beside it. Raises WeightsError for those of another.

    If a process was killed while it replaced the pair, they may be the old ones that it kept.
    """
    written = Path(state.learned_net)
    beside = Path(state_path).parent / written.name
    return weights_of(state_path, state, beside if exists(beside) or not exists(written) else written)


def weights_of(state_path: str | Path, state: SolverState, named: Path) -> Path:
    """The file of that name, or the old one of it that was kept, whichever is the state's. Raises WeightsError."""
    expected, old = state.extra.get("weights_crc"), atomic.kept(named)
    if expected is None:  # written by Caffe, and so not by who was replacing the pair
        return old[0] if old else named
    for path in (named, *old):
        if checksum(path) == expected:
            return path
    raise WeightsError(f"{state_path}: the weights beside it, {named}, are those of another snapshot")


def as_plain(value: Mapping[str, Any]) -> dict[str, Any]:
    """A copy that JSON can hold: NumPy integers and arrays become Python's."""
    plain: dict[str, Any] = json.loads(json.dumps(value, default=lambda x: x.tolist()))
    return plain
