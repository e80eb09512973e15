"""Run the blocks of a document with sybil, by their tag.

pycon      >>> and its output, which is compared
python     run in the same namespace
bash       run in the same folder
prototxt   read as a net, a solver, a skeleton or another message
json       parsed
text       not code; directly after a python or bash block that is run, its output

A comment directly above a block gives a condition: ``<!-- not run: REASON -->``, of commands the
arguments are checked all the same; ``<!-- file: NAME -->``, a file of the reader's, which later
blocks use. Blocks that cog generates come from files that other tests run.
"""

from __future__ import annotations

import contextlib
import dataclasses
import doctest
import io
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

from sybil import Document, Example, Region
from sybil.evaluators.doctest import NUMBER, DocTestEvaluator, OutputChecker
from sybil.evaluators.python import PythonEvaluator, pad
from sybil.parsers.abstract.doctest import DocTestStringParser
from sybil.parsers.markdown.lexers import RawFencedCodeBlockLexer

from handpose.synthetic.prior_parameters import PosePrior
from layers.hand.skeleton_file import SkeletonParameter
from netlib.building import create
from netlib.proto import messages, options, prototxt, schema
from netlib.proto.messages import LayerParameter, NetParameter, SolverParameter
from netlib.proto.net_parameter import load_parameter
from tests.documents import commands

# in a document's namespace: its folder; the output of blocks, by their end
FOLDER, PRINTED = "(folder)", "(printed)"
FENCES = RawFencedCodeBlockLexer(re.compile(r"(?P<tag>[^\n]*)\n"))
GENERATED = re.compile(r"^<!--cog .*?^<!--end-->", re.DOTALL | re.MULTILINE)
MARK = re.compile(r"^[ \t]*<!-- (not run|file): ((?:(?!-->).)+) -->\n\Z", re.DOTALL | re.MULTILINE)


def parse(document: Document) -> Iterator[Region]:
    """The examples of a document. Raises ValueError for a block that cannot be one."""
    generated = [found.span() for found in GENERATED.finditer(document.text)]
    for region in FENCES(document):
        if any(start < region.start < end for start, end in generated):
            continue
        tag, region.parsed = region.lexemes["tag"].strip(), region.lexemes["source"]
        mark = MARK.search(document.text[: region.start])
        region.lexemes["file"] = mark[2] if mark and mark[1] == "file" else ""
        evaluators = NOT_RUN if mark and mark[1] == "not run" else RUN
        if tag not in RUN:
            raise ValueError(
                f"{document.path}: a block of {tag!r}; expected one of {', '.join(RUN)}"
            )
        if tag == "pycon" and not region.parsed.lstrip().startswith(">>>"):
            raise ValueError(f"{document.path}: a pycon block begins with >>>")
        if tag != "pycon" or evaluators is NOT_RUN:
            region.evaluator = _write if region.lexemes["file"] else evaluators[tag]
            yield region
            continue
        for example in SESSIONS(region.parsed, document.path):
            example.adjust(region, region.parsed)
            yield example


def failures(path: Path, folder: Path, names: dict[str, object]) -> Iterator[str]:
    """Run a document in the working folder ``folder``; yield a line and a reason for each
    block that fails.

    ``names`` exist before the first block. Raises ModuleNotFoundError for a missing package.
    """
    document = Document.parse(str(path), parse)
    document.namespace.update(names, **{"__name__": "__main__", FOLDER: folder, PRINTED: {}})
    for example in document.examples():
        assert example.region.evaluator is not None
        try:
            problem = example.region.evaluator(example)
        except ModuleNotFoundError:
            raise
        except (Exception, SystemExit) as error:
            problem = f"{type(error).__name__}: {error}"
        if problem:
            yield f"line {example.line}: {problem.rstrip()}"


class _Checker(OutputChecker):
    """Compares output: white space is ignored, numbers agree to the digits shown, ``1.`` in an
    array to 1e-4.

    ``…`` matches anything; in an output with one, numbers are compared as text.
    """

    def check_output(self, want: str, got: str, optionflags: int = 0) -> bool:
        wanted, found = (
            re.sub(r"(?<=[\[(]) | (?=[\]),])", "", " ".join(text.split())) for text in (want, got)
        )
        if "…" in wanted:
            return wanted != "…" and super().check_output(
                wanted.replace("…", "..."), found, doctest.ELLIPSIS
            )
        wanted = re.sub(r"(?<=\d)\.(?!\d)", ".0000", wanted.replace("<BLANKLINE>", ""))
        return super().check_output(" ".join(wanted.split()), found, NUMBER)


CHECKER = _Checker()
EVALUATOR = DocTestEvaluator()
EVALUATOR.runner._checker = CHECKER  # type: ignore[attr-defined]
SESSIONS = DocTestStringParser(EVALUATOR)


def _run_python(example: Example) -> None:
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        PythonEvaluator()(example)
    example.namespace[PRINTED][example.end] = printed.getvalue()


def _run_commands(example: Example) -> None:
    example.namespace[PRINTED][example.end] = commands.run(
        example.parsed, example.namespace[FOLDER]
    )


def _check_commands(example: Example) -> str:
    """Check the arguments of commands that are not run."""
    return "\n".join(commands.mistakes(example.parsed))


def _compare(example: Example) -> str:
    """Compare the text after a block that was run with its output; other text is not checked."""
    before = len(example.document.text[: example.start].rstrip())
    printed = example.namespace[PRINTED].get(before)
    if printed is None or CHECKER.check_output(example.parsed, printed):
        return ""
    return f"shown and printed differ\n  shown:\n{example.parsed}\n  printed:\n{printed}"


def _write(example: Example) -> None:
    """Write a file of the reader's; if it is data, also read it."""
    name = example.region.lexemes["file"]
    (example.namespace[FOLDER] / name).write_text(example.parsed, encoding="utf-8")
    if name.endswith(".prototxt"):
        _read_prototxt(example.parsed)


def _read_prototxt(text: str) -> None:
    """Read the message whose fields the text has. Raises PrototxtError, NetlibError."""
    tree = prototxt.parse(text, "the block")
    names = {item.name for item in tree.fields}
    if names & {"layer", "layers"}:
        layers = load_parameter(tree).layer  # the blobs that they read need not be defined
    else:
        others = [
            kind
            for kind in vars(messages).values()
            if isinstance(kind, type) and dataclasses.is_dataclass(kind)
        ]
        kinds = [
            SkeletonParameter,
            SolverParameter,
            NetParameter,
            PosePrior,
            LayerParameter,
            *others,
            *options.option_blocks().values(),
        ]
        message = schema.read(tree, min(kinds, key=lambda kind: len(names - _fields(kind))))
        layers = [message] if isinstance(message, LayerParameter) else []
    for layer in layers:
        assert layer.type in {None, "", "Python", *options.layer_types()}, (
            f"unknown layer type {layer.type!r}"
        )
        create.check_options(layer)


def _fields(kind: type) -> set[str]:
    """The names of a message's fields in a prototxt."""
    blocks = set(options.option_blocks()) if kind is LayerParameter else set()
    return {schema.written_name(field.name) for field in dataclasses.fields(kind)} | blocks


def _nothing(example: Example) -> None:
    """Check nothing."""


def _compile(example: Example) -> None:
    compile(pad(example.parsed, example.line), example.path, "exec")


RUN: dict[str, Callable[[Example], str | None]] = {
    "pycon": _nothing,  # by SESSIONS
    "python": _run_python,
    "bash": _run_commands,
    "prototxt": lambda example: _read_prototxt(example.parsed),
    "json": lambda example: json.loads(example.parsed) and None,
    "text": _compare,
}
NOT_RUN = {**dict.fromkeys(RUN, _nothing), "python": _compile, "bash": _check_commands}
