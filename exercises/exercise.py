"""What an exercise is: a part of this project to be written, cases that check it, mistakes that are known.

A *part* is what the reader writes, as the rest of the project uses it: a layer class, an update rule, a few functions.
A mistake is such a part, too: one that works, but for one thing. So the reader's mistake is found by running the known
ones on the same numbers, until one gives what the reader's part gave.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from netlib.blob import Array

Part = Any  # a class, a function, or a few of them
Tell = Callable[[int], None]  # that so many iterations more are done
Values = dict[str, Array]  # by the name that the docstring of the source gives them


@dataclass(frozen=True, eq=False)
class Case:
    """One computation that a part makes.

    title      what is computed, in a few words
    run        what the part computes
    wanted     what it should be; it is given the part, for its own differences
    source     who says so: "Caffe"
    axes       names of the axes of each result, for the index in a message
    tolerance  relative to the largest number of the same array, or to 1 if that is larger; 0: bit for bit
    method     which of the reader's methods has computed it
    """

    title: str
    run: Callable[[Part], Values]
    wanted: Callable[[Part], Values]
    source: str
    axes: Mapping[str, Sequence[str]]
    tolerance: float
    method: str = ""


@dataclass(frozen=True)
class Check:
    """A step: cases of one kind."""

    title: str
    cases: tuple[Case, ...]


@dataclass(frozen=True)
class Mistake:
    """A part with one mistake in it, and what is said to a reader who has made the same."""

    part: Part
    advice: str


def known(*parts: Part) -> tuple[Mistake, ...]:
    """Mistakes of which the docstring is what is said to the reader."""
    return tuple(Mistake(part, advice_of(part)) for part in parts)


def advice_of(thing: Any) -> str:
    """The docstring of a class or function, in one line."""
    return " ".join((thing.__doc__ or "").split())


@dataclass(frozen=True)
class Remedy:
    """A mistake of a kind that any part can have: ``cured`` makes the part right, if it is the only one.

    looks_like  can the array, with what is wrong in it, come from this mistake
    """

    cured: Callable[[Part], Part]
    advice: str
    looks_like: Callable[[Array], bool] = lambda got: True


@dataclass(frozen=True)
class Exercise:
    """An exercise.

    title     what is to be written, in a few words
    chapter   of the book
    file      the source that the stub is made of, from the root of the project
    to_do     function or method -> what has to be done, as a comment in the stub
    keep      the top-level names of the source that the stub has; none: all
    names     what a reader's file must have; methods as ``Class.method``
    part_of   the part in the reader's module
    ours      the part in our source
    train     the losses of so many iterations of the paper's network with a part in place of ours
    last      what the last step is called; {} is the number of iterations
    drift     by how much losses may differ from ours at the end, as a Case's tolerance
    """

    name: str
    title: str
    chapter: int
    file: str
    to_do: Mapping[str, str]
    names: tuple[str, ...]
    part_of: Callable[[Any], Part]
    ours: Part
    checks: tuple[Check, ...]
    mistakes: tuple[Mistake, ...]
    train: Callable[[Part, int, Tell], Array]
    keep: tuple[str, ...] = ()
    remedies: tuple[Remedy, ...] = ()
    last: str = "the paper's network, {} iterations with yours in it: the losses are those with ours"
    drift: float = 1e-3  # sums in another order drift apart, in float32 by less than a tenth of it


@dataclass(frozen=True)
class Difference:
    """Where a result is not what it should be.

    name   of the result
    index  of the first element that differs; None if the shape does
    got, wanted  the arrays
    count  how many elements differ
    """

    case: Case
    name: str
    index: tuple[int, ...] | None
    got: Array
    wanted: Array
    count: int = 0


@contextlib.contextmanager
def unwarned() -> Iterator[None]:
    """Within it nothing is said of numbers that overflow, and the like: what a part computes is compared."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def agree(got: Array, wanted: Array, tolerance: float) -> Array:
    """Which elements of two arrays of one shape are the same, to a tolerance. What is not finite must be the same."""
    finite = wanted[np.isfinite(wanted)]
    scale = max(1.0, float(np.abs(finite).max(initial=0)))
    with np.errstate(invalid="ignore"):
        near = np.abs(got - wanted) <= tolerance * scale
    return np.asarray(near | (got == wanted))


def first_difference(case: Case, got: Values, wanted: Values) -> Difference | None:
    """The first result, in the order of ``wanted``, that differs, and its first element that does."""
    for name, right in wanted.items():
        right, mine = np.asarray(right, np.float64), np.asarray(got[name], np.float64)
        if mine.shape != right.shape:
            return Difference(case, name, None, mine, right)
        wrong = np.argwhere(~agree(mine, right, case.tolerance))
        if len(wrong):
            return Difference(case, name, tuple(map(int, wrong[0])), mine, right, len(wrong))
    return None
