"""The blocks of a document as sybil's examples: each is run, parsed or compared by its tag, or has a reason not to.

```pycon      >>> and its output, which is compared
```python     run in the same namespace
```bash       run; if it is not, the arguments of this project's commands are checked all the same
```prototxt   read as a net, a solver, a skeleton or another message
```json       parsed
```text       not code; directly after a python or bash block that is run, its output

A comment directly above a block gives a condition:

<!-- not run: REASON -->   the block cannot run
<!-- code: FILE NAME -->   the block is taken from a file (docs/making/code_blocks.py), where it is tested
<!-- file: NAME -->        the block is a file of the reader's, which later blocks use

<!-- invisible-code-block: python
code that the reader need not see
-->
"""

from __future__ import annotations

import contextlib
import doctest
import io
import json
import re
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sybil import Document, Example, Region
from sybil.evaluators.doctest import DocTestEvaluator, DocTestRunner
from sybil.evaluators.python import PythonEvaluator, pad
from sybil.parsers.abstract.doctest import DocTestStringParser
from sybil.parsers.markdown.lexers import DirectiveInHTMLCommentLexer, RawFencedCodeBlockLexer

from netlib.errors import NetlibError
from tests.documents import commands, output, prototxts

TAGS = ("pycon", "python", "bash", "prototxt", "json", "text")
OF_FILES = ("js",)  # tags of code that is taken from a file, besides those
MARKS = ("not run", "code", "file")
FOLDER, PYTHON = "(folder)", "(python)"  # names in a document's namespace that blocks cannot use
OPTIONAL = ("av", "lmdb", "matplotlib", "onnx", "onnxruntime", "pydot", "rosbags", "torch", "tqdm")  # of extras
_FENCES = RawFencedCodeBlockLexer(re.compile(r"(?P<tag>[^\n]*)\n"))
_INVISIBLE = DirectiveInHTMLCommentLexer("invisible-code-block", arguments=".*?")
_ABOVE = re.compile(r"(?:^[ \t]*<!--(?:(?!-->).)*-->[ \t]*\n)+\Z", re.DOTALL | re.MULTILINE)
_MARK = re.compile(rf"^[ \t]*<!--\s*({'|'.join(MARKS)})\b:?\s*((?:(?!-->).)*?)\s*-->", re.DOTALL | re.MULTILINE)
# Formulas may be indented, without a fence; code that a reader would type may not.
_INDENTED = re.compile(
    r"^ {4,}(>>> |\$ |(python3?|pip|make|git|source|cd|bash) \S"
    r"|import \w|from \S+ import |(def|class) \w|layers? \{).*$",
    re.MULTILINE,
)
_LIST_ITEM = re.compile(r"\s*([-*+]|\d+[.)])\s")


@dataclass
class Block:
    """A fenced block: its tag, its text, the marks above it, and its output when it was run."""

    tag: str
    source: str
    marks: dict[str, str] = field(default_factory=dict)
    after: Block | None = None  # the block directly above, with nothing between
    printed: str | None = None


def parse(document: Document) -> Iterator[Region]:
    """Parse a document for sybil. Anything that is not a valid block becomes an example that fails."""
    last, last_end, marks_seen = None, 0, set()
    fenced = sorted(_FENCES(document), key=lambda region: region.start)
    for region in fenced:
        above = _ABOVE.search(document.text[: region.start])
        start = above.start() if above else region.start
        found = list(_MARK.finditer(document.text, start, region.start)) if above else []
        marks_seen |= {match.start() for match in found}
        follows = last if not document.text[last_end : region.start].strip() else None
        last, last_end = Block(region.lexemes["tag"].strip(), region.lexemes["source"],
                               {match[1]: match[2] for match in found}, follows), region.end
        if not re.search(r"(`{3,}|~{3,})\Z", document.text[region.start : region.end].rstrip()):
            yield _failing(region, "no fence ends this block")
        else:
            yield from _examples(document, region, last)
    for region in _INVISIBLE(document):
        region.parsed = region.lexemes["source"]
        tag = region.lexemes["arguments"].strip()
        region.evaluator = _run_python if tag == "python" else _fails(f"an invisible block of {tag!r} is not run")
        yield region
    yield from _strays(document, fenced, marks_seen)


def _examples(document: Document, region: Region, block: Block) -> Iterator[Region]:
    """Yield the examples of one block, or one that fails because of its tag or its marks."""
    marks = block.marks
    region.parsed, region.lexemes["block"] = region.lexemes["source"], block
    if block.tag not in (*TAGS, *(OF_FILES if "code" in marks else ())):
        known = ", ".join(TAGS)
        yield _failing(region, f"a block of {block.tag!r}: expected one of {known}" if block.tag else
                       f"a block without a tag: expected one of {known}")
    elif any(not words for words in marks.values()):
        yield _failing(region, f"{next(iter(marks))!r} above this block says nothing: <!-- not run: REASON -->")
    elif "not run" in marks or "code" in marks:
        region.evaluator = _NOT_RUN.get(block.tag, _nothing)
        yield region
    elif "file" in marks:
        used = re.search(rf"\b{re.escape(Path(marks['file']).stem)}\b", document.text[region.end :])
        region.evaluator = _write if used else _fails(f"no later block uses the file {marks['file']}")
        yield region
    elif block.tag == "pycon":
        found = list(_PYCON(block.source, document.path))
        if not found or not block.source.lstrip().startswith(">>>"):
            yield _failing(region, "a pycon block begins with >>>")
        for example in found:
            example.adjust(region, region.lexemes["source"])
            yield example
    else:
        region.evaluator = _EVALUATORS[block.tag]
        yield region


def _strays(document: Document, fenced: list[Region], marks_seen: set[int]) -> Iterator[Region]:
    """Yield failing examples for marks that are not above a block, and for code that is only indented."""

    def is_fenced(place: int) -> bool:
        return any(region.start <= place < region.end for region in fenced)

    for match in _MARK.finditer(document.text):
        if match.start() not in marks_seen and not is_fenced(match.start()):
            yield _failing(Region(match.start(), match.end()), f"{match[1]!r} stands directly above no block")
    comments = [(match.start(), match.end()) for match in re.finditer(r"<!--.*?-->", document.text, re.DOTALL)]
    for match in _INDENTED.finditer(document.text):
        before = document.text[: match.start()].rstrip("\n").splitlines()
        paragraph = next((line for line in reversed(before) if line[:1].strip()), "")
        in_comment = any(start < match.start() < end for start, end in comments)
        if not (is_fenced(match.start()) or in_comment or _LIST_ITEM.match(paragraph)):
            yield _failing(Region(match.start(), match.end()), "code that is only indented: fence it, with a tag")


def failures(path: Path, folder: Path, python: Path, names: dict[str, object]) -> Iterator[str]:
    """Run a document in the working folder ``folder``; yield a line and a reason for each block that fails.

    ``python`` is a folder with the program python; ``names`` exist before the first block.
    Raises ModuleNotFoundError for an optional package.
    """
    document = Document.parse(str(path), parse)
    document.namespace.update(names, **{"__name__": "__main__", FOLDER: folder, PYTHON: python})
    for example in document.examples():
        try:
            assert example.region.evaluator is not None
            problem = example.region.evaluator(example)
        except (Exception, SystemExit) as error:
            if _is_of_optional_package(error):
                raise
            problem = _described(error, str(path))
        if problem:
            yield f"line {example.line}: {problem.rstrip()}"


def _is_of_optional_package(error: BaseException) -> bool:
    return isinstance(error, ModuleNotFoundError) and error.name in OPTIONAL


def _described(error: BaseException, path: str) -> str:
    """Describe an error of a block in a few lines, with its place in the document."""
    if isinstance(error, (AssertionError, NetlibError, ValueError)) and not _lines_of(error, path):
        return str(error)
    return "".join([*_lines_of(error, path), *traceback.format_exception_only(error)])


def _lines_of(error: BaseException, path: str) -> list[str]:
    return [
        f"in line {frame.lineno}\n" for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path
    ]


# The check of each kind of block: a sybil evaluator returns the reason of a failure, or nothing.


def _nothing(example: Example) -> None:
    """Check nothing."""


def _fails(reason: str) -> Callable[[Example], str]:
    return lambda example: reason


def _failing(region: Region, reason: str) -> Region:
    return Region(region.start, region.end, evaluator=_fails(reason))


class _Runner(DocTestRunner):
    def __init__(self) -> None:
        super().__init__(0)
        self._checker = _Checker()

    def report_unexpected_exception(self, out: Any, test: Any, example: Any, exc_info: Any) -> None:
        if _is_of_optional_package(exc_info[1]):
            raise exc_info[1]
        super().report_unexpected_exception(out, test, example, exc_info)


class _Checker(doctest.OutputChecker):
    """Decide for doctest whether the output is the one shown."""

    def check_output(self, want: str, got: str, optionflags: int) -> bool:
        return not output.difference(want.replace("<BLANKLINE>", ""), got)

    def output_difference(self, example: doctest.Example, got: str, optionflags: int) -> str:
        return output.difference(example.want.replace("<BLANKLINE>", ""), got)


class _Pycon(DocTestEvaluator):
    def __init__(self) -> None:
        self.runner = _Runner()


_PYCON = DocTestStringParser(_Pycon())


def _block(example: Example) -> Block:
    block: Block = example.region.lexemes["block"]
    return block


def _run_python(example: Example) -> None:
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        PythonEvaluator()(example)
    if "block" in example.region.lexemes:  # else the block is invisible
        _block(example).printed = printed.getvalue()


def _check_commands(example: Example) -> str:
    return "\n".join(commands.mistakes(example.parsed, example.namespace[FOLDER]))


def _run_commands(example: Example) -> str:
    if wrong := _check_commands(example):
        return wrong
    _block(example).printed = commands.run(example.parsed, *(example.namespace[name] for name in (FOLDER, PYTHON)))
    return ""


def _read_prototxt(example: Example) -> None:
    prototxts.read(example.parsed, "the block")


def _read_json(example: Example) -> None:
    json.loads(example.parsed)


def _compile(example: Example) -> None:
    compile(pad(example.parsed, example.line), example.path, "exec")


def _compare(example: Example) -> str:
    """Compare the text after a block that was run with its output; other text is not checked."""
    after = _block(example).after
    return "" if after is None or after.printed is None else output.difference(example.parsed, after.printed)


def _write(example: Example) -> None:
    """Write a file of the reader's; if it is data, also read it."""
    file = example.namespace[FOLDER] / _block(example).marks["file"]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(example.parsed, encoding="utf-8")
    if _block(example).tag in ("prototxt", "json"):
        _EVALUATORS[_block(example).tag](example)


_NOT_RUN: dict[str, Callable[[Example], str | None]] = {"bash": _check_commands, "python": _compile}
_EVALUATORS: dict[str, Callable[[Example], str | None]] = {
    "python": _run_python, "bash": _run_commands, "prototxt": _read_prototxt, "json": _read_json, "text": _compare,
}
