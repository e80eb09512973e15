"""The first difference in words: which element, what it should be, what such numbers look like."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from exercises.exercise import Case, Exercise, Values, first_difference
from exercises.explaining import sentences, where_wrong
from exercises.table import EXERCISES

RIGHT = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.5]])
NOTHING_KNOWN = dataclasses.replace(EXERCISES["relu"], mistakes=(), remedies=(), checks=())


def told(
    got: np.ndarray, wanted: np.ndarray = RIGHT, exercise: Exercise = NOTHING_KNOWN, tolerance: float = 1e-6
) -> list[str]:
    """What is said of a result."""

    def run(part: np.ndarray) -> Values:
        return {"y": part}

    case = Case("some options", run, lambda part: {"y": wanted}, "Caffe has", {"y": "nc"}, tolerance, "forward")
    found = first_difference(case, run(got), case.wanted(got))
    assert found is not None
    return list(sentences(exercise, got, found))


def changed(index: tuple[int, int], value: float) -> np.ndarray:
    array = RIGHT.copy()
    array[index] = value
    return array


def test_the_first_element_that_differs_is_named() -> None:
    """By its axes, with as many digits as tell the numbers apart, and how many there are."""
    array = changed((0, 2), 3.00001)
    array[1, 1] = 0
    first, second, *_, shown = told(array)
    assert shown == "Yours: [[1, 2, 3.00001], [4, 0, 6.5]]; wanted: [[1, 2, 3], [4, 5, 6.5]]."
    assert first == "y[n=0, c=2] is 3.00001, Caffe has 3; 2 of 6 differ, this is the first (some options)."
    assert second.startswith("This is none of the usual mistakes.")


@pytest.mark.parametrize(
    ("got", "said"),
    [
        (-RIGHT, "Everything has the wrong sign."),
        (RIGHT * 2, "Everything is 2 times what it should be: a factor is missing, or one too many."),
        (RIGHT + 0.5, "Everything is 0.5 more than it should be: a constant is added, or left out."),
        (RIGHT * 0, "All of it is 0: nothing was written"),
        (RIGHT * np.nan, "All of it is NaN, as it was before: nothing was written, or something was added"),
        (changed((1, 2), np.inf), "It is infinite: something was divided by 0"),
        (np.trunc(RIGHT), "The numbers are right as far as whole numbers can hold them"),
        (changed((1, 2), 6.5 + 2**-16), "This is none of the usual mistakes."),
        (changed((1, 2), np.nan), "It is NaN, as it was before: this element was never written"),
    ],
)
def test_what_numbers_look_like(got: np.ndarray, said: str) -> None:
    """If no known mistake gives them."""
    assert told(got)[1].startswith(said)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ((0,), "Only elements with n=0, the first are wrong."),
        ((slice(1, None),), "Only elements with n=1 and after are wrong."),
        ((slice(None), 1), "Only elements with c=1, the last are wrong."),
        ((slice(None), slice(None), [0, -1]), "Only elements with h in 0, 4 are wrong."),
        ((slice(None), slice(None), slice(1, 4), slice(1, 4)), None),
    ],
)
def test_where_the_wrong_elements_are(wrong: tuple[Any, ...], said: str | None) -> None:
    """Along one axis; a set that has no short name is not described."""
    wanted = np.random.default_rng(0).normal(size=(3, 2, 5, 5))
    got = wanted.copy()
    got[wrong] += 1 + np.arange(got[wrong].size).reshape(got[wrong].shape)
    case = Case("", lambda part: {"y": part}, lambda part: {"y": wanted}, "Caffe has", {"y": "nchw"}, 1e-6)
    found = first_difference(case, {"y": got}, {"y": wanted})
    assert found is not None
    if said is None:
        assert "the first" not in (where_wrong(found) or "")
    else:
        assert where_wrong(found) == said


def test_wrong_at_the_border_or_by_sign() -> None:
    """Padding that is wrong shows at the border; a slope that is wrong where values are negative."""
    wanted = np.random.default_rng(0).normal(size=(1, 1, 5, 5))
    border = wanted + np.pad(np.zeros((3, 3)), 1, constant_values=1)
    case = Case("", lambda part: {"y": part}, lambda part: {"y": wanted}, "Caffe has", {"y": "nchw"}, 1e-6)
    for got, said in (
        (border, "Only elements at the border of the picture are wrong."),
        (np.where(wanted < 0, 2 * wanted, wanted), "Only elements where it should be negative are wrong."),
    ):
        found = first_difference(case, {"y": got}, {"y": wanted})
        assert found is not None and where_wrong(found) == said


def test_a_shape_that_differs() -> None:
    """Both shapes; axes in the opposite order are seen."""
    first, second = told(RIGHT.T)
    assert first == "y has the shape (3, 2), it should be (2, 3) (some options)."
    assert second == "The axes are in the opposite order."
    assert told(RIGHT[:1])[0].startswith("y has the shape (1, 3)")
    assert told(RIGHT.sum())[1].startswith("It is a single number")


def test_nearly_right_is_no_factor() -> None:
    """Of 1, and no constant of 0."""
    wanted = np.random.default_rng(0).normal(size=(2, 3))
    assert told(wanted * (1 + 3e-6), wanted)[1].startswith("This is none of the usual mistakes.")
    assert told(wanted.astype(np.float16), wanted)[1].startswith("The numbers are right as far as float16 can hold")
    assert told(wanted.astype(np.float32), wanted, tolerance=1e-10)[1].startswith(
        "The numbers are right as far as float32"
    )


def test_what_is_not_finite_must_be_where_it_should() -> None:
    """Infinity is infinity, and NaN is never right where a number is wanted."""
    wanted = np.array([np.inf, 1.0])
    case = Case("", lambda part: {"y": part}, lambda part: {"y": wanted}, "Caffe has", {}, 1e-6)
    assert first_difference(case, {"y": wanted.copy()}, {"y": wanted}) is None
    for wrong in ([1.0, 1.0], [np.inf, np.nan], [-np.inf, 1.0]):
        assert first_difference(case, {"y": np.array(wrong)}, {"y": wanted}) is not None


def test_numbers_that_are_others_each_time() -> None:
    """Random numbers from elsewhere than self.rng."""
    rng = np.random.default_rng(0)
    case = Case("", lambda part: {"y": rng.normal(size=3)}, lambda part: {"y": np.zeros(3)}, "ours has", {}, 1e-6)
    found = first_difference(case, case.run(None), case.wanted(None))
    assert found is not None
    assert list(sentences(NOTHING_KNOWN, None, found))[1].startswith("It is another number each time")
