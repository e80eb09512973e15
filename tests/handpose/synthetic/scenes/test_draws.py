"""handpose/synthetic/scenes/draws.py"""

from __future__ import annotations

import numpy as np
import pytest

from handpose.synthetic.scenes.draws import Draw, Range, Sizes


def test_ranges_are_uniform_or_uniform_in_the_logarithm(rng: np.random.Generator) -> None:
    draw = Draw(rng, 4000)
    numbers = draw(Range(2.0, 8.0))
    assert numbers.min() >= 2
    assert numbers.max() <= 8
    assert np.mean(numbers < 5) == pytest.approx(0.5, abs=0.03)
    doublings = draw(Sizes(2.0, 8.0))
    assert np.mean(doublings < 4) == pytest.approx(0.5, abs=0.03)
