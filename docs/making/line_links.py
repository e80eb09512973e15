"""Links to a line of the code: the title of a link names what stands there, ``make docs`` writes the line.

    [the gradient](../layers/hand/kinematics.py#L79 "Kinematics.backward")

symbols.py says which names there are. The first time the line may be left out. Titles of several words stay.
"""

from __future__ import annotations

import re
from pathlib import Path

from docs.making import symbols
from docs.making.made import place_of
from docs.making.markdown import Link, with_links
from netlib.errors import NetlibError, reason_of

MARK = re.compile(r'(#L\d+)? "[\w.]+"\)')  # what a document with such a link has


def current(text: str, document: Path) -> str:
    """The text of a document with the lines as they are now. Raises ValueError if a file has no such name."""

    def with_line(link: Link) -> str:
        name, _, anchor = link.target.partition("#")
        path = document.parent / name
        is_symbol = re.fullmatch(r"[\w.]+", link.title) and re.fullmatch(r"(L\d+)?", anchor)
        if not is_symbol or path.suffix not in symbols.SUFFIXES or not path.is_file():
            return link.target  # one that leads nowhere is another test's
        try:
            return f"{name}#L{symbols.line_of(path, link.title)}"
        except (OSError, SyntaxError, ValueError, NetlibError) as error:
            place = place_of(document, text, text.find(f'{link.target} "{link.title}"'))
            raise ValueError(f"{place}: {reason_of(error)}, which a link names") from None

    return with_links(text, with_line)
