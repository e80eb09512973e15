"""Explain the first difference: which element, its expected value, and the likely mistake."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np

from exercises.exercise import (
    Case,
    Check,
    Difference,
    Exercise,
    Part,
    Values,
    agree,
    first_difference,
)
from netlib.blob import Array

COMPARE = "Compare your code with the formulas at the top of the file."
NO_IDEA = f"This is not a known mistake. {COMPARE}"
UNWRITTEN = (
    "Some elements are NaN, their initial value. Write every element, with [...] = on the left."
)
UNASSIGNED = (
    "Some elements are NaN, their initial value: the diff of a bottom contains old values. backward must assign every "
    "element, also zeros, with bottom[0].diff[...] = ..., and must not add."
)
OVERWRITTEN = (
    "backward overwrites the diff of a parameter. It must add, with +=: the diff accumulates the gradients of several "
    "batches and of layers that share the parameter."
)
MAX_SHOWN = 12  # size up to which a result is shown in full
MAX_DIGITS = 17  # enough for any float64
FLOAT32_ERROR = 3e-7  # relative, of some operations
CONSTANT = 1e-5  # tolerance of a constant factor or offset
MIN_SHARE = 0.5  # of the wrong cases, which a similar mistake reproduces


def sentences(exercise: Exercise, check: Check, part: Part, found: Difference) -> Iterator[str]:
    """Yield what differs, then the likely reason."""
    yield _what_differs(found)
    otherwise = (check.hint or COMPARE) if check.option else NO_IDEA
    seen = f"{_pattern(found) or ''} {found.case.hint}".strip()
    yield advice(exercise, check, part, found) or seen or otherwise
    if found.index is not None:
        if where := where_wrong(found):
            yield where
        if 1 < found.got.size <= MAX_SHOWN:
            yield f"Found: {_listed(found.got)}; expected: {_listed(found.wanted)}."


def _listed(array: Array) -> str:
    """Format as nested lists, with up to six significant digits."""
    return f"[{', '.join(map(_listed, array))}]" if array.ndim else f"{float(array):.6g}"


def _what_differs(found: Difference) -> str:
    """Describe the first element that differs, or the shapes."""
    case = found.case
    where = f" ({case.title})" if case.title else ""
    if found.index is None:
        return (
            f"{found.name} has the shape {found.got.shape}, expected {found.wanted.shape}{where}."
        )
    letters = case.axes.get(found.name, "").split()
    index = ", ".join(map(str, found.index))
    if len(letters) == len(found.index):
        index = ", ".join(f"{letter}={i}" for letter, i in zip(letters, found.index))
    got, wanted = _distinct(float(found.got[found.index]), float(found.wanted[found.index]))
    place = f"{found.name}[{index}]" if index else found.name
    size, others = found.got.size, ""
    if found.count > 1:
        others = f"; the first of {found.count} elements of {size} that differ"
    elif size > 1:
        others = f"; the only one of {size} elements that differs"
    return f"{place} is {got}, {case.source} {wanted}{others}{where}."


def _distinct(a: float, b: float) -> tuple[str, str]:
    """Format two numbers with as many digits as needed to distinguish them, at least four."""
    for digits in range(4, MAX_DIGITS + 1):
        texts = f"{a:.{digits}g}", f"{b:.{digits}g}"
        if texts[0] != texts[1]:
            break
    return texts


def advice(exercise: Exercise, check: Check, part: Part, found: Difference) -> str | None:
    """Return the advice of the known mistake that reproduces the reader's results; None if
    there is none.

    Of several, the one that reproduces most wrong cases of the method in this step is chosen. One
    that reproduces only some of them, at least MIN_SHARE, is reported as a similar one.
    """
    mine = {case: tried(case, part) for case in check.cases if case.method == found.case.method}
    if not _reproduces(found, mine[found.case]):
        return "The value changes from call to call: draw random numbers from self.rng, never from np.random."
    right = [case for case, values in mine.items() if is_right(case, values)]
    differences = [first_difference(case, values) for case, values in mine.items() if values]
    wrong = [difference for difference in differences if difference]

    def share_explained(mistaken: Part) -> float:
        """Share of the wrong cases that a mistake reproduces; 0 if it breaks a case that the
        reader has right.
        """
        if not all(is_right(case, tried(case, mistaken)) for case in right):
            return 0.0
        if not _reproduces(found, tried(found.case, mistaken)):
            return 0.0
        return float(np.mean([_reproduces(other, tried(other.case, mistaken)) for other in wrong]))

    shares = {
        mistake: max(map(share_explained, mistake.parts(exercise))) for mistake in exercise.mistakes
    }
    # of equals the first: the most frequent one
    best = max(shares, key=shares.__getitem__, default=None)
    if best is None or shares[best] < MIN_SHARE:
        return None
    is_partial = shares[best] < 1
    return f"In some examples it looks like this: {best.advice}" if is_partial else best.advice


@functools.cache
def tried(case: Case, part: Part) -> Values | None:
    """Return the results of a case, or None if the part raises: it may contain another mistake."""
    try:
        return case.results(part)
    except BaseException:
        return None


def is_right(case: Case, values: Values | None) -> bool:
    """Return whether results agree with the expected ones; None does not."""
    return values is not None and first_difference(case, values) is None


def _reproduces(found: Difference, values: Values | None) -> bool:
    """Return whether results have the array of a difference, up to the tolerance of its case."""
    other = (values or {}).get(found.name)
    if other is None or other.shape != found.got.shape:
        return False
    both_nan = np.isnan(found.got) & np.isnan(other)
    return bool((agree(found.got, other, found.case.tolerance) | both_nan).all())


def where_wrong(found: Difference) -> str | None:
    """Describe the axes with wrong elements at no more than half of their indices; None if there is
    no such axis.
    """
    wrong = ~agree(found.got, found.wanted, found.case.tolerance)
    if wrong.sum() < 2:  # the message has the index of a single one
        return None
    letters = found.case.axes.get(found.name, "").split()
    if len(letters) != wrong.ndim:
        letters = [f"axis {k}" for k in range(wrong.ndim)]
    places = []
    for letter, size, indices in zip(letters, wrong.shape, map(np.unique, np.nonzero(wrong))):
        if len(indices) <= size // 2:
            relation = "=" if len(indices) == 1 else " in "
            places.append(f"{letter}{relation}{', '.join(map(str, indices))}")
    return f"Only elements with {', '.join(places)} are wrong." if places else None


def _pattern(found: Difference) -> str | None:
    """Describe the pattern of a difference that no known mistake reproduces."""
    got, wanted = found.got, found.wanted
    if found.index is None:
        is_reversed = got.ndim > 0 and got.shape == wanted.shape[::-1]
        return "The axes are in reverse order." if is_reversed else None
    if (np.isnan(got) & ~np.isnan(wanted)).any():
        return UNASSIGNED if found.case.method == "backward" else UNWRITTEN
    if np.isinf(got[found.index]) and np.isfinite(wanted[found.index]):
        return "It is infinite: a division by 0 or an overflow."
    if not np.isfinite(got).all() or not np.isfinite(wanted).all():
        return None
    if (got == 0).all():
        return (
            "All elements are 0: nothing was written into the array, or 0 overwrote it. An assignment to a name, y = "
            "... or dw = ..., changes no array: write y[...] = ..., and dw[...] += ... for a parameter."
        )
    return _relation(found) if wanted.size > 1 else None


def _relation(found: Difference) -> str | None:
    """Describe how all elements relate to the expected ones: by a factor or a constant."""
    got, wanted = found.got, found.wanted
    if found.case.tolerance < FLOAT32_ERROR and agree(got, wanted, FLOAT32_ERROR).all():
        return "The values are correct to the precision of float32 only. Use the type of the input arrays throughout."
    factor = float(np.vdot(got, wanted)) / max(float(np.vdot(wanted, wanted)), 1e-300)
    is_multiple = agree(got, factor * wanted, CONSTANT).all()
    if is_multiple and min(abs(factor), abs(factor - 1)) > CONSTANT:
        if abs(factor + 1) < CONSTANT:
            return "All elements have the wrong sign."
        return f"All elements are {factor:.5g} times the expected value: a factor is missing or superfluous."
    excess = got - wanted
    if found.case.method == "backward" and agree(excess, -np.ones(got.shape), CONSTANT).all():
        return OVERWRITTEN  # param diffs are initialized to 1
    first = float(excess.flat[0])
    tolerance = CONSTANT * max(1.0, float(np.abs(wanted).max()))
    if np.ptp(excess) <= tolerance < abs(first):
        return f"All elements exceed the expected value by {first:.5g}: a constant is superfluous or missing."
    return None
