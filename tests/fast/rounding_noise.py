"""How much rounding alone changes the results of a net: passes in which every value read is wrong by about one ulp.

A layer that is computed in another order has the result of inputs that differ by rounding (it is backward stable), so
the spread of such passes is what two correct engines may differ by, also where large values cancel or where rounding
decides a maximum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

import netlib
from netlib.blob import Array, Blobs


def add_noise(net: netlib.Net, seed: int) -> None:
    """Change each forward and backward of the layers of a net of the plain engine: what they read is perturbed."""
    rng = np.random.default_rng(seed)
    for layer in net.layers:
        layer.forward = _noisy_forward(layer.forward, rng)
        layer.backward = _noisy_backward(layer.backward, rng)


def _noisy_forward(forward: Callable[[Blobs, Blobs], None], rng: np.random.Generator) -> Any:
    def noisy(bottom: Blobs, top: Blobs) -> None:
        with_noise(rng, [blob.data for blob in bottom], [blob.data for blob in top], lambda: forward(bottom, top))

    return noisy


def _noisy_backward(backward: Callable[[Blobs, list[bool], Blobs], None], rng: np.random.Generator) -> Any:
    def noisy(top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        read = [blob.data for blob in [*bottom, *top]] + [blob.diff for blob in top]
        with_noise(rng, read, [blob.diff for blob in bottom], lambda: backward(top, propagate_down, bottom))

    return noisy


def with_noise(rng: np.random.Generator, read: Iterable[Array], written: list[Array], run: Callable[[], None]) -> None:
    """Run with arrays that differ by up to one ulp where they are not integers, and restore those not written."""
    kept = []
    for x in {x.__array_interface__["data"][0]: x for x in read if x.size}.values():
        if not np.array_equal(x, np.rint(x)):  # places of maxima, labels and masks are exact
            kept.append((x, x.copy()))
            x *= 1 + np.finfo(x.dtype).eps * rng.uniform(-1, 1, x.shape)
    run()
    for x, before in kept:
        if not any(np.may_share_memory(x, y) for y in written):
            x[...] = before


def spread(arrays: list[Array]) -> float:
    """Maximum difference of perturbed results from the first; infinite if only some are finite."""
    first, *others = arrays
    finite = [np.isfinite(x).all() for x in arrays]
    if not all(finite):
        return 0.0 if not any(finite) else np.inf
    return max((float(np.abs(x - first).max(initial=0)) for x in others), default=0.0)
