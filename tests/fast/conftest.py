"""The tests in this folder use the fast engine, regardless of NETLIB_ENGINE."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import netlib
from fast import division


@pytest.fixture(autouse=True, scope="module")
def engine_in_use() -> Iterator[None]:
    """Use the fast engine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NETLIB_ENGINE", "fast")
        yield


@pytest.fixture
def slices_of_any_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """A small batch is one slice.

    Products of other sizes round differently, and the values under a pooling window over the
    background are equal up to rounding, so the winner would change.
    """
    monkeypatch.setattr(division, "SPLITS", ())


@pytest.fixture
def agree(net_of: Callable[..., netlib.Net]) -> Callable[..., netlib.Net]:
    """``agree(text, {"x": x}, {"x": more}, tolerance=1e-11)``: the engines agree in passes
    over these inputs.

    Compared are outputs, gradients of the inputs, and parameters and their gradients,
    relative to the largest value of an array, or to 1. ``prepare`` changes each net first.
    Returns the fast net.
    """

    def passed(net: netlib.Net, batch: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        net.clear_param_diffs()
        tops, rng = net.forward(**batch), np.random.default_rng(0)
        diffs = net.backward(**{name: rng.normal(size=top.shape) for name, top in tops.items()})
        found = {name: net.blobs[name].data.copy() for name in tops}
        found |= {f"d{name}": diff.copy() for name, diff in diffs.items()}
        for param in net.learnable:
            found |= {
                param.label: param.blob.data.copy(),
                f"d{param.label}": param.blob.diff.copy(),
            }
        return found

    def check(
        text: str,
        *batches: dict[str, np.ndarray],
        tolerance: float,
        phase: int = netlib.TRAIN,
        dtype: Any = np.float64,
        prepare: Callable[[netlib.Net], object] = lambda net: None,
    ) -> netlib.Net:
        nets = [net_of(text, phase, dtype=dtype, engine=name) for name in ("plain", "fast")]
        for net in nets:
            prepare(net)
        for batch in batches:
            plain, fast = (passed(net, batch) for net in nets)
            for name, wanted in plain.items():
                assert fast[name].shape == wanted.shape
                # not of an empty window's maximum
                size = max(np.abs(wanted[np.abs(wanted) < 1e30]).max(initial=0), 1)
                np.testing.assert_allclose(
                    fast[name], wanted, rtol=tolerance, atol=tolerance * size, err_msg=name
                )
        return nets[1]

    return check
