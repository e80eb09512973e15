"""Pooling by running maxima and sums gives the results of the plain layer, for any windows."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import numpy as np
import pytest

import netlib
from netlib.errors import LayerError
from tests.support.nets import inputs

OPTIONS = "kernel_h: %d kernel_w: %d stride_h: %d stride_w: %d pad_h: %d pad_w: %d round_mode: %s"


def options(rng: Random) -> str:
    """Random options of a pooling: overlapping and distant windows, padding, both roundings, one window."""
    kind = rng.choice(["MAX", "AVE"])
    mask = 'top: "mask"' if kind == "MAX" and rng.random() < 0.3 else ""
    if rng.random() < 0.15:
        return f"{mask} pooling_param {{ pool: {kind} global_pooling: true }}"
    kernel, stride = (rng.randint(1, 7), rng.randint(1, 7)), (rng.randint(1, 4), rng.randint(1, 4))
    pad = [rng.randint(0, k - 1) if rng.random() < 0.5 else 0 for k in kernel]
    windows = OPTIONS % (*kernel, *stride, *pad, rng.choice(["CEIL", "FLOOR"]))
    return f"{mask} pooling_param {{ pool: {kind} {windows} }}"


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_any_windows(agree: Callable[..., netlib.Net], rng: np.random.Generator, dtype: type) -> None:
    """Maxima, masks, means and gradients are those of the plain layer, and ties select the same value."""
    compared = 0
    for seed in range(120):
        choice = Random(seed)
        shape = tuple(choice.randint(1, most) for most in (3, 4, 19, 19))
        x = rng.normal(size=shape).astype(dtype)
        if choice.random() < 0.5:
            x = np.round(x)
        layer = f'layer {{ name: "p" type: "Pooling" bottom: "x" top: "y" {options(choice)} }}'
        try:
            agree(f"force_backward: true {inputs(x=shape)} {layer}", {"x": x}, tolerance=1e-5, dtype=dtype)
        except LayerError:
            continue  # the window is larger than the image
        compared += 1
    assert compared > 60
