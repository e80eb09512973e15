"""Code in colours, as HTML: Pygments knows most languages, prototxt is known here."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from html import escape

from pygments.lexers import get_lexer_for_filename
from pygments.token import STANDARD_TYPES
from pygments.util import ClassNotFound

Piece = tuple[str, str]  # the class that the theme colours it by, and the text
Linked = Callable[[str], str | None]  # the address of a file's page, seen from this one; None: it has none
PROTOTXT = re.compile(
    r"(?P<c1>#[^\n]*)|(?P<s2>\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*')|(?P<nt>[A-Za-z_]\w*)(?=\s*[:{])"
    r"|(?P<mf>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\b)|(?P<kc>\b(?:true|false|[A-Z][A-Z0-9_]+)\b)|(?P<p>[{}:\[\],])"
)
UNCOLOURED = {"", "n", "p", "w", "err"}  # names and punctuation: they look like plain text


def pieces(text: str, path: str) -> Iterator[Piece]:
    """The text of a file or of a block of code, in pieces of one colour. ``path`` says the language by its ending."""
    if path.endswith(".prototxt"):
        at = 0
        for match in PROTOTXT.finditer(text):
            yield "", text[at : match.start()]
            yield match.lastgroup or "", match[0]
            at = match.end()
        yield "", text[at:]
        return
    try:
        lexer = get_lexer_for_filename(path, stripnl=False, ensurenl=False)
    except ClassNotFound:
        yield "", text
        return
    for kind, run in itertools.groupby(lexer.get_tokens(text), key=lambda token: STANDARD_TYPES.get(token[0], "")):
        yield kind, "".join(value for _, value in run)  # the name of a module comes in pieces


def coloured(text: str, path: str, linked: Linked = lambda path: None) -> list[str]:
    """The HTML of each line. Imported modules that have a page are links to it."""
    lines = [""]
    for kind, value in pieces(text, path):
        for index, part in enumerate(value.split("\n")):
            if index:
                lines.append("")
            shown = escape(part, quote=False)
            if kind == "nn" and (address := linked(_file_of(part) + ".py") or linked(_file_of(part) + "/__init__.py")):
                shown = f'<a href="{address}">{shown}</a>'
            if part.strip() and kind not in UNCOLOURED:
                shown = f'<span class="{kind}">{shown}</span>'
            lines[-1] += shown
    return lines


def _file_of(module: str) -> str:
    return module.replace(".", "/")
