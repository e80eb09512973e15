"""The list of the exercises and an example in docs/exercises/README.md.

Between ``<!-- exercises: NAME -->`` and ``<!-- end -->`` stands what NAME makes: ``list`` or ``example``.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from pathlib import Path

from docs.making.made import place_of
from docs.making.markdown import title_of
from exercises.check import steps
from exercises.table import EXERCISES
from netlib.files.paths import ROOT

MARK = re.compile(r"^<!-- exercises: (\w+) -->\n(?:.*?^(<!-- end -->)\n)?", re.MULTILINE | re.DOTALL)


def current(text: str, document: Path) -> str:
    """The text of a document with the list and the example as they are now. Raises ValueError for another mark."""
    return MARK.sub(functools.partial(_between_marks, document), text)


def _between_marks(document: Path, match: re.Match[str]) -> str:
    place, known = place_of(document, match.string, match.start()), {"list": _list, "example": _example}
    if match[1] not in known:
        raise ValueError(f"{place}: no {match[1]!r} is made; expected {' or '.join(known)}")
    if match[0].count("<!-- exercises:") > 1 or not match[2]:
        raise ValueError(f"{place}: this mark has no <!-- end -->")
    lines = known[match[1]]()
    return f"<!-- exercises: {match[1]} -->\n" + "\n".join(lines) + "\n<!-- end -->\n"


def _list() -> Iterator[str]:
    """A table in the order of the book."""
    yield "| | exercise | to implement | chapter |"
    yield "|---|---|---|---|"
    for number, e in enumerate(EXERCISES.values(), 1):
        names = ", ".join(f"`{name.rpartition('.')[2]}`" for name in e.to_do)
        yield f"| {number} | {e.name} | {e.title} ({names}) | {_chapter(e.chapter)} |"


def _chapter(number: int) -> str:
    """A link to the chapter by its title, to the book where there is no such chapter yet."""
    for path in sorted((ROOT / "docs" / "book").glob(f"{number}_*.md")):
        return f"[{title_of(path.read_text(encoding='utf-8'))}](../book/{path.name})"
    return f"[{number}](../book/README.md)"


def _example() -> Iterator[str]:
    """What is printed of a ReLU whose gradient at 0 is 1, its third known mistake."""
    exercise = EXERCISES["relu"]
    [part] = exercise.mistakes[2].parts(exercise)
    yield "```text"
    for step in steps(exercise, part):
        yield step.report()
    yield "```"
