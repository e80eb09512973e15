"""Skeleton files that tools write: whole, and never over another one by mistake."""

from __future__ import annotations

from pathlib import Path

from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import text_of
from netlib.atomic import replace_text
from netlib.errors import NetlibError, reason_of


def write_skeleton(out: Path, skeleton: Skeleton, comment: str) -> None:
    """Write a skeleton, named after its file, below a comment. Raises NetlibError."""
    try:
        replace_text(out, text_of(skeleton.param, out.stem, comment))
    except OSError as error:
        raise NetlibError(f"{out}: cannot write the skeleton: {reason_of(error)}") from None


def check_out(out: Path, force: bool) -> None:
    """Raise NetlibError at once rather than after the work if the file cannot be written."""
    if not out.parent.is_dir():
        raise NetlibError(f"{out}: no folder {out.parent}")
    if out.is_dir():
        raise NetlibError(f"{out}: is a folder; expected the name of a file")
    if out.exists() and not force:
        raise NetlibError(f"{out}: is there already; choose another --out, or use --force to replace it")
