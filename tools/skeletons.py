"""Skeleton files that tools write: whole, and never over another one by mistake."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import text_of
from netlib.errors import NetlibError, reason_of
from netlib.files.atomic import replace_text
from tools import outputs


def write_skeleton(out: Path, skeleton: Skeleton, comment: str) -> None:
    """Write a skeleton, named after its file, below a comment. Raises NetlibError."""
    try:
        replace_text(out, text_of(skeleton.param, out.stem, comment))
    except OSError as error:
        raise NetlibError(f"{out}: cannot write the skeleton: {reason_of(error)}") from None


def check_out(out: Path, force: bool, inputs: Sequence[str]) -> None:
    """Raise NetlibError or OSError at once rather than after the work if the file cannot be written."""
    outputs.check_place(out, inputs)
    if out.exists() and not force:
        raise NetlibError(f"{out}: is there already; choose another --out, or use --force to replace it")
