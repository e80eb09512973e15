"""handpose/prediction/options.py"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import netlib
from handpose.prediction.packaged import load_predictor
from handpose.prediction.predictor import Predictor
from netlib.errors import NetlibError


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"hand": "Left"}, r"hand='Left' \(did you mean 'left'\?\); expected right, left, either"),
        ({"hand": None}, "hand=None; expected right, left, either"),
        ({"fit": "best"}, "fit='best'; expected no, fast, accurate"),
        ({"refine": -1}, "refine=-1; expected a whole number from 0 to 100"),
        ({"refine": 1.5}, "refine=1.5; expected a whole number from 0 to 100"),
        ({"refine": 10**9}, "refine=1000000000; expected a whole number from 0 to 100"),
        ({"cube_mm": 0.3}, "cube_mm=0.3; expected 50 to 10000 mm"),
        ({"cube_mm": np.nan}, "cube_mm=nan; expected 50 to 10000 mm"),
        ({"cube_mm": "300"}, "cube_mm='300'; expected 50 to 10000 mm"),
    ],
    ids=str,
)
def test_options_that_are_none(seeing: netlib.Net, option: dict[str, Any], message: str) -> None:
    """Are refused when the predictor is made, by its name or with the packaged weights."""
    for make in (lambda: Predictor(seeing, **option), lambda: load_predictor(**option)):
        with pytest.raises(NetlibError, match=f"^{message}$"):
            make()
