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

Kept for backward: ``gate``, ``r`` and ``c`` of every step; c[0] is the initial cell state.
"""

from __future__ import annotations

import numpy as np

from layers.recurrent.lstm_unit import slopes, step
from layers.recurrent.recurrent import Recurrent
from netlib.blob import Blobs


class LSTM(Recurrent):
    """Long short-term memory."""

    state_count = 2  # h and c
    gates = 4

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        w_h, cont = self.w_h.data, self._cont(bottom)
        z, D = self._z(bottom), self.param.num_output
        T, _, N = z.shape
        h, c = self._first_states(bottom)
        self.gate, self.r = z.reshape(T, 4, D, N), np.empty((T, D, N), self.dtype)
        self.c, y = np.empty((T + 1, D, N), self.dtype), np.empty((T, D, N), self.dtype)
        self.c[0] = c
        for t in range(T):
            self.r[t] = h if cont[t] is None else cont[t] * h
            z[t] += w_h @ self.r[t]
            self.c[t + 1], h = c, y[t] = step(self.c[t], self.gate[t], cont[t])
        top[0].data[...] = y.swapaxes(1, 2)
        self._keep_states((h, c), top)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        w_h, cont = self.w_h.data.T, self._cont(bottom)
        of_c, of_x = slopes(self.c[:-1], self.c[1:], self.gate)
        dy = np.ascontiguousarray(top[0].diff.swapaxes(1, 2))
        T, D, N = dy.shape
        dz = np.empty((T, 4 * D, N), self.dtype)
        dh = dc = np.zeros((D, N), self.dtype)
        for t in reversed(range(T)):
            dh = dh + dy[t]
            dc = dc + dh * of_c[t]
            dx = np.multiply(of_x[t], dc, out=dz[t].reshape(4, D, N))
            np.multiply(of_x[t, 2], dh, out=dx[2])
            dh, dc = w_h @ dz[t], dc * self.gate[t, 1]
            if cont[t] is not None:
                dh *= cont[t]
        self._backward_z(dz, self.r, propagate_down, bottom)
