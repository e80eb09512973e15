"""Solvers of experiments, which train many nets with one recipe: the same file with some fields of its own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from netlib.proto import prototxt
from netlib.proto.prototxt import Message, Scalar


def with_fields(solver: Message, own: Mapping[str, object]) -> Message:
    """The tree of a solver with the fields ``own``, without its tests and snapshots; ``str`` of it is its file.

    A value is a path, or stands as it is written: ``'"fixed"'`` is a string, ``"HDF5"`` a word. Raises PrototxtError.
    """
    kept = [f for f in solver.fields if not f.name.startswith(("test_", "snapshot")) and f.name not in own]
    written = {
        name: Scalar("string", value.as_posix(), solver.position) if isinstance(value, Path) else value
        for name, value in own.items()
    }
    added = prototxt.parse("\n".join(f"{name}: {value}" for name, value in written.items())).fields
    return Message([*kept, *added], solver.position)
