"""LSTM: long short-term memory, a recurrent layer with an additive cell state and gates.

bottoms    x (T, N, ...), cont (T, N), static (N, ...) optional; with ``expose_hidden``, then initial h and c (1, N, D)
params     w_x (4 D, I), b (4 D,), w_s (4 D, S) only with static, w_h (4 D, D)
top[0]     h  (T, N, D)       with ``expose_hidden``, followed by h and c after the last step, (1, N, D)

z is the contribution of x and static, computed for all steps at once (recurrent.py, the base class shared with RNN),
and r = cont[t] h[t - 1]. Each step t is an LSTMUnit (lstm_unit.py: the gates, their order and gradients),

    c[t], h[t] = unit(c[t - 1], z[t] + w_h r, cont[t])

and backwards, from the last step to the first: with dh and dc the gradients of h[t] and c[t] from the next step and the
top, dz[t] and dc[t - 1] are the gradients of that unit, and

    dh[t - 1] = cont[t] dz[t] w_h        dw_h += dz[t]ᵀ r of all steps, in one product

Kept for backward, of every step: ``r``, and ``gate`` and ``c`` as rows of one array, i, f, o, g and the c before.

The time of a step of a small layer is that of its NumPy calls. As sigmoid(x) = (1 + tanh(x / 2)) / 2, all gates are one
call of tanh, with z and w_h of three of them halved in advance. As i and f are neighbours, and g and c too, i g and
f c are one product.
"""

from __future__ import annotations

import numpy as np

from layers.recurrent.lstm_unit import slopes
from layers.recurrent.recurrent import Recurrent
from netlib.blob import Blobs


class LSTM(Recurrent):
    """Long short-term memory."""

    state_count = 2  # h and c
    gates = 4

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        T, N, D, half = *bottom[1].shape, self.param.num_output, np.asarray(0.5, self.dtype)
        halves = np.array([[[0.5]], [[0.5]], [[0.5]], [[1]]], self.dtype)  # i, f, o and g
        w_h = (self.w_h.data.reshape(4, D, D) * halves).reshape(4 * D, D)
        rows, y = np.empty((T + 1, 5, D, N), self.dtype), np.empty((T + 1, D, N), self.dtype)
        gate, c = rows[:T, :4], rows[:, 4]
        np.multiply(self._z(bottom).reshape(T, 4, D, N), halves, out=gate)
        y[0], c[0] = self._first_states(bottom)
        recurrent, products = np.empty((4, D, N), self.dtype), np.empty((2, D, N), self.dtype)
        product, (kept, added) = recurrent.reshape(4 * D, N), products
        for cont, row, r, h, c_after in zip(self._cont(bottom), rows, y, y[1:], c[1:]):
            all_gates, sigmoids = row[:4], row[:3]
            np.dot(w_h, r if cont is None else cont * r, out=product)
            all_gates += recurrent
            np.tanh(all_gates, out=all_gates)
            sigmoids *= half
            sigmoids += half
            if cont is not None:
                row[1] *= cont
            np.multiply(row[:2], row[3:], out=products)
            np.add(kept, added, out=c_after)
            np.tanh(c_after, out=h)
            h *= row[2]
        self.gate, self.c, self.r = gate, c, y[:-1] * bottom[1].data[:, None]
        top[0].data[...] = y[1:].swapaxes(1, 2)
        self._keep_states((y[-1], c[-1]), top)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        of_c, of_x = slopes(self.c[:-1], self.c[1:], self.gate)
        dy = np.ascontiguousarray(top[0].diff.swapaxes(1, 2))
        T, D, N = dy.shape
        dz = np.empty((T, 4, D, N), self.dtype)
        w_h, (dh, dc, from_h) = self.w_h.data.T, np.zeros((3, D, N), self.dtype)
        steps = zip(self._cont(bottom), dy, of_c, of_x, self.gate[:, 1], dz, dz.reshape(T, 4 * D, N))
        for cont, of_top, c_slope, x_slope, f, dx, of_product in reversed([*steps]):
            dh += of_top
            dc += np.multiply(dh, c_slope, out=from_h)
            np.multiply(x_slope, dc, out=dx)
            np.multiply(x_slope[2], dh, out=dx[2])
            np.dot(w_h, of_product, out=dh)
            dc *= f
            if cont is not None:
                dh *= cont
        self._backward_z(dz.reshape(T, 4 * D, N), self.r, propagate_down, bottom)
