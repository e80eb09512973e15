"""The page of a source file: what it is, its tests, the documents that link to it, and the code by Pygments.

Every line of the code has the anchor that GitHub gives it (``#L40``).
"""

from __future__ import annotations

import ast
import posixpath
from typing import Any, ClassVar

from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexer import RegexLexer
from pygments.lexers import get_lexer_for_filename
from pygments.token import Comment, Keyword, Name, Number, Punctuation, String, Text
from pygments.util import ClassNotFound

from docs.making.site.published import Published, its_tests

CODE = "<!-- the code of this file -->"
_LINES = HtmlFormatter(linenos="table", lineanchors="L", anchorlinenos=True, wrapcode=True)


class PrototxtLexer(RegexLexer):  # type: ignore[misc]  # Pygments has no types
    """Protocol buffers' text format, which Pygments does not have."""

    name = "prototxt"
    tokens: ClassVar[dict[str, Any]] = {
        "root": [
            (r"#[^\n]*", Comment.Single),
            (r"\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'", String.Double),
            (r"[A-Za-z_]\w*(?=\s*[:{])", Name.Tag),
            (r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\b", Number.Float),
            (r"\b(?:true|false|[A-Z][A-Z0-9_]+)\b", Keyword.Constant),
            (r"[{}:\[\],]", Punctuation),
            (r"\w+|\s+|.", Text),
        ]
    }


def page(path: str, text: str, site: Published) -> str:
    """The Markdown of the page, with ``CODE`` where the code goes."""
    folder = posixpath.dirname(path) or "."
    documents = [(site.title(document), document) for document in site.telling(path)]
    tests = [(test, test) for test in its_tests(site.root, path) if test in site.sources]
    lines = [f"# {path}", first_line(path, text)]
    for name, found in (("Tests", tests), ("Described in", documents)):
        links = ", ".join(f"[{escaped(title)}]({posixpath.relpath(to, folder)})" for title, to in found)
        lines += [f"{name}: {links}"] if links else []
    return "\n\n".join([*lines, CODE]) + "\n"


def code(path: str, text: str) -> str:
    """The HTML of the code, with a number and an anchor for each line."""
    try:
        lexer = (
            PrototxtLexer(stripnl=False) if path.endswith(".prototxt") else get_lexer_for_filename(path, stripnl=False)
        )
    except ClassNotFound:
        lexer = get_lexer_for_filename("x.txt")
    return highlight(text, lexer, _LINES).replace('"L-', '"L').replace('"#L-', '"#L')


def first_line(path: str, text: str) -> str:
    """What the file is: the first line of its docstring, or of the comment at the head of a prototxt file."""
    if path.endswith(".py"):
        return escaped((ast.get_docstring(ast.parse(text)) or "").partition("\n")[0])
    return escaped(text.partition("\n")[0].lstrip("# ")) if path.endswith(".prototxt") and text[:1] == "#" else ""


def escaped(text: str) -> str:
    """Text without Markdown's marks, but for code between backquotes."""
    parts = text.replace("``", "`").split("`")
    if len(parts) % 2 == 0:
        return _plain(text)
    return "`".join(part if index % 2 else _plain(part) for index, part in enumerate(parts))


def _plain(text: str) -> str:
    for mark in "\\`*_[]|":
        text = text.replace(mark, "\\" + mark)
    return text.replace("<", "&lt;")
