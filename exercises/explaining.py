"""Explain the first difference: which element, its expected value, and the likely mistake."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from exercises.exercise import (
    Case,
    Difference,
    Exercise,
    Mistake,
    Remedy,
    Values,
    agree,
    first_difference,
    unwarned,
)
from exercises.runner import Runner, results
from netlib.blob import Array

T = TypeVar("T")
NO_IDEA = "This is not a known mistake. Compare your code with the formulas at the top of the file."
SMALL = 12  # size up to which a result is shown in full
FACTORS = 1e-5  # tolerance of a constant factor or offset
COARSE = {"float16": 2e-3, "float32": 3e-6}  # relative error after rounding to the type


def sentences(exercise: Exercise, runner: Runner, found: Difference) -> Iterator[str]:
    """Yield what differs, then the likely reason."""
    yield _what_differs(found)
    yield advice(exercise, runner, found) or _unsteady(runner, found) or _pattern(found) or NO_IDEA
    if where := where_wrong(found):
        yield where
    if found.index is not None and 1 < found.got.size <= SMALL:
        yield f"Found: {_listed(found.got)}; expected: {_listed(found.wanted)}."


def _listed(array: Array) -> str:
    """Format as nested lists, with up to six significant digits."""
    return f"[{', '.join(map(_listed, array))}]" if array.ndim else f"{float(array):.6g}"


def _what_differs(found: Difference) -> str:
    case = found.case
    where = f" ({case.title})" if case.title else ""
    if found.index is None:
        return f"{found.name} has the shape {found.got.shape}, expected {found.wanted.shape}{where}."
    letters = case.axes.get(found.name, ())
    named = len(letters) == len(found.index)
    index = ", ".join(f"{a}={i}" for a, i in zip(letters, found.index)) if named else ", ".join(map(str, found.index))
    got, wanted = _distinct(float(found.got[found.index]), float(found.wanted[found.index]))
    place = f"{found.name}[{index}]" if index else found.name
    size, others = found.got.size, ""
    if size > 1:
        others = f"; the first of {found.count} elements of {size} that differ" if found.count > 1 else \
            f"; the only one of {size} elements that differs"
    return f"{place} is {got}, {case.source} {wanted}{others}{where}."


def _distinct(a: float, b: float) -> tuple[str, str]:
    """Format two numbers with as many digits as needed to distinguish them."""
    for digits in range(4, 17):
        pair = f"{a:.{digits}g}", f"{b:.{digits}g}"
        if pair[0] != pair[1]:
            break
    return pair


def advice(exercise: Exercise, runner: Runner, found: Difference) -> str | None:
    """Return the advice of the known mistake that reproduces the reader's results; None if there is none.

    The mistake must be correct where the reader's part is, and wrong in the same way elsewhere, in every case of the
    step. Of several candidates, the one that agrees with the reader's part in most other results is chosen. A mistake
    that gives the same results in half of the wrong cases is reported as a similar one.
    """
    for remedy in exercise.remedies:
        if remedy.looks_like(found.got) and _is_cured(found.case, runner, remedy):
            return remedy.advice
    like = [m for m in exercise.mistakes if _same(found, _by_mistake(found.case, m) or {})]
    if not like:
        return None
    step = next(check.cases for check in exercise.checks if found.case in check.cases)
    mine = {case: _run(case, runner) for case in step}
    differences = {case: _difference(case, values) for case, values in mine.items() if values is not None}
    right = [case for case, difference in differences.items() if difference is None]
    wrong = [difference for difference in differences.values() if difference]
    if not wrong:  # the results change from call to call
        return None
    like = [m for m in like if all(_mistake_passes(case, m) for case in right)]
    shares = {m: np.mean([_same(other, _by_mistake(other.case, m) or {}) for other in wrong]) for m in like}
    whole = [m for m in like if shares[m] == 1]
    if not whole:
        half = [m for m in like if shares[m] >= 0.5]
        return f"In some examples it looks like this: {half[0].advice}" if half else None
    like = whole
    if len(like) == 1:
        return like[0].advice
    mine |= {case: _run(case, runner) for check in exercise.checks for case in check.cases if case not in mine}

    def agreement(mistake: Mistake) -> int:
        return sum(_alike(case, values or {}, _by_mistake(case, mistake) or {}) for case, values in mine.items())

    return max(like, key=agreement).advice


def _run(case: Case, runner: Runner) -> Values | None:
    """Return the results of the reader's part, None if it raises."""
    return tried(lambda: results(runner, case))


def _difference(case: Case, values: Values) -> Difference | None:
    """Return the first difference of results; None if there is none."""
    return tried(lambda: first_difference(case, values))


def _is_cured(case: Case, runner: Runner, remedy: Remedy) -> bool:
    """Return whether a case passes with a remedy."""
    return bool(tried(lambda: first_difference(case, results(runner, case, remedy)) is None))


@functools.cache
def _by_mistake(case: Case, mistake: Mistake) -> Values | None:
    """Return the results of a known mistake, None if it raises."""
    return tried(lambda: case.run(mistake.part))


@functools.cache
def _mistake_passes(case: Case, mistake: Mistake) -> bool:
    """Return whether a known mistake makes no difference in a case."""
    values = _by_mistake(case, mistake)
    return values is not None and bool(tried(lambda: first_difference(case, values) is None))


def tried(compute: Callable[[], T]) -> T | None:
    """Return ``compute()``, or None if it raises: the part may contain another mistake."""
    try:
        with unwarned():
            return compute()
    except Exception:
        return None


def _same(found: Difference, values: Values) -> bool:
    other = values.get(found.name)
    if other is None or other.shape != found.got.shape:
        return False
    tolerance = found.case.tolerance
    got, array = found.got, np.asarray(other, np.float64)
    return bool((agree(got, array, tolerance) | (np.isnan(got) & np.isnan(array))).all())


def _alike(case: Case, mine: Values, theirs: Values) -> int:
    """Return the number of results that agree."""
    return sum(
        _same(Difference(case, name, None, np.asarray(array, np.float64), array), theirs)
        for name, array in mine.items()
    )


def where_wrong(found: Difference) -> str | None:
    """Describe where the wrong elements are, by axis, border or sign; None if everywhere or nowhere in particular."""
    if found.index is None:
        return None
    wrong = ~agree(found.got, found.wanted, found.case.tolerance)
    if wrong.all() or wrong.size < 2:
        return None
    letters = found.case.axes.get(found.name, ())
    places = [
        place
        for k, size in enumerate(wrong.shape)
        if wrong.sum() > 1  # otherwise the message has its index
        if (place := _along(letters[k] if len(letters) == wrong.ndim else f"axis {k}", wrong, k, size))
    ]
    of_images = tuple(letters[-2:]) == ("h", "w") and min(wrong.shape[-2:]) > 2
    if not places and of_images and not wrong[..., 1:-1, 1:-1].any():
        places.append("at the border of the image")
    for what, mask in (
        ("0 is expected", found.wanted == 0),
        ("a non-zero value is expected", found.wanted != 0),
        ("a positive value is expected", found.wanted > 0),
        ("a negative value is expected", found.wanted < 0),
    ):
        if mask.any() and np.array_equal(wrong, mask):
            places.append(f"where {what}")
            break
    return f"Only elements {', '.join(places)} are wrong." if places else None


def _along(letter: str, wrong: Array, k: int, size: int) -> str | None:
    """Describe the indices of the wrong elements along one axis."""
    at = np.flatnonzero(wrong.any(axis=tuple(i for i in range(wrong.ndim) if i != k)))
    if len(at) == size or size < 2:
        return None
    if len(at) == 1:
        name = {0: ", the first", size - 1: ", the last"}.get(int(at[0]), "")
        return f"with {letter}={at[0]}{name}"
    if at[0] > 0 and len(at) == size - at[0]:
        return f"with {letter}={at[0]} and after"
    if at[-1] < size - 1 and len(at) == at[-1] + 1:
        return f"with {letter}={at[-1]} and before"
    return f"with {letter} in {', '.join(map(str, at))}" if len(at) <= size // 2 else None


def _unsteady(runner: Runner, found: Difference) -> str | None:
    """Return advice if the result changes from call to call."""
    again = _run(found.case, runner)
    if again is None or _same(found, again):
        return None
    return (
        "The value changes from call to call. Draw a layer's random numbers from self.rng, whose state a resume "
        "restores, and never from np.random."
    )


def _pattern(found: Difference) -> str | None:
    """Describe the pattern of a difference that no known mistake reproduces."""
    got, wanted = found.got, found.wanted
    if found.index is None:
        return _pattern_of_shapes(got, wanted)
    if np.isnan(got).all() and not np.isnan(wanted).all():
        return (
            "All elements are NaN, their initial value: nothing was written, or values were added to them. Write into "
            "the array, with [...] = on the left."
        )
    if np.isnan(got[found.index]) and not np.isnan(wanted[found.index]):
        return (
            "It is NaN, its initial value: the element was never written, or was computed from one that was not. "
            "Write every element."
        )
    if np.isinf(got[found.index]) and np.isfinite(wanted[found.index]):
        return "It is infinite: a division by 0 or an overflow."
    if not np.isfinite(got).all() or not np.isfinite(wanted).all():
        return None
    if (got == 0).all():
        return (
            "All elements are 0: nothing was written into the array, or 0 overwrote it. An assignment to a name, y = "
            "... or dw = ..., changes no array: write y[...] = ..., and dw[...] += ... for a parameter."
        )
    if text := _coarse(got, wanted):
        return text
    factor = float(np.vdot(got, wanted)) / max(float(np.vdot(wanted, wanted)), 1e-300)
    if wanted.size > 1 and agree(got, factor * wanted, FACTORS).all() and min(abs(factor), abs(factor - 1)) > FACTORS:
        if abs(factor + 1) < FACTORS:
            return "All elements have the wrong sign."
        return f"All elements are {factor:.5g} times the expected value: a factor is missing or superfluous."
    off, near = got - wanted, FACTORS * max(1.0, float(np.abs(wanted).max()))
    if wanted.size > 1 and np.ptp(off) <= near < abs(float(off.flat[0])):
        return (
            f"All elements exceed the expected value by {float(off.flat[0]):.5g}: a constant is superfluous or missing."
        )
    return None


def _coarse(got: Array, wanted: Array) -> str | None:
    """Return advice if the result is correct up to rounding to a narrower type."""
    how = None
    with np.errstate(all="ignore"):  # overflow in the narrower type
        if wanted.size > 1 and (got == np.trunc(wanted)).all():
            how = "whole numbers"
        for dtype, tolerance in COARSE.items():
            lost = (wanted != wanted.astype(dtype)).mean() > 0.5  # otherwise the expected values fit the type
            if wanted.size > 1 and lost and (got == got.astype(dtype)).all() and agree(got, wanted, tolerance).all():
                how = how or dtype
    return how and (
        f"The values are correct to the precision of {how}: an intermediate array has that type. Use the type "
        "of the input arrays."
    )


def _pattern_of_shapes(got: Array, wanted: Array) -> str | None:
    if got.shape == () != wanted.shape:
        return "It is a scalar: the array was not given a shape, or all axes were summed."
    if got.ndim and got.shape == wanted.shape[::-1]:
        return "The axes are in reverse order."
    return None
