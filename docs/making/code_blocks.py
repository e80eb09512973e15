"""The code that documents show, taken from its file: a comment names it, ``make docs`` puts it under the comment.

    <!-- code: layers/common/inner_product.py InnerProduct.forward InnerProduct.backward -->
    ```python
    ...
    ```

Names are functions, classes, methods or constants of the file, in the order in which they are shown; ``docstring`` is
that of the module. No name: the whole file. Methods lose their indentation.
"""

from __future__ import annotations

import ast
import functools
import re
import textwrap
from pathlib import Path

from docs.making.made import place_of
from docs.making.symbols import statement_of
from netlib.errors import reason_of
from netlib.files.paths import ROOT

MARK = re.compile(r"^<!-- code: (\S+\.\w+)((?: [\w.]+)*) -->\n(```(\w*)\n.*?^```(?:\n|\Z))?", re.MULTILINE | re.DOTALL)
LANGUAGES = {".py": "python", ".prototxt": "prototxt", ".js": "js"}


def current(text: str, document: Path) -> str:
    """The text of a document with the code as it is now. Raises ValueError if a file has no such name."""
    return MARK.sub(functools.partial(_told, document), text)


def _told(document: Path, match: re.Match[str]) -> str:
    try:
        if match[3] is None and match.string.startswith("```", match.end()):
            raise ValueError("the block under this mark has no end: expected ``` alone on a line")
        if match[3] and re.search(r"^```.", match[3].partition("\n")[2], re.MULTILINE):  # the next one begins in it
            raise ValueError("the block under this mark has no end before the next begins")
        return _shown(match)
    except (OSError, SyntaxError, ValueError) as error:
        raise ValueError(f"{place_of(document, match.string, match.start())}: {reason_of(error)}") from error


def _shown(match: re.Match[str]) -> str:
    name, wanted = match[1], match[2].split()
    path = ROOT / name
    if not path.resolve().is_relative_to(ROOT):
        raise ValueError(f"{name} is no file of this project")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"cannot read {name}: {reason_of(error)}") from error
    if wanted and path.suffix != ".py":
        raise ValueError(f"{name} has no names to show a part by: only Python files have")
    pieces = [piece_of(text, one, name) for one in wanted] or [text]
    language = LANGUAGES.get(path.suffix, "")
    body = "\n\n".join(piece.rstrip("\n") for piece in pieces)
    return f"<!-- code: {name}{match[2]} -->\n```{language}\n{body}\n```\n"


def piece_of(text: str, wanted: str, name: str) -> str:
    """The lines of one function, class, method or constant of a Python file, with decorators, dedented.

    Raises ValueError if the file has no such name.
    """
    tree = ast.parse(text)
    if wanted == "docstring":
        return f'"""{ast.get_docstring(tree, clean=False)}"""'
    found = statement_of(tree, wanted, name)
    decorators = found.decorator_list if isinstance(found, (ast.FunctionDef, ast.ClassDef)) else []
    first = min([found.lineno, *(decorator.lineno for decorator in decorators)])
    return textwrap.dedent("\n".join(text.splitlines()[first - 1 : found.end_lineno]))


def shown_files(path: Path) -> set[str]:
    """The files whose code a document shows."""
    return {match[1] for match in MARK.finditer(path.read_text(encoding="utf-8"))}
