"""The page of a source file: on the left what its docstring says, aligned as it is; on the right the code.

Every line has the anchor that GitHub gives it (``#L40``), those of the docstring too. In a prototxt file the comment at
its head stands on the left. Sentences are set as flowing text; everything else keeps its columns.
"""

from __future__ import annotations

import ast
import functools
import posixpath
import re
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape

from docs.making.site.highlighting import coloured
from docs.making.site.published import Published, its_tests, twin_of

FILE_NAME = re.compile(r"(?<![\w./])[\w/]+\.(?:py|prototxt)(?!\w)")
CODE = "<!-- the code of this file -->"
NEWLINE = "\n"  # Python 3.10 takes no backslash inside an f-string
FILLED = 88  # columns; a paragraph with no line but its last shorter than this is flowing text
A_SENTENCE = 60  # columns; a single line that is no formula and longer than this is a sentence


@dataclass(frozen=True)
class Source:
    """A file in two parts: ``told``, the lines of its docstring, and ``lines``, all of them, beginning with line 1."""

    path: str
    text: str

    @property
    def lines(self) -> list[str]:
        """Without their ends."""
        return self.text.rstrip("\n").split("\n")

    @property
    def told(self) -> list[tuple[int, str]]:
        """Line numbers and text of what stands on the left, with the blank lines after it."""
        head = list(self._head() if self.path.endswith(".prototxt") else self._docstring())
        for number in range(head[-1][0] + 1 if head else len(self.lines) + 1, len(self.lines) + 1):
            if self.lines[number - 1].strip():
                break
            head.append((number, ""))
        return head

    @property
    def names(self) -> list[tuple[int, str]]:
        """Line and name of the functions, the classes and their methods; those with an underscore are left out."""
        if not self.path.endswith(".py"):
            return []
        found: list[tuple[int, str]] = []
        for node in ast.parse(self.text).body:
            if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and not node.name.startswith("_"):
                found.append((node.lineno, node.name))
                for method in node.body if isinstance(node, ast.ClassDef) else []:
                    if isinstance(method, ast.FunctionDef) and not method.name.startswith("_"):
                        found.append((method.lineno, f"{node.name}.{method.name}"))
        return found

    def first_line(self) -> str:
        """What the file is, in one line."""
        return next((line for _, line in self.told if line.strip()), "").strip()

    def _docstring(self) -> Iterator[tuple[int, str]]:
        body = ast.parse(self.text).body if self.path.endswith(".py") else []
        node = body[0].value if body and isinstance(body[0], ast.Expr) else None
        if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
            return
        lines = self.lines[node.lineno - 1 : node.end_lineno]
        lines[0] = re.sub(r'^[rR]?("""|\'\'\'|"|\')', "", lines[0])
        lines[-1] = re.sub(r'("""|\'\'\'|"|\')$', "", lines[-1])
        yield from enumerate(lines, node.lineno)

    def _head(self) -> Iterator[tuple[int, str]]:
        for number, line in enumerate(self.lines, 1):
            if not line.startswith("#"):
                return
            yield number, line.removeprefix("#").removeprefix(" ")


def page(source: Source, site: Published) -> str:
    """The HTML of the page of a file, with ``CODE`` where the code goes."""
    left = f"{_text(source, site)}\n{_facts(source, site)}".strip()
    beside = f'<div class="source-told">{left}</div>' if left else ""
    return (
        f'<h1 class="source-path">{_path(source.path, site)}</h1>\n'
        f'<div class="source{"" if left else " source-alone"}">{beside}\n{CODE}</div>'
    )


def code(source: Source, site: Published) -> str:
    """The HTML of its code, but for what stands on the left."""
    linked = functools.partial(_address, source.path, site)
    told = {number for number, _ in source.told}
    lines = enumerate(coloured("\n".join(source.lines), source.path, linked), 1)
    shown = "".join(_numbered(number, line) for number, line in lines if number not in told)
    return f'<div class="highlight source-code"><pre><code>{shown}</code></pre></div>'


def _address(path: str, site: Published, to: str) -> str | None:
    if to == path or to not in site.sources:
        return None
    return posixpath.relpath(site.page_of(to), posixpath.dirname(path) or ".")


def anchors(source: Source) -> set[str]:
    """What a link to the page may name."""
    return {f"L{number}" for number in range(1, len(source.lines) + 1)}


def _numbered(number: int, line: str) -> str:
    """One line of code. Its number is a link to itself, drawn by the style, so that it is not copied with the code."""
    return f'<span class="line" id="L{number}"><a href="#L{number}" data-n="{number}" tabindex="-1"></a>{line}\n</span>'


def _text(source: Source, site: Published) -> str:
    """What the docstring says: paragraphs, flowing or aligned."""
    folder = posixpath.dirname(source.path)

    def link(match: re.Match[str]) -> str:
        near, far = (_address(source.path, site, path) for path in (posixpath.join(folder, match[0]), match[0]))
        return f'<a href="{near or far}">{match[0]}</a>' if near or far else match[0]

    made = []
    for index, run in enumerate(_runs(source.told)):
        flows = _flows([line for _, line in run if line], alone=index == 0)
        spans = []
        for number, line in run:
            shown = FILE_NAME.sub(link, escape(line, quote=False))
            shown = re.sub(r"(`+)(.+?)\1", r"<code>\2</code>", shown) if flows else shown
            spans.append(f'<span id="L{number}">{shown}{NEWLINE if line else ""}</span>')
        made.append(f"<p>{''.join(spans)}</p>" if flows else f"<pre>{''.join(spans)}</pre>")
    return "\n".join(made)


def _flows(lines: list[str], alone: bool) -> bool:
    """Whether lines may be broken elsewhere: a paragraph that fills them, or a sentence; no formula, no columns."""
    if not lines or any(re.search(r"^ |\S {2,}\S", line) for line in lines):
        return False
    sentence = " = " not in lines[-1] and (lines[-1][-1] in ".:,;" or len(lines[-1]) >= A_SENTENCE)
    return all(len(line) >= FILLED for line in lines[:-1]) and (len(lines) > 1 or sentence or alone)


def _runs(told: list[tuple[int, str]]) -> Iterator[list[tuple[int, str]]]:
    """Lines that belong together: paragraphs, and in a paragraph what is indented apart from what is not.

    A blank line goes with those before it, so that it has its anchor.
    """
    run: list[tuple[int, str]] = []
    for number, line in told:
        if run and line.strip() and (not run[-1][1] or (line[0] == " ") != (run[-1][1][0] == " ")):
            yield run
            run = []
        run.append((number, line.rstrip()))
    if run:
        yield run


def _facts(source: Source, site: Published) -> str:
    """What is in the file, its tests, its twin in fast/, and the chapters that speak of it."""
    path = source.path

    def link(target: str, shown: str | None = None) -> str:
        address = posixpath.relpath(site.page_of(target), posixpath.dirname(path) or ".")
        return f'<a href="{address}">{escape(shown or target)}</a>'

    twin = twin_of(site.root, path)
    chapters = site.telling(path)
    if path.startswith("layers/") and "docs/layers.md" in site.documents and "docs/layers.md" not in chapters:
        chapters = [*chapters, "docs/layers.md"]
    rows = {
        "In it": _names(source),
        "Tests": [link(test) for test in its_tests(site.root, path) if test in site.sources],
        "Plain" if path.startswith("fast/") else "Fast twin": [link(twin)] if twin and twin in site.sources else [],
        "Told in": [link(chapter, site.title(chapter)) for chapter in chapters],
    }
    made = "".join(f"<dt>{name}</dt><dd>{'<br>'.join(links)}</dd>" for name, links in rows.items() if links)
    return f'<dl class="source-facts">{made}</dl>' if made else ""


def _names(source: Source) -> list[str]:
    """The functions and classes of the file, each a link to its line; those of a class on its own line of text."""
    made: list[str] = []
    for line, name in source.names:
        whole, _, own = name.rpartition(".")
        link = f'<a href="#L{line}"><code>{own}</code></a>'
        if whole:
            made[-1] += f" {link}"
        else:
            made.append(link)
    return made


def _path(path: str, site: Published) -> str:
    """The name of the file after its folders, each a link to its page."""
    *folders, name = path.split("/")
    made = []
    for depth, folder in enumerate(folders):
        whole = "/".join(folders[: depth + 1])
        address = posixpath.relpath(f"{whole}/index.html", posixpath.dirname(path))
        made.append(f'<a href="{address}">{folder}</a>' if whole in site.folders else folder)
    return " / ".join([*made, escape(name)])
