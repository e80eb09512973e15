"""The definition of an exercise: a part of the project to write, the cases that check it and the
known mistakes.

A *part* is a module with what the reader writes: a layer class, an update rule, a few functions. A
mistake is the project's source with one change. The reader's mistake is identified by running the
known mistakes on the same inputs until one reproduces the results of the reader's part.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import itertools
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from netlib import files
from netlib.blob import Array
from netlib.errors import NetlibError
from netlib.files.paths import own

Part = Any  # a module with the names of the project's
Values = dict[str, Array]  # results by their names in the docstring of the source


class ExerciseError(NetlibError):
    """Raised if a reader's file cannot be read, written or checked."""


@dataclass(frozen=True, eq=False)
class Case:
    """One computation by a part.

    title      description of the inputs
    run        computes the results with a part
    wanted     computes the expected results
    source     where the expected results come from, for messages: "Caffe has"
    axes       names of the axes of each result, such as "pose joint xyz", for messages
    tolerance  relative to the largest value of the same array, or to 1 if that is larger;
               0: bit for bit
    method     the reader's function that computes the results
    hint       what a difference means if it is no known mistake
    """

    title: str
    run: Callable[[Part], Values]
    wanted: Callable[[], Values]
    source: str
    axes: Mapping[str, str]
    tolerance: float
    method: str
    hint: str = ""

    @functools.cached_property
    def expected(self) -> Values:
        """The expected results."""
        with unwarned():
            return {name: np.asarray(array, np.float64) for name, array in self.wanted().items()}

    def results(self, part: Part) -> Values:
        """Return the results of a part. Passes on its exceptions."""
        with unwarned():
            found = self.run(part)
            return {name: np.asarray(found[name], np.float64) for name in self.expected}


@dataclass(frozen=True, eq=False)
class Check:
    """A step: a group of cases.

    option  what the cases need beyond the steps without an option: "stride: 2"; empty: nothing
    hint    what a part must do for the option
    """

    title: str
    cases: tuple[Case, ...]
    option: str = ""
    hint: str = ""


class Mistake:
    """A mistake, and the advice for a reader who makes it.

    forms  pairs (old, new): code that occurs once in the project's source, and the mistake in its
           place, as for ``edited``. A mistake has several forms if its results differ, say in a
           loop over windows and in one over images
    """

    def __init__(self, advice: str, *forms: tuple[str, str]) -> None:
        self.advice, self.forms = advice, forms

    def sources(self, exercise: Exercise) -> list[str]:
        """Return the project's source with each form of the mistake.

        Raises ValueError if it cannot be placed.
        """
        text = exercise.source()
        return [edited(text, old, new) for old, new in self.forms]

    @functools.cache  # noqa: B019  mistakes are constants of a module
    def parts(self, exercise: Exercise) -> list[Part]:
        """Return a part with each form of the mistake."""
        return [
            module_of(text, exercise.file, f"a mistake of {exercise.name}")
            for text in self.sources(exercise)
        ]


@dataclass(frozen=True, eq=False)
class Exercise:
    """An exercise.

    title      what to write, in a few words
    chapter    of the book
    file       the source that the stub is generated from, relative to the root of the project
    to_do      maps a function or ``Class.method`` to its instructions, a comment in the stub
    train      trains the paper's network with a part and returns the loss of each iteration
    end        text of the source before which the stub ends; empty: the stub has all of it
    last       title of the last step; {} is the number of iterations
    drift      allowed difference of the losses from the reference, as Case.tolerance
    """

    name: str
    title: str
    chapter: int
    file: str
    to_do: Mapping[str, str]
    checks: tuple[Check, ...]
    mistakes: tuple[Mistake, ...]
    train: Callable[[Part, int], Array]
    end: str = ""
    last: str = "the paper's network, {} iterations: the losses agree with the reference"
    # another order of summation changes float32 losses by less than a tenth of this
    drift: float = 1e-3

    def source(self) -> str:
        """Return the project's source. Raises DataError if it cannot be read."""
        return files.read_text(own(self.file), "the source")

    def losses(self, part: Part, iterations: int) -> Array:
        """Train the paper's network with a part. Passes on its exceptions."""
        with unwarned():
            return np.asarray(self.train(part, iterations), np.float64)


@dataclass(frozen=True)
class Difference:
    """A result that differs from the expected one.

    name         of the result
    index        of the first element that differs; None if the shapes differ
    got, wanted  the arrays
    count        number of elements that differ
    """

    case: Case
    name: str
    index: tuple[int, ...] | None
    got: Array
    wanted: Array
    count: int = 0


def edited(text: str, old: str, new: str) -> str:
    """Return Python source with other code in place of ``old``, an expression or whole statements.

    Code is found by its syntax, in any layout; ``new`` is indented like it. Raises ValueError if it
    is not there once.
    """
    nodes = [*ast.walk(ast.parse(text))]
    statements: list[Any] = ast.parse(old).body

    def only(statement: Any) -> Any:
        """Return the node of the source with the syntax of a statement, or of the expression that
        it consists of.
        """
        wanted = ast.dump(statement.value if isinstance(statement, ast.Expr) else statement)
        found = [node for node in nodes if ast.dump(node) == wanted]
        if len(found) != 1:
            raise ValueError(f"{len(found)} times {ast.unparse(statement)!r}; expected once")
        return found[0]

    first, last = only(statements[0]), only(statements[-1])
    code = text.encode()  # columns count bytes
    starts = [0, *itertools.accumulate(map(len, code.splitlines(keepends=True)))]
    begin = starts[first.lineno - 1] + first.col_offset
    end = starts[last.end_lineno - 1] + last.end_col_offset
    indented = new.replace("\n", "\n" + " " * first.col_offset)
    return (code[:begin] + indented.encode() + code[end:]).decode()


def module_of(text: str, path: str, name: str) -> ModuleType:
    """Execute the text of a module, whose name is no module of the project."""
    module = ModuleType(name)
    sys.modules.setdefault(module.__name__, module)  # dataclasses look up the module of a class
    exec(compile(text, path, "exec", dont_inherit=True), vars(module))
    return module


@contextlib.contextmanager
def replaced(table: MutableMapping[str, Any], key: str, value: object) -> Iterator[None]:
    """Replace an entry of a table, such as the class of a layer type, within the context."""
    before, table[key] = table[key], value
    try:
        yield
    finally:
        table[key] = before


@contextlib.contextmanager
def unwarned() -> Iterator[None]:
    """Suppress warnings about overflow and other floating-point errors: the results are
    compared anyway.
    """
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def agree(got: Array, wanted: Array, tolerance: float) -> Array:
    """Return a mask of the elements of two arrays that agree to a tolerance.

    Non-finite elements must be equal.
    """
    finite = wanted[np.isfinite(wanted)]
    scale = max(1.0, float(np.abs(finite).max(initial=0)))
    with np.errstate(invalid="ignore"):
        near = np.abs(got - wanted) <= tolerance * scale
    return np.asarray(near | (got == wanted))


def first_difference(case: Case, got: Values) -> Difference | None:
    """Return the first result that differs, in the order of the expected ones, with the index of
    its first wrong element.
    """
    for name, wanted in case.expected.items():
        mine = got[name]
        if mine.shape != wanted.shape:
            return Difference(case, name, None, mine, wanted)
        wrong = np.argwhere(~agree(mine, wanted, case.tolerance))
        if len(wrong):
            return Difference(case, name, tuple(map(int, wrong[0])), mine, wanted, len(wrong))
    return None
