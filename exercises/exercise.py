"""The definition of an exercise: a part of the project to write, the cases that check it and the known mistakes.

A *part* is what the reader writes, in the form that the project uses: a layer class, an update rule, a few functions.
A mistake is a part that is correct except for one thing. The reader's mistake is identified by running the known
mistakes on the same inputs until one reproduces the result of the reader's part.
"""

from __future__ import annotations

import contextlib
import functools
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from netlib.blob import Array

Part = Any  # a class, a function or several of them
Progress = Callable[[int], None]  # called with the number of iterations completed since the last call
Values = dict[str, Array]  # by their names in the docstring of the source


@dataclass(frozen=True, eq=False)
class Case:
    """One computation by a part.

    title      description of the inputs
    run        computes the results with a part
    wanted     computes the expected results
    source     where the expected results come from, for messages: "Caffe has"
    axes       names of the axes of each result, for the index in a message
    tolerance  relative to the largest value of the same array, or to 1 if that is larger; 0: bit for bit
    method     the reader's method that computes the results
    """

    title: str
    run: Callable[[Part], Values]
    wanted: Callable[[], Values]
    source: str
    axes: Mapping[str, Sequence[str]]
    tolerance: float
    method: str = ""

    @functools.cached_property
    def expected(self) -> Values:
        """The expected results."""
        with unwarned():
            return self.wanted()


@dataclass(frozen=True)
class Check:
    """A step: a group of cases."""

    title: str
    cases: tuple[Case, ...]


@dataclass(frozen=True)
class Mistake:
    """A part with one mistake, and the advice for a reader who makes the same mistake."""

    part: Part
    advice: str


def known(*parts: Part) -> tuple[Mistake, ...]:
    """Return Mistakes whose advice is the docstring of each part."""
    return tuple(Mistake(part, advice_of(part)) for part in parts)


def known_in(module: Mapping[str, Any], reference: type) -> tuple[Mistake, ...]:
    """Return the mistakes of a module, given its names: its public subclasses of the reference, in their order."""
    parts = (thing for name, thing in module.items() if not name.startswith("_") and isinstance(thing, type))
    return known(*(part for part in parts if issubclass(part, reference) and part.__module__ == module["__name__"]))


def advice_of(thing: Any) -> str:
    """Return the docstring of a class or function on one line."""
    return " ".join((thing.__doc__ or "").split())


@dataclass(frozen=True)
class Remedy:
    """A mistake that any part can contain: ``cured`` returns a corrected part, if this is its only mistake.

    looks_like  whether a wrong array can result from this mistake
    """

    cured: Callable[[Part], Part]
    advice: str
    looks_like: Callable[[Array], bool] = lambda got: True


@dataclass(frozen=True)
class Exercise:
    """An exercise.

    title      what to write, in a few words
    chapter    of the book
    file       the source that the stub is generated from, relative to the root of the project
    to_do      maps a function or method to its instructions, a comment in the stub
    keep       the top-level names of the source to include in the stub; empty: all
    names      what a reader's file must define; methods as ``Class.method``
    part_of    returns the part from the reader's module
    reference  the part in the project's source
    train      trains the paper's network with a part and returns the loss of each iteration
    last       title of the last step; {} is the number of iterations
    drift      allowed difference of the losses from the reference, as Case.tolerance
    """

    name: str
    title: str
    chapter: int
    file: str
    to_do: Mapping[str, str]
    names: tuple[str, ...]
    part_of: Callable[[Any], Part]
    reference: Part
    checks: tuple[Check, ...]
    mistakes: tuple[Mistake, ...]
    train: Callable[[Part, int, Progress], Array]
    keep: tuple[str, ...] = ()
    remedies: tuple[Remedy, ...] = ()
    last: str = "the paper's network, {} iterations: the losses agree with the reference"
    drift: float = 1e-3  # another order of summation changes float32 losses by less than a tenth of this


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


@contextlib.contextmanager
def unwarned() -> Iterator[None]:
    """Suppress warnings about overflow and other floating-point errors: the results are compared anyway."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def agree(got: Array, wanted: Array, tolerance: float) -> Array:
    """Return a mask of the elements of two arrays that agree to a tolerance. Non-finite elements must be equal."""
    finite = wanted[np.isfinite(wanted)]
    scale = max(1.0, float(np.abs(finite).max(initial=0)))
    with np.errstate(invalid="ignore"):
        near = np.abs(got - wanted) <= tolerance * scale
    return np.asarray(near | (got == wanted))


def first_difference(case: Case, got: Values) -> Difference | None:
    """Return the first result that differs, in the order of the expected ones, with the index of its first wrong
    element.
    """
    for name, right in case.expected.items():
        right, mine = np.asarray(right, np.float64), np.asarray(got[name], np.float64)
        if mine.shape != right.shape:
            return Difference(case, name, None, mine, right)
        wrong = np.argwhere(~agree(mine, right, case.tolerance))
        if len(wrong):
            return Difference(case, name, tuple(map(int, wrong[0])), mine, right, len(wrong))
    return None
