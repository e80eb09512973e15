"""LSTMUnit: one step of an LSTM without its weights.

bottom[0]  c_before  (1, N, D)     cell states of N streams before the step
bottom[1]  x         (1, N, 4 D)   inputs of three gates and the candidate, D numbers each, in the
                                   order i, f, o, g
bottom[2]  cont      (1, N)        1: the step continues the stream; 0: a new sequence starts
                                   from a zero state
top[0]     c         (1, N, D)
top[1]     h         (1, N, D)

    i = sigmoid(x_i)       f = cont sigmoid(x_f)       o = sigmoid(x_o)       g = tanh(x_g)

    c = f c_before + i g        h = o tanh(c)

and backwards, with dc and dh the gradients of the tops,

    dc += dh o (1 - tanh²(c))
    dx = (dc g i (1 - i),  dc c_before f (1 - f),  dh tanh(c) o (1 - o),  dc i (1 - g²))
    dc_before = dc f

As in Caffe, the gradient of f is correct only for cont 0 or 1, and cont has no gradient.

Kept for backward: ``gate``, (i, f, o, g).
"""

from __future__ import annotations

import numpy as np

from layers.activation.elementwise import sigmoid
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
            raise self.fail(
                f"bottom {names[0]!r} has shape {shape}, expected (1, N, D), one step of N streams"
            )
        N, D = shape[1:]
        for blob, name, wanted in zip(bottom[1:], names[1:], [(1, N, 4 * D), (1, N)]):
            if blob.shape != wanted:
                raise self.fail(
                    f"bottom {name!r} has shape {blob.shape}, expected {wanted} to match "
                    f"{names[0]!r} {shape}"
                )
        for y in top:
            y.reshape(shape)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        c_before, x, cont = (blob.data[0] for blob in bottom)
        self.gate = x.reshape(len(x), 4, -1).swapaxes(0, 1).copy()
        i, f, o, g = self.gate
        sigmoid(self.gate[:3], out=self.gate[:3])
        np.tanh(g, out=g)
        f *= cont[:, None]
        c = top[0].data[0] = f * c_before + i * g
        top[1].data[0] = o * np.tanh(c)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[2]:
            raise self.fail(
                f"bottom {self.spec.bottom[2]!r} (cont) has no gradient; set propagate_down: false"
            )
        of_c, of_x = slopes(bottom[0].data[0], top[0].data[0], self.gate)
        dh = top[1].diff[0]
        dc = top[0].diff[0] + dh * of_c
        if propagate_down[0]:
            bottom[0].diff[0] = dc * self.gate[1]
        if propagate_down[1]:
            dx = of_x * np.stack((dc, dc, dh, dc))
            bottom[1].diff[0] = dx.swapaxes(0, 1).reshape(len(dc), -1)

    def allow_force_backward(self, bottom_index: int) -> bool:
        return bottom_index != 2


def slopes(c_before: Array, c: Array, gate: Array) -> tuple[Array, Array]:
    """The slopes that backward multiplies, of one or of all steps: dh/dc (..., N, D), and
    (..., 4, N, D) for the four parts of x, of which that of o belongs to dh and the others to dc.
    """
    i, f, o, g = np.moveaxis(gate, -3, 0)
    tanh_c = np.tanh(c)
    of_x = g * i * (1 - i), c_before * f * (1 - f), tanh_c * o * (1 - o), i * (1 - g**2)
    return o * (1 - tanh_c**2), np.stack(of_x, axis=-3)
