"""Options of several experiments that take some of a few names."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Collection, Sequence


def add_choices(
    parser: argparse.ArgumentParser,
    option: str,
    known: Collection[str],
    default: Sequence[str] = (),
) -> None:
    """Add an option that takes some of the known names; by default ``default``, or all."""
    names = ", ".join(map(shlex.quote, known))
    parser.add_argument(
        option,
        nargs="+",
        choices=known,
        default=list(default or known),
        metavar="NAME",
        help=f"some of {names} (default: {' '.join(default) or 'all'})",
    )
