"""Links to a line of the code: the title of a link names what stands there, ``make docs`` writes the line.

    [the gradient](../layers/hand/kinematics.py#L79 "Kinematics.backward")

symbols.py says which names there are. The first time the line may be left out. Code, and titles of several words, stay.
"""

from __future__ import annotations

import re
from pathlib import Path

from docs.making import symbols
from docs.making.made import place_of
from netlib.errors import NetlibError, reason_of

MARK = re.compile(r'\]\((?!https?:)([^)\s#]+)(?:#L\d+)? "([\w.]+)"\)')
CODE = re.compile(r"(^```.*?^```$|`[^`\n]+`)", re.MULTILINE | re.DOTALL)


def current(text: str, document: Path) -> str:
    """The text of a document with the lines as they are now. Raises ValueError if a file has no such name."""

    def with_line(match: re.Match[str]) -> str:
        path = document.parent / match[1]
        if path.suffix not in symbols.SUFFIXES or not path.is_file():  # a link that leads nowhere is another test's
            return match[0]
        try:
            return f']({match[1]}#L{symbols.line_of(path, match[2])} "{match[2]}")'
        except (OSError, SyntaxError, ValueError, NetlibError) as error:
            place = place_of(document, text, text.find(match[0]))
            raise ValueError(f"{place}: {reason_of(error)}, which a link names") from None

    pieces = CODE.split(text)
    pieces[::2] = [MARK.sub(with_line, piece) for piece in pieces[::2]]
    return "".join(pieces)
