"""Layers on numbers worked by hand, in the tables ``by_hand.txt`` of the rooms.

A row has the type of a layer and its options, and below them, by the letters of the layer's file:

x    bottoms
w    parameters
y    tops
dy   gradients of the tops; without them there is no backward pass
dx   gradients of the bottoms, ``-`` for one that has none
dw   gradients of the parameters

An array is written in JSON, with fractions and multiples of ln, exp and sqrt of a number, or as the
shape 2x3 of zeros.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from layers import LAYER_TYPES
from tests.support.tables import records_of, shape_of

Arrays = dict[str, list[np.ndarray | None]]


def quotient(match: re.Match[str]) -> str:
    return repr(int(match[1]) / int(match[2]))


def value(match: re.Match[str]) -> str:
    function = {"ln": math.log, "exp": math.exp, "sqrt": math.sqrt}[match[2]]
    return repr(float(match[1] or 1) * function(float(match[3])))


def array_of(text: str) -> np.ndarray | None:
    """The array of a field."""
    if text == "-":
        return None
    if re.fullmatch(r"\d+(x\d+)+", text):
        return np.zeros(shape_of(text))
    text = re.sub(r"(-?\d+)/(\d+)", quotient, text)
    text = re.sub(r"(?:([-.\d]+)\*)?(ln|exp|sqrt)\((.*?)\)", value, text)
    return np.array(json.loads(text), np.float64)


def in_place(layer: str, arrays: Arrays) -> bool:
    """Whether a layer can also run in place, which needs y to determine x."""
    kind, _, options = layer.partition(" ")
    if "negative_slope: -" in options or not LAYER_TYPES[kind].in_place:
        return False
    return [np.shape(x) for x in arrays["x"]] == [np.shape(y) for y in arrays["y"]]


ROWS = [
    (layer, {letter: list(map(array_of, fields)) for letter, fields in record.items()})
    for table in sorted(Path(__file__).parent.rglob("by_hand.txt"))
    for layer, record in records_of(table)
]
CASES = [(layer, arrays, False) for layer, arrays in ROWS]
CASES += [(layer, arrays, True) for layer, arrays in ROWS if in_place(layer, arrays)]


@pytest.mark.parametrize(("layer", "arrays", "together"), CASES)
def test_by_hand(by_hand: Callable[..., None], layer: str, arrays: Arrays, together: bool) -> None:
    names = {"dy": "dy", "dx": "dx", "w": "params", "dw": "dparams"}
    given = {name: arrays[letter] for letter, name in names.items() if letter in arrays}
    by_hand(layer, arrays["x"], arrays["y"], **given, in_place=together)
