"""Checks of output files before the work starts."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import text_of
from netlib.errors import NetlibError, reason_of
from netlib.files import atomic


def refuse_inputs(out: str | Path, inputs: Iterable[str | Path | None], why: str = "is read in this run") -> None:
    """Raise NetlibError if ``out`` is one of the inputs, under any name. None in ``inputs`` is ignored."""
    if os.path.realpath(out) in {os.path.realpath(path) for path in inputs if path is not None}:
        raise NetlibError(f"{out}: {why}; expected another output")


def check_place(out: Path, inputs: Iterable[str | Path | None] = ()) -> None:
    """Raise NetlibError or OSError if a file cannot be written there or would replace an input."""
    refuse_inputs(out, inputs)
    if not out.parent.is_dir():
        raise NetlibError(f"{out}: folder {out.parent} does not exist")
    with atomic.error_names(out), atomic.temporary(out):
        atomic.require_regular_file(out)


def write_skeleton(out: Path, skeleton: Skeleton, comment: str) -> None:
    """Write a skeleton file with a comment; its name is that of the file. Raises NetlibError."""
    try:
        atomic.replace_text(out, text_of(skeleton.param, out.stem, comment))
    except OSError as error:
        raise NetlibError(f"{out}: cannot write the skeleton: {reason_of(error)}") from None


def check_skeleton(out: Path, force: bool, inputs: Sequence[str]) -> None:
    """Raise NetlibError or OSError if the file cannot be written."""
    check_place(out, inputs)
    if out.exists() and not force:
        raise NetlibError(f"{out}: exists already; choose another --out, or replace it with --force")
