"""Make all of the documents that is made from the code, where it is no longer current.

make docs
python -m docs.making
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator

from docs.making import documents, exercises, figures, hand_page, pictures
from docs.making.made import Made
from netlib.errors import NetlibError
from netlib.paths import ROOT

PIECES: tuple[Callable[[], Iterator[Made]], ...] = (
    documents.made, figures.made, pictures.made, exercises.made, hand_page.made,
)  # fmt: skip


def main() -> int:
    """Write what has changed, and say so."""
    try:
        for piece in PIECES:
            for made in piece():
                if made.update():
                    print(f"wrote {made.path.relative_to(ROOT)}")
    except (OSError, ValueError, NetlibError) as error:  # a document names what is not there
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
