"""Fixtures that run a single layer, in float64 by default."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from netlib import gradcheck
from netlib.blob import Blob, Blobs
from netlib.proto.schema import Phase


class Run:
    """A layer after one forward pass.

    layer      the layer
    y, ys      data of the first top, of all tops
    backward   diffs of the bottoms for these diffs of the tops
    """

    def __init__(
        self,
        text: str,
        bottoms: Sequence[ArrayLike],
        tops: int = 1,
        phase: Phase = "TRAIN",
        params: Sequence[ArrayLike] = (),
        in_place: bool = False,
        dtype: type = np.float64,
    ) -> None:
        arrays = [np.asarray(x, dtype) for x in bottoms]
        self.layer = gradcheck.make_layer(f'name: "it" {text}', arrays, tops, phase, dtype=dtype)
        for blob, values in zip(self.layer.blobs, params):
            blob.data[...] = values
        self.bottom = Blobs([Blob(x.shape, dtype) for x in arrays])
        self.top = Blobs([Blob((), dtype) for _ in range(tops)])
        if in_place:
            self.top[0] = self.bottom[0]
        for blob, x in zip(self.bottom, arrays):
            blob.data[...] = x
        self.layer.reshape(self.bottom, self.top)
        self.layer.forward(self.bottom, self.top)

    @property
    def y(self) -> np.ndarray:
        return self.top[0].data

    @property
    def ys(self) -> list[np.ndarray]:
        return [blob.data for blob in self.top]

    def backward(self, *dy: ArrayLike, wanted: list[bool] | None = None) -> list[np.ndarray]:
        for blob, values in zip(self.top, dy):
            blob.diff[...] = values
        self.layer.backward(self.top, wanted or [True] * len(self.bottom), self.bottom)
        return [blob.diff for blob in self.bottom]


@pytest.fixture(autouse=True)
def as_in_a_net() -> Iterator[None]:
    """NumPy does not warn of values that are not finite, as in a net."""
    with np.errstate(all="ignore"):
        yield


@pytest.fixture
def run() -> Callable[..., Run]:
    """``run(text, x, ..., tops=1)`` returns a layer after one forward pass."""

    def make(text: str, *bottoms: ArrayLike, **options: Any) -> Run:
        return Run(text, bottoms, **options)

    return make


@pytest.fixture
def by_hand(run: Callable[..., Run]) -> Callable[..., None]:
    """``by_hand("ReLU", [x], [y], [dy], [dx])``: the tops, and the gradients of the bottoms, are
    these numbers.

    The first word is the type, others are its options. A bottom with dx None has no gradient;
    without dy there is no backward pass. ``dparams`` are the gradients of the parameters, whose
    values are ``params``.
    """

    def equal(found: np.ndarray, wanted: ArrayLike) -> None:
        assert found.shape == np.shape(wanted)
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-15)

    def compare(
        layer: str,
        bottoms: Sequence[ArrayLike],
        tops: Sequence[ArrayLike],
        dy: Sequence[ArrayLike] = (),
        dx: Sequence[Any] = (),
        dparams: Sequence[ArrayLike] = (),
        **options: Any,
    ) -> None:
        kind, _, text = layer.partition(" ")
        done = run(f'type: "{kind}" {text}', *bottoms, tops=len(tops), **options)
        for found, wanted in zip(done.ys, tops):
            equal(found, wanted)
        for found, wanted in zip(
            done.backward(*dy, wanted=[one is not None for one in dx]) if dx else [], dx
        ):
            if wanted is not None:
                equal(found, wanted)
        for param, wanted in zip(done.layer.blobs, dparams):
            equal(param.diff, wanted)

    return compare


@pytest.fixture
def check() -> Callable[..., None]:
    """``check(text, x, ...)`` runs the gradient check."""

    def make(
        text: str, *bottoms: ArrayLike, tops: int = 1, phase: Phase = "TRAIN", **options: Any
    ) -> None:
        gradcheck.check(gradcheck.make_layer(text, bottoms, tops, phase), bottoms, tops, **options)

    return make


def pytest_make_parametrize_id(val: object) -> str | None:
    """Shorten the ids of cases that are prototxt texts."""
    return val.replace("\n", " ")[:60] if isinstance(val, str) else None
