"""Make all of the documents that is made from the code, where it is no longer current.

make docs                                   or: python -m docs.making
python -m docs.making documents --check     one part, and nothing is written: status 1 if it is not current
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator

from docs.making import documents, figures, frames, hand_page, pages, pictures
from docs.making.made import Made
from netlib.errors import NetlibError
from netlib.files.paths import ROOT
from tools.common.arguments import parser_of

# Pages for the browser are not in git, because they contain copies of their sources.
BUILT: dict[str, Callable[[], Iterator[Made]]] = {"hand_page": hand_page.made, "pages": pages.made}
PIECES: dict[str, Callable[[], Iterator[Made]]] = {
    "documents": documents.made, "figures": figures.made, "pictures": pictures.made, "frames": frames.made, **BUILT,
}


def main(argv: list[str] | None = None) -> int:
    """Write what has changed, and print its name; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("parts", metavar="PART", nargs="*", help=f"of {', '.join(PIECES)} (default: all)")
    parser.add_argument("--check", action="store_true", help="write nothing; status 1 if something is not current")
    args = parser.parse_args(argv)
    for part in args.parts:
        if part not in PIECES:
            parser.error(f"no part {part}; expected some of {', '.join(PIECES)}")
    found_old = False
    try:
        for part in args.parts or PIECES:
            for made in PIECES[part]():
                if args.check and not made.is_current():
                    found_old = True
                    print(f"not current: {made.path.relative_to(ROOT)}; run make docs", file=sys.stderr)
                elif not args.check and made.update():
                    print(f"wrote {made.path.relative_to(ROOT)}")
    except (OSError, ValueError, NetlibError) as error:  # a document names what is not there
        print(f"error: {error}", file=sys.stderr)
        return 1
    return int(found_old)


if __name__ == "__main__":
    sys.exit(main())
