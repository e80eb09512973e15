"""Working memory of fast layers."""

from __future__ import annotations

import threading

import numpy as np

from fast.fast_layer import FastLayer
from netlib import gradcheck


def test_a_buffer_keeps_its_memory_for_each_thread() -> None:
    """A buffer has zeros at first and in a new shape, and each thread has its own."""
    layer = gradcheck.make_layer('type: "ReLU"', [np.zeros(3)])
    assert isinstance(layer, FastLayer)
    buffer = layer.buffer("b", (2, 3))
    assert not buffer.any()
    assert layer.buffer("b", (2, 3)) is buffer
    assert layer.buffer("b", (4,)).shape == (4,)
    found = []
    thread = threading.Thread(target=lambda: found.append(layer.buffer("b", (4,))))
    thread.start()
    thread.join()
    assert found[0] is not layer.buffer("b", (4,))
