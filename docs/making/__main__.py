"""Make all of the documents that is made from the code, where it is no longer current.

make docs
python -m docs.making
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator

from docs.making import code_blocks, exercises
from docs.making.made import ROOT, Made

PIECES: tuple[Callable[[], Iterator[Made]], ...] = (code_blocks.made, exercises.made)


def main() -> int:
    """Write what has changed, and say so."""
    for piece in PIECES:
        for made in piece():
            if not made.is_current():
                made.path.parent.mkdir(parents=True, exist_ok=True)
                made.path.write_bytes(made.content)
                print(f"wrote {made.path.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
