"""Reading and writing weights and solver states in both of Caffe's formats.

Names that end in ``.h5`` are written as HDF5 (hdf5_format.py), others in Caffe's binary format
(binary_format.py). When reading, the content decides, not the name.

A file is built in memory, written next to its target, flushed to the disk and renamed (atomic.py):
first the weights, then the state, which has their name and their checksum. A snapshot is complete
if its state exists and its weights have this checksum.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from netlib import files
from netlib.errors import WeightsError, reason_of
from netlib.files import Content, atomic, locks
from netlib.files.paths import exists, names_in
from netlib.snapshots import binary_format, hdf5_format
from netlib.snapshots.solver_state import SolverState, Weights
from netlib.system import memory

T = TypeVar("T")
STATE_NAME = re.compile(r"(?P<prefix>.*_iter_)(?P<iter>\d+)\.solverstate(\.h5)?")


def is_hdf5(path: str | Path) -> bool:
    """Whether a file with this name is written as HDF5."""
    return str(path).endswith(".h5")


def write_weights(image: bytes, path: str | Path) -> None:
    """Write the weights of a net (``weights.image``). Raises WeightsError if writing fails."""
    with _writing(path):
        atomic.replace_bytes(Path(path), image)


def write_pair(image: bytes, state: SolverState, weights_path: Path, state_path: Path) -> None:
    """Write weights and solver state. Raises WeightsError if writing fails.

    The state is on the disk under its temporary name before the weights are renamed, so a full disk
    changes nothing.
    """
    state.extra["weights_crc"] = zlib.crc32(image)
    state.extra["checksum"] = state.checksum()
    layout = hdf5_format if is_hdf5(state_path) else binary_format
    with _writing(state_path):
        state_path.parent.mkdir(parents=True, exist_ok=True)
        with atomic.replacing(state_path, sync=False) as fresh:
            fresh.write_bytes(layout.state_image(state))
            atomic.sync_file(fresh)  # before the weights are renamed, not after
            write_weights(image, weights_path)
        atomic.sync_directory(state_path.parent)


@contextlib.contextmanager
def _writing(path: str | Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        name = getattr(error, "filename", None) or path
        raise WeightsError(f"{name}: cannot write the snapshot: {reason_of(error)}") from error


@contextlib.contextmanager
def prefix_in_use(prefix: Path) -> Iterator[None]:
    """Reserve this prefix within the block: remove what a killed training left, and reject a
    second training.

    Raises WeightsError, also if snapshots cannot be written there, before the training starts.
    """
    folder = Path(f"{prefix}_").parent
    snapshots = re.escape(prefix.name) + r"_iter_\d+\.(caffemodel|solverstate)(\.h5)?"
    with contextlib.ExitStack() as stack:
        holder = _locked(prefix, folder, stack)
        if holder:
            raise WeightsError(
                f"{prefix}: another training is writing its snapshots there (process {holder}); wait "
                "for it, or choose another snapshot_prefix"
            )
        atomic.clear_leftovers(folder, re.compile(snapshots))
        yield


def _locked(prefix: Path, folder: Path, stack: contextlib.ExitStack) -> str:
    """Lock a prefix until the stack is left, and write as much as a small snapshot with a long
    name; returns the number of the process that has the lock, empty for none.

    Raises WeightsError.
    """
    path = folder / f".{prefix.name}.netlib.lock"
    longest = folder / f"{prefix.name}_iter_{10**9}.solverstate.h5"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        holder = stack.enter_context(locks.held(path))
        if not holder:
            with atomic.temporary(longest) as fresh:
                fresh.write_bytes(b"\0" * 4096)
    except (OSError, ValueError) as error:
        # the lock is the file of another user, or a link
        is_lock = os.path.lexists(path) and getattr(error, "filename", "") == str(path)
        what = f"{path.name}: " if is_lock else ""
        raise WeightsError(
            f"{folder}: cannot write snapshots there: {what}{reason_of(error)}"
        ) from error
    return holder


# ------------------------------------------------------------------------------------------ reading


def read_content(path: str | Path) -> Content:
    """Read a weights file once, for its checksum, its weights and its other groups.

    Raises WeightsError.
    """
    limit = memory.physical() if begins_as_hdf5(path, "weights") else files.MAX_BYTES
    return Content(Path(path), files.read_bytes(path, "weights", WeightsError, limit))


def read_weights(path: str | Path | Content) -> Weights:
    """Read weights: layer name -> parameter index -> array.

    Raises WeightsError if the file does not hold weights.
    """
    return _read(path, "weights", hdf5_format.read_weights, binary_format.read_weights)


def net_name(path: str | Path) -> str:
    """The name of the net whose weights a file holds; empty if it is not stored.

    Raises WeightsError.
    """
    return _read(path, "weights", hdf5_format.net_name, binary_format.net_name)


def read_state(path: str | Path) -> SolverState:
    """Read and check a solver state. Raises WeightsError if the file is not one or is damaged."""
    return _read(path, "a solver state", hdf5_format.read_state, binary_format.read_state)


def _read(
    path: str | Path | Content,
    what: str,
    as_hdf5: Callable[[str | Path | Content], T],
    as_binary: Callable[[bytes, str], T],
) -> T:
    """Read a file by the function for its format, which its content decides."""
    if begins_as_hdf5(path, what):
        return as_hdf5(path)
    data = path.data if isinstance(path, Content) else files.read_bytes(path, what, WeightsError)
    return as_binary(data, str(path))


def begins_as_hdf5(path: str | Path | Content, what: str) -> bool:
    """Whether the content of the file is HDF5. Raises WeightsError if it cannot be read."""
    magic = hdf5_format.MAGIC
    if isinstance(path, Content):
        return path.data.startswith(magic)
    return files.read_bytes(path, what, WeightsError, first=len(magic)) == magic


def weights_of(state_path: str | Path, state: SolverState) -> Content:
    """The weights of a state: next to it, or at the path that it names.

    Raises WeightsError if they do not match.
    """
    written = Path(state.learned_net)
    sibling = Path(state_path).parent / written.name
    found = read_content(sibling if exists(sibling) or not exists(written) else written)
    expected = state.extra.get("weights_crc")
    # Caffe's states have no checksum
    if expected is not None and zlib.crc32(found.data) != expected:
        raise WeightsError(f"{state_path}: its weights {found} belong to another snapshot")
    return found


def complete_snapshot(state_path: str | Path) -> Path | None:
    """The newest complete snapshot with the prefix of ``state_path``, other than itself, by the
    path of its state.
    """
    path = Path(state_path)
    own = STATE_NAME.fullmatch(path.name)
    states = [name for name in map(STATE_NAME.fullmatch, names_in(path.parent)) if name]
    for name in sorted(states, key=lambda name: -int(name["iter"])):
        if own and name["prefix"] == own["prefix"] and name[0] != path.name:
            other = path.with_name(name[0])
            with contextlib.suppress(WeightsError):
                weights_of(other, read_state(other))
                return other
    return None


def as_plain(value: Mapping[str, Any]) -> dict[str, Any]:
    """Convert to JSON values: NumPy numbers and arrays become Python's."""
    plain: dict[str, Any] = json.loads(json.dumps(value, default=lambda x: x.tolist()))
    return plain
