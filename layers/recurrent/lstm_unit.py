"""LSTMUnit: one step of an LSTM without its weights.

bottom[0]  c_before  (1, N, D)     cell states of N streams before the step
bottom[1]  x         (1, N, 4 D)   inputs of three gates and the candidate, D numbers each, in the order i, f, o, g
bottom[2]  cont      (1, N)        1: the step continues the stream; 0: a new sequence starts from a zero state
top[0]     c         (1, N, D)
top[1]     h         (1, N, D)

    i = sigmoid(x_i)       f = cont sigmoid(x_f)       o = sigmoid(x_o)       g = tanh(x_g)

    c = f c_before + i g        h = o tanh(c)

and backwards, with dc and dh the gradients of the tops,

    dc += dh o (1 - tanh²(c))
    dx = (dc g i (1 - i),  dc c_before f (1 - f),  dh tanh(c) o (1 - o),  dc i (1 - g²))        dc_before = dc f

As in Caffe, the gradient of f is correct only for cont 0 or 1, and cont has no gradient.

Kept for backward: ``gate``, (i, f, o, g).
"""

from __future__ import annotations

import numpy as np
import scipy

from netlib.blob import Array, Blobs
from netlib.layer import Layer


class LSTMUnit(Layer):
    """Gates and cell of an LSTM."""

    bottoms = (3, 3)
    reads_top = True
    tops = (2, 2)
    in_place = False

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        shape, names = bottom[0].shape, self.spec.bottom
        if len(shape) != 3 or shape[0] != 1:
            raise self.fail(f"bottom {names[0]!r} has shape {shape}, expected (1, N, D), one step of N streams")
        N, D = shape[1:]
        for blob, name, wanted in zip(bottom[1:], names[1:], [(1, N, 4 * D), (1, N)]):
            if blob.shape != wanted:
                raise self.fail(f"bottom {name!r} has shape {blob.shape}, expected {wanted} to match "
                                f"{names[0]!r} {shape}")
        for y in top:
            y.reshape(shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        c_before, x, cont = (blob.data[0] for blob in bottom)
        top[0].data[0], top[1].data[0], self.gate = step(c_before, x, cont[:, None])

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[2]:
            raise self.fail(f"bottom {self.spec.bottom[2]!r} (cont) has no gradient; set propagate_down: false")
        dc, dh = top[0].diff[0], top[1].diff[0]
        dc_before, dx = step_backward(dc, dh, bottom[0].data[0], top[0].data[0], self.gate)
        if propagate_down[0]:
            bottom[0].diff[0] = dc_before
        if propagate_down[1]:
            bottom[1].diff[0] = dx

    def allow_force_backward(self, bottom_index: int) -> bool:
        return bottom_index != 2


def step(c_before: Array, x: Array, cont: Array) -> tuple[Array, Array, Array]:
    """Compute c, h (N, D) and the gates i, f, o, g (4, N, D) from c_before (N, D), x (N, 4 D) and cont (N, 1)."""
    i, f, o, g = np.split(x, 4, axis=1)
    i, f, o, g = scipy.special.expit(i), cont * scipy.special.expit(f), scipy.special.expit(o), np.tanh(g)
    c = f * c_before + i * g
    return c, o * np.tanh(c), np.stack((i, f, o, g))


def step_backward(dc: Array, dh: Array, c_before: Array, c: Array, gate: Array) -> tuple[Array, Array]:
    """Compute dc_before (N, D) and dx (N, 4 D) from dc and dh (N, D) and the inputs and results of ``step``."""
    (i, f, o, g), tanh_c = gate, np.tanh(c)
    dc = dc + dh * o * (1 - tanh_c**2)
    dx = (dc * g * i * (1 - i), dc * c_before * f * (1 - f), dh * tanh_c * o * (1 - o), dc * i * (1 - g**2))
    return dc * f, np.concatenate(dx, axis=1)
