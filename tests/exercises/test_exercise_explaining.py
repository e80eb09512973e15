"""The first difference in words: the element, its expected value, and the likely kind of mistake."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from exercises.exercise import Case, Exercise, Values, first_difference
from exercises.explaining import sentences, where_wrong
from exercises.runner import LocalRunner
from exercises.table import EXERCISES

RIGHT = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.5]])
NOTHING_KNOWN = dataclasses.replace(EXERCISES["relu"], mistakes=(), remedies=(), checks=())


def report(
    got: np.ndarray, wanted: np.ndarray = RIGHT, exercise: Exercise = NOTHING_KNOWN, tolerance: float = 1e-6
) -> list[str]:
    """Return the explanation of a result."""

    def run(part: np.ndarray) -> Values:
        return {"y": part}

    case = Case("some options", run, lambda: {"y": wanted}, "Caffe has", {"y": "nc"}, tolerance, "forward")
    found = first_difference(case, run(got))
    assert found is not None
    return list(sentences(exercise, LocalRunner(exercise, got), found))


def changed(index: tuple[int, int], value: float) -> np.ndarray:
    array = RIGHT.copy()
    array[index] = value
    return array


def test_the_first_element_that_differs_is_named() -> None:
    """The first wrong element is named by its axes, with enough digits to distinguish it, and all are counted."""
    array = changed((0, 2), 3.00001)
    array[1, 1] = 0
    first, second, *_, shown = report(array)
    assert shown == "Found: [[1, 2, 3.00001], [4, 0, 6.5]]; expected: [[1, 2, 3], [4, 5, 6.5]]."
    assert first == "y[n=0, c=2] is 3.00001, Caffe has 3; the first of 2 elements of 6 that differ (some options)."
    assert second.startswith("This is not a known mistake.")
    assert report(changed((0, 2), 9))[0] == "y[n=0, c=2] is 9, Caffe has 3; the only one of 6 elements that differs " \
        "(some options)."


@pytest.mark.parametrize(
    ("got", "said"),
    [
        (-RIGHT, "All elements have the wrong sign."),
        (RIGHT * 2, "All elements are 2 times the expected value: a factor is missing or superfluous."),
        (RIGHT + 0.5, "All elements exceed the expected value by 0.5: a constant is superfluous or missing."),
        (RIGHT * 0, "All elements are 0: nothing was written"),
        (RIGHT * np.nan, "All elements are NaN, their initial value: nothing was written"),
        (changed((1, 2), np.inf), "It is infinite: a division by 0"),
        (np.trunc(RIGHT), "The values are correct to the precision of whole numbers"),
        (changed((1, 2), 6.5 + 2**-16), "This is not a known mistake."),
        (changed((1, 2), np.nan), "It is NaN, its initial value: the element was never written"),
    ],
)
def test_what_numbers_look_like(got: np.ndarray, said: str) -> None:
    """Results that no known mistake gives are described by a simple relation to the expected ones."""
    assert report(got)[1].startswith(said)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ((0,), "Only elements with n=0, the first are wrong."),
        ((0, 0, 0, 0), None),
        ((slice(1, None),), "Only elements with n=1 and after are wrong."),
        ((slice(None), 1), "Only elements with c=1, the last are wrong."),
        ((slice(None), slice(None), [0, -1]), "Only elements with h in 0, 4 are wrong."),
        ((slice(None), slice(None), slice(1, 4), slice(1, 4)), None),
    ],
)
def test_where_the_wrong_elements_are(wrong: tuple[Any, ...], said: str | None) -> None:
    """Wrong elements along one axis are described; a set without a short description is not."""
    wanted = np.random.default_rng(0).normal(size=(3, 2, 5, 5))
    got = wanted.copy()
    got[wrong] += 1 + np.arange(got[wrong].size).reshape(got[wrong].shape)
    case = Case("", lambda part: {"y": part}, lambda: {"y": wanted}, "Caffe has", {"y": "nchw"}, 1e-6)
    found = first_difference(case, {"y": got})
    assert found is not None
    if said is None:
        assert "the first" not in (where_wrong(found) or "")
    else:
        assert where_wrong(found) == said


def test_wrong_at_the_border_or_by_sign() -> None:
    """Errors at the border of an image or at negative values are recognised."""
    wanted = np.random.default_rng(0).normal(size=(1, 1, 5, 5))
    border = wanted + np.pad(np.zeros((3, 3)), 1, constant_values=1)
    case = Case("", lambda part: {"y": part}, lambda: {"y": wanted}, "Caffe has", {"y": "nchw"}, 1e-6)
    for got, said in (
        (border, "Only elements at the border of the image are wrong."),
        (np.where(wanted < 0, 2 * wanted, wanted), "Only elements where a negative value is expected are wrong."),
    ):
        found = first_difference(case, {"y": got})
        assert found is not None and where_wrong(found) == said
    weights = Case("", lambda part: {"w": part}, lambda: {"w": wanted}, "Caffe has", {"w": "ocij"}, 1e-6)
    found = first_difference(weights, {"w": border})
    assert found is not None and where_wrong(found) is None  # an array that is no image has no border


def test_a_shape_that_differs() -> None:
    """A wrong shape is reported with the expected one; reversed axes are recognised."""
    first, second = report(RIGHT.T)
    assert first == "y has the shape (3, 2), expected (2, 3) (some options)."
    assert second == "The axes are in reverse order."
    assert report(RIGHT[:1])[0].startswith("y has the shape (1, 3)")
    assert report(RIGHT.sum())[1].startswith("It is a scalar")


def test_nearly_right_is_no_factor() -> None:
    """Results that are nearly right are not described as a factor of 1 or a constant of 0."""
    wanted = np.random.default_rng(0).normal(size=(2, 3))
    assert report(wanted * (1 + 3e-6), wanted)[1].startswith("This is not a known mistake.")
    assert report(wanted.astype(np.float16), wanted)[1].startswith("The values are correct to the precision of float16")
    assert report(wanted.astype(np.float32), wanted, tolerance=1e-10)[1].startswith(
        "The values are correct to the precision of float32"
    )


def test_what_is_not_finite_must_be_where_it_should() -> None:
    """Infinite values must be in the expected places, and NaN is wrong where a number is expected."""
    wanted = np.array([np.inf, 1.0])
    case = Case("", lambda part: {"y": part}, lambda: {"y": wanted}, "Caffe has", {}, 1e-6)
    assert first_difference(case, {"y": wanted.copy()}) is None
    for wrong in ([1.0, 1.0], [np.inf, np.nan], [-np.inf, 1.0]):
        assert first_difference(case, {"y": np.array(wrong)}) is not None


def test_numbers_that_are_others_each_time() -> None:
    """Random numbers that do not come from self.rng are recognised."""
    rng = np.random.default_rng(0)
    case = Case("", lambda part: {"y": rng.normal(size=3)}, lambda: {"y": np.zeros(3)}, "ours has", {}, 1e-6)
    found = first_difference(case, case.run(None))
    assert found is not None
    assert list(sentences(NOTHING_KNOWN, LocalRunner(NOTHING_KNOWN, None), found))[1].startswith(
        "The value changes from call to call"
    )
