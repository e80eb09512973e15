"""The update rules without new arrays give the plain rules' bits."""

from __future__ import annotations

import numpy as np
import pytest

from fast.updates import RULES
from netlib.proto.messages import SolverParameter
from netlib.updates import RULES as PLAIN_RULES


@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_same_bits(name: str, dtype: type, rng: np.random.Generator) -> None:
    """Weights and histories over some updates; the gradient stays as it is."""
    p = SolverParameter(momentum=0.9, momentum2=0.99, rms_decay=0.98, delta=1e-7)
    w = rng.normal(size=(30, 40)).astype(dtype)
    count = PLAIN_RULES[name][1]
    ours, plain = ((w.copy(), [np.zeros_like(w) for _ in range(count)]) for _ in range(2))
    for t in range(1, 6):
        g = rng.normal(size=w.shape).astype(dtype)
        for (weights, history), rules in ((ours, RULES), (plain, PLAIN_RULES)):
            given = g.copy()
            rules[name][0](p, weights, given, 0.01, history, t)
            assert np.array_equal(given, g)
    assert np.array_equal(ours[0], plain[0])
    assert all(np.array_equal(a, b) for a, b in zip(ours[1], plain[1]))
