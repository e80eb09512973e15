"""The first difference in words: the element, its expected value, and what the
numbers look like.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from exercises.exercise import Case, Check, first_difference
from exercises.explaining import sentences
from exercises.table import EXERCISES

RIGHT = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.5]]) / 0.7
NOTHING_KNOWN = dataclasses.replace(EXERCISES["relu"], mistakes=())


def report(got: np.ndarray, method: str = "forward") -> list[str]:
    case = Case(
        "some options",
        lambda part: {"y": part.result},
        lambda: {"y": RIGHT},
        "Caffe has",
        {"y": "n c"},
        1e-8,
        method,
    )
    found = first_difference(case, {"y": got})
    assert found is not None
    return list(
        sentences(NOTHING_KNOWN, Check("values", (case,)), type("Part", (), {"result": got}), found)
    )


def changed(index: Any, value: float) -> np.ndarray:
    array = RIGHT.copy()
    array[index] = value
    return array


def test_the_first_element_that_differs_is_named() -> None:
    first, second, where, shown = report(changed((0, [1, 2]), 3.00001))
    assert (
        first
        == "y[n=0, c=1] is 3, Caffe has 2.857; the first of 2 elements of 6 that differ (some options)."
    )
    assert (
        second
        == "This is not a known mistake. Compare your code with the formulas at the top of the file."
    )
    assert where == "Only elements with n=0 are wrong."
    assert shown.startswith("Found: [[1.42857, 3.00001, 3.00001], [5.71429, ")
    assert "; expected: [[1.42857, 2.8" in shown


@pytest.mark.parametrize(
    ("got", "said"),
    [
        (-RIGHT, "All elements have the wrong sign."),
        (
            RIGHT * 2,
            "All elements are 2 times the expected value: a factor is missing or superfluous.",
        ),
        (
            RIGHT + 0.5,
            "All elements exceed the expected value by 0.5: a constant is superfluous or missing.",
        ),
        (RIGHT * 0, "All elements are 0: nothing was written"),
        (
            changed((1, 2), np.nan),
            "Some elements are NaN, their initial value. Write every element",
        ),
        (changed((1, 2), np.inf), "It is infinite: a division by 0"),
        (RIGHT * (1 + 3e-6), "This is not a known mistake."),
        (RIGHT.astype(np.float32), "The values are correct to the precision of float32 only."),
        (RIGHT.T, "The axes are in reverse order."),
    ],
)
def test_likely_causes_of_wrong_values_are_explained(got: np.ndarray, said: str) -> None:
    assert report(got)[1].startswith(said)


def test_a_gradient_that_overwrites() -> None:
    assert report(RIGHT - 1, method="backward")[1].startswith(
        "backward overwrites the diff of a parameter."
    )
