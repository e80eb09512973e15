"""Solver files of experiments, which train many nets with one recipe: the same text with some fields of its own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


def with_fields(solver: str, own: Mapping[str, object]) -> str:
    """The text of a solver, one field per line, with the fields ``own`` and without its tests and snapshots."""
    dropped = ("test_", "snapshot", *(f"{name}:" for name in own))
    kept = [line for line in solver.splitlines() if line and not line.startswith(dropped)]
    lines = [
        f'{name}: "{value.as_posix()}"' if isinstance(value, Path) else f"{name}: {value}"
        for name, value in own.items()
    ]
    return "\n".join([*kept, *lines]) + "\n"
