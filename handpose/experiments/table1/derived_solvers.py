"""Solvers of experiments that train many nets with one recipe: the same file with some other fields."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from netlib.proto import prototxt
from netlib.proto.prototxt import Message, Scalar


def with_fields(solver: Message, own: Mapping[str, object]) -> Message:
    """The tree of a solver with the fields ``own``, without tests and snapshots; its ``str`` is a prototxt.

    A value is a path, or prototxt text: ``'"fixed"'`` is a string, ``"HDF5"`` a word. Raises PrototxtError.
    """
    kept = [f for f in solver.fields if not f.name.startswith(("test_", "snapshot")) and f.name not in own]
    written = {
        name: Scalar("string", value.as_posix(), solver.position) if isinstance(value, Path) else value
        for name, value in own.items()
    }
    added = prototxt.parse("\n".join(f"{name}: {value}" for name, value in written.items())).fields
    return Message([*kept, *added], solver.position)
