"""LSTM: long short-term memory, a recurrent layer with an additive cell state and gates.

bottoms    x (T, N, ...), cont (T, N), static (N, ...) optional; with ``expose_hidden``, then
           initial h and c (1, N, D)
params     w_x (4 D, I), b (4 D,), w_s (4 D, S) only with static, w_h (4 D, D)
top[0]     h  (T, N, D)       with ``expose_hidden``, followed by h and c after the last
                              step, (1, N, D)

z is the contribution of x and static, computed for all steps at once (recurrent.py, the base class
shared with RNN), and r = cont[t] h[t - 1]. Each step t is an LSTMUnit (lstm_unit.py: the gates,
their order and gradients),

    c[t], h[t] = unit(c[t - 1], z[t] + w_h r, cont[t])

and backwards, from the last step to the first: with dh and dc the gradients of h[t] and c[t] from
the next step and the top, dz[t] and dc[t - 1] are the gradients of that unit, and

    dh[t - 1] = cont[t] dz[t] w_h        dw_h += dz[t]ᵀ r of all steps, in one product

Kept for backward, of every step: ``h``, and ``gate`` and ``c`` as rows of one array, i, f, o, g
and the c before.

A step takes as long as its NumPy calls: as sigmoid(x) = (1 + tanh(x / 2)) / 2, all gates are one
tanh, with z and w_h of three of them halved before; and as i and f are neighbours, and g and c too,
i g and f c are one product.
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
        w_h = self.w_h.data.copy()
        w_h[: 3 * D] *= half
        rows = np.empty((T + 1, 5, D, N), self.dtype)
        y = np.empty((T + 1, D, N), self.dtype)
        gate, c = rows[:T, :4], rows[:, 4]
        self._write_z(bottom, gate)
        gate[:, :3] *= half
        y[0], c[0] = self._first_states(bottom)
        recurrent, products = np.empty((4, D, N), self.dtype), np.empty((2, D, N), self.dtype)
        product, (kept, added) = recurrent.reshape(4 * D, N), products
        steps = zip(
            self._cont(bottom),
            y,
            y[1:],
            c[1:],
            rows[:, :4],
            rows[:, :3],
            rows[:, :2],
            rows[:, 3:],
            rows[:, 2],
        )
        for cont, r, h, c_after, all_gates, sigmoids, i_and_f, g_and_c, o in steps:
            np.dot(w_h, r if cont is None else cont * r, out=product)
            np.add(all_gates, recurrent, out=all_gates)
            np.tanh(all_gates, out=all_gates)
            np.multiply(sigmoids, half, out=sigmoids)
            np.add(sigmoids, half, out=sigmoids)
            if cont is not None:
                i_and_f[1] *= cont
            np.multiply(i_and_f, g_and_c, out=products)
            np.add(kept, added, out=c_after)
            np.tanh(c_after, out=h)
            np.multiply(o, h, out=h)
        self.gate, self.c, self.h = gate, c, y
        top[0].data[...] = y[1:].swapaxes(1, 2)
        self._keep_states((y[-1], c[-1]), top)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        of_c, of_x = slopes(self.c[:-1], self.c[1:], self.gate)
        dy = np.ascontiguousarray(top[0].diff.swapaxes(1, 2))
        T, D, N = dy.shape
        dz = np.empty((T, 4, D, N), self.dtype)
        w_h, (dh, dc, from_h) = self.w_h.data.T, np.zeros((3, D, N), self.dtype)
        steps = zip(
            self._cont(bottom), dy, of_c, of_x, self.gate[:, 1], dz, dz.reshape(T, 4 * D, N)
        )
        for cont, of_top, c_slope, x_slope, f, dx, of_product in reversed([*steps]):
            dh += of_top
            dc += np.multiply(dh, c_slope, out=from_h)
            np.multiply(x_slope, dc, out=dx)
            np.multiply(x_slope[2], dh, out=dx[2])
            np.dot(w_h, of_product, out=dh)
            dc *= f
            if cont is not None:
                dh *= cont
        r = self.h[:-1] * bottom[1].data[:, None]
        self._backward_z(dz.reshape(T, 4 * D, N), r, propagate_down, bottom)
