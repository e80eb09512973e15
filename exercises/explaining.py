"""The first difference, explained: which element, what it should be, and the likely mistake."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from exercises.exercise import Case, Difference, Exercise, Part, Values, agree, first_difference, unwarned
from netlib.blob import Array

T = TypeVar("T")
NO_IDEA = "This is none of the usual mistakes. Compare your lines with the formulas at the top of the file."
SMALL = 12  # numbers of a result that is shown whole
FACTORS = 1e-5  # how well a constant factor must fit all numbers
COARSE = {"float16": 2e-3, "float32": 3e-6}  # how far numbers of fewer digits may be off


def sentences(exercise: Exercise, part: Part, found: Difference) -> Iterator[str]:
    """What differs, then what is likely the reason."""
    yield _what_differs(found)
    yield advice(exercise, part, found) or _unsteady(part, found) or _pattern(found) or NO_IDEA
    if where := where_wrong(found):
        yield where
    if found.index is not None and 1 < found.got.size <= SMALL:
        yield f"Yours: {_listed(found.got)}; wanted: {_listed(found.wanted)}."


def _listed(array: Array) -> str:
    """As nested lists, each number as short as it can be."""
    return f"[{', '.join(map(_listed, array))}]" if array.ndim else f"{float(array):.6g}"


def _what_differs(found: Difference) -> str:
    case = found.case
    where = f" ({case.title})" if case.title else ""
    if found.index is None:
        return f"{found.name} has the shape {found.got.shape}, it should be {found.wanted.shape}{where}."
    letters = case.axes.get(found.name, ())
    named = len(letters) == len(found.index)
    index = ", ".join(f"{a}={i}" for a, i in zip(letters, found.index)) if named else ", ".join(map(str, found.index))
    got, wanted = _written(float(found.got[found.index]), float(found.wanted[found.index]))
    place = f"{found.name}[{index}]" if index else found.name
    others = "" if found.got.size == 1 else f"; {found.count} of {found.got.size} differ, this is the first"
    return f"{place} is {got}, {case.source} {wanted}{others}{where}."


def _written(a: float, b: float) -> tuple[str, str]:
    """Two numbers with as many digits as it takes to tell them apart."""
    for digits in range(4, 17):
        pair = f"{a:.{digits}g}", f"{b:.{digits}g}"
        if pair[0] != pair[1]:
            break
    return pair


def advice(exercise: Exercise, part: Part, found: Difference) -> str | None:
    """What is said of the known mistake that gives what the reader's part gives; None if none does.

    It must be right where the reader's part is, and wrong in the same way where that is wrong, in every case of the
    step. Where several are left, it is the one that agrees with the reader's part in most other results. A mistake that
    gives the same numbers in half of the wrong cases is named as one that looks like the reader's.
    """
    for remedy in exercise.remedies:
        if remedy.looks_like(found.got) and _passes(found.case, part, remedy.cured):
            return remedy.advice
    like = [m for m in exercise.mistakes if _same(found, _run(found.case, m.part) or {})]
    if not like:
        return None
    step = next(check.cases for check in exercise.checks if found.case in check.cases)
    right = [case for case in step if _passes(case, part)]
    wrong = [other for case in step if case not in right and (other := _difference(case, part))]
    like = [m for m in like if all(_passes(case, m.part) for case in right)]
    shares = {m: np.mean([_same(other, _run(other.case, m.part) or {}) for other in wrong]) for m in like}
    whole = [m for m in like if shares[m] == 1]
    if not whole:
        half = [m for m in like if shares[m] >= 0.5]
        return f"It looks like this, though not in every example: {half[0].advice}" if half else None
    like = whole
    if len(like) == 1:
        return like[0].advice
    cases = [case for check in exercise.checks for case in check.cases]
    mine = {case: _run(case, part) or {} for case in cases}
    return max(like, key=lambda m: sum(_alike(c, mine[c], _run(c, m.part) or {}) for c in cases)).advice


def _difference(case: Case, part: Part) -> Difference | None:
    """The first difference of a case; None if there is none, or the part fails."""
    return tried(lambda: first_difference(case, case.run(part), case.wanted(part)))


def _passes(case: Case, part: Part, changed: Callable[[Part], Part] = lambda part: part) -> bool:
    """Is a case right with a part, or with what is made of it?"""

    def passes() -> bool:
        made = changed(part)
        return first_difference(case, case.run(made), case.wanted(made)) is None

    return bool(tried(passes))


def _run(case: Case, part: Part) -> Values | None:
    """What a part computes, None if it fails."""
    return tried(lambda: case.run(part))


def tried(compute: Callable[[], T]) -> T | None:
    """What is computed, None if it fails: a part can have another mistake than this one."""
    try:
        with unwarned():
            return compute()
    except KeyboardInterrupt:
        raise
    except BaseException:  # SystemExit, or one of the reader's own
        return None


def _same(found: Difference, values: Values) -> bool:
    other = values.get(found.name)
    if other is None or other.shape != found.got.shape:
        return False
    tolerance = found.case.tolerance
    got, array = found.got, np.asarray(other, np.float64)
    return bool((agree(got, array, tolerance) | (np.isnan(got) & np.isnan(array))).all())


def _alike(case: Case, mine: Values, theirs: Values) -> int:
    """How many of the results are the same."""
    return sum(
        _same(Difference(case, name, None, np.asarray(array, np.float64), array), theirs)
        for name, array in mine.items()
    )


def where_wrong(found: Difference) -> str | None:
    """Where the wrong elements are, if not everywhere: along which axis, at the border, of which sign."""
    if found.index is None:
        return None
    wrong = ~agree(found.got, found.wanted, found.case.tolerance)
    if wrong.all() or wrong.size < 2:
        return None
    letters = found.case.axes.get(found.name, ())
    places = [
        place
        for k, size in enumerate(wrong.shape)
        if (place := _along(letters[k] if len(letters) == wrong.ndim else f"axis {k}", wrong, k, size))
    ]
    if not places and wrong.ndim >= 2 and min(wrong.shape[-2:]) > 2 and not wrong[..., 1:-1, 1:-1].any():
        places.append("at the border of the picture")
    for what, mask in (
        ("it should be 0", found.wanted == 0),
        ("it should not be 0", found.wanted != 0),
        ("it should be positive", found.wanted > 0),
        ("it should be negative", found.wanted < 0),
    ):
        if mask.any() and np.array_equal(wrong, mask):
            places.append(f"where {what}")
            break
    return f"Only elements {', '.join(places)} are wrong." if places else None


def _along(letter: str, wrong: Array, k: int, size: int) -> str | None:
    """At which indices of one axis the wrong elements are."""
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


def _unsteady(part: Part, found: Difference) -> str | None:
    """What is said of numbers that are others each time."""
    if _same(found, _run(found.case, part) or {}):
        return None
    return (
        "It is another number each time it is computed. Random numbers of a layer come from self.rng, which a resume "
        "can wind back, and never from np.random."
    )


def _pattern(found: Difference) -> str | None:
    """What can be said of numbers that no known mistake gives."""
    got, wanted = found.got, found.wanted
    if found.index is None:
        return _pattern_of_shapes(got, wanted)
    if np.isnan(got).all() and not np.isnan(wanted).all():
        return (
            "All of it is NaN, as it was before: nothing was written, or something was added to it. Write into the "
            "array, with [...] = on the left."
        )
    if np.isnan(got[found.index]) and not np.isnan(wanted[found.index]):
        return (
            "It is NaN, as it was before: this element was never written, or it was computed from one that was not. "
            "Every element has to be written."
        )
    if np.isinf(got[found.index]) and np.isfinite(wanted[found.index]):
        return "It is infinite: something was divided by 0, or grew beyond what the numbers can hold."
    if not np.isfinite(got).all() or not np.isfinite(wanted).all():
        return None
    if (got == 0).all():
        return "All of it is 0: nothing was written into the array, or 0 was written over what was there."
    if said := _coarse(got, wanted):
        return said
    factor = float(np.vdot(got, wanted)) / max(float(np.vdot(wanted, wanted)), 1e-300)
    if wanted.size > 1 and agree(got, factor * wanted, FACTORS).all() and min(abs(factor), abs(factor - 1)) > FACTORS:
        if abs(factor + 1) < FACTORS:
            return "Everything has the wrong sign."
        return f"Everything is {factor:.5g} times what it should be: a factor is missing, or one too many."
    off, near = got - wanted, FACTORS * max(1.0, float(np.abs(wanted).max()))
    if wanted.size > 1 and np.ptp(off) <= near < abs(float(off.flat[0])):
        return f"Everything is {float(off.flat[0]):.5g} more than it should be: a constant is added, or left out."
    return None


def _coarse(got: Array, wanted: Array) -> str | None:
    """What is said of numbers that were right until they were stored in a type with fewer digits."""
    how = None
    with np.errstate(all="ignore"):  # numbers that a type does not reach
        if wanted.size > 1 and (got == np.trunc(wanted)).all():
            how = "whole numbers"
        for dtype, tolerance in COARSE.items():
            lost = (wanted != wanted.astype(dtype)).mean() > 0.5  # else numbers of that type say nothing
            if wanted.size > 1 and lost and (got == got.astype(dtype)).all() and agree(got, wanted, tolerance).all():
                how = how or dtype
    return how and (
        f"The numbers are right as far as {how} can hold them: somewhere on the way is an array of that type. Use that "
        "of the arrays you are given."
    )


def _pattern_of_shapes(got: Array, wanted: Array) -> str | None:
    if got.shape == () != wanted.shape:
        return "It is a single number: nobody has given it a shape, or all was summed."
    if got.ndim and got.shape == wanted.shape[::-1]:
        return "The axes are in the opposite order."
    return None
