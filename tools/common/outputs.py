"""Files that a tool is to write: what cannot be, or would be a loss, is said before the work."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import text_of
from netlib.errors import NetlibError, reason_of
from netlib.files import atomic


def refuse_inputs(out: str | Path, inputs: Iterable[str | Path | None], why: str = "is read in this run") -> None:
    """Raise NetlibError if ``out`` is one of the inputs, by whatever name; None is none."""
    if os.path.realpath(out) in {os.path.realpath(path) for path in inputs if path is not None}:
        raise NetlibError(f"{out}: {why}; write to another place")


def check_place(out: Path, inputs: Iterable[str | Path | None] = ()) -> None:
    """Raise NetlibError or OSError, with the file's name, if no file can be written there or an input would be lost."""
    refuse_inputs(out, inputs)
    if not out.parent.is_dir():
        raise NetlibError(f"{out}: no folder {out.parent}")
    with atomic.naming(out), atomic.temporary(out):
        atomic.refuse_what_is_no_file(out)


def write_skeleton(out: Path, skeleton: Skeleton, comment: str) -> None:
    """Write a skeleton, named after its file, below a comment. Raises NetlibError."""
    try:
        atomic.replace_text(out, text_of(skeleton.param, out.stem, comment))
    except OSError as error:
        raise NetlibError(f"{out}: cannot write the skeleton: {reason_of(error)}") from None


def check_skeleton(out: Path, force: bool, inputs: Sequence[str]) -> None:
    """Raise NetlibError or OSError at once rather than after the work if the file cannot be written."""
    check_place(out, inputs)
    if out.exists() and not force:
        raise NetlibError(f"{out}: is there already; choose another --out, or use --force to replace it")
