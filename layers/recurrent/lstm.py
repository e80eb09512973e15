"""LSTM: long short-term memory, a recurrent layer with an additive cell state and gates.

bottoms    x (T, N, ...), cont (T, N), static (N, ...) optional; with ``expose_hidden``, then initial h and c (1, N, D)
params     w_x (4 D, I), b (4 D,), w_s (4 D, S) only with static, w_h (4 D, D)
top[0]     h  (T, N, D)       with ``expose_hidden``, followed by h and c after the last step, (1, N, D)

z is the contribution of x and static, computed for all steps at once (recurrent.py, the base class shared with RNN),
and r = cont[t] h[t - 1]. Each step t is an LSTMUnit (lstm_unit.py: the gates, their order and gradients),

    c[t], h[t] = unit(c[t - 1], z[t] + w_h r, cont[t])

and backwards, from the last step to the first: with dh and dc the gradients of h[t] and c[t] from the next step and the
top, dz[t] and dc[t - 1] are the gradients of that unit, and

    dw_h += dz[t]ᵀ r        dh[t - 1] = cont[t] dz[t] w_h

Kept for backward: ``gate``, ``r`` and ``c`` of every step; c[0] is the initial cell state.
"""

from __future__ import annotations

import numpy as np

from layers.recurrent.lstm_unit import step, step_backward
from layers.recurrent.recurrent import Recurrent
from netlib.blob import Blobs


class LSTM(Recurrent):
    """Long short-term memory."""

    state_count = 2  # h and c
    gates = 4

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        z, w_h, cont = self._z(bottom), self.w_h.data, bottom[1].data[:, :, None]
        (T, N, _), D = z.shape, self.param.num_output
        h, c = self._first_states(bottom)
        self.gate = np.empty((T, 4, N, D), self.dtype)
        self.r, self.c = np.empty((T, N, D), self.dtype), np.empty((T + 1, N, D), self.dtype)
        self.c[0] = c
        for t in range(T):
            self.r[t] = cont[t] * h
            c, h, self.gate[t] = step(c, z[t] + self.r[t] @ w_h.T, cont[t])
            self.c[t + 1], top[0].data[t] = c, h
        self._keep_states((h, c), top)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        w_h, dw_h, cont = self.w_h.data, self.w_h.diff, bottom[1].data[:, :, None]
        T, N, D = top[0].shape
        dz = np.empty((T, N, 4 * D), self.dtype)
        dh = dc = np.zeros((N, D), self.dtype)
        for t in reversed(range(T)):
            dc, dz[t] = step_backward(dc, top[0].diff[t] + dh, self.c[t], self.c[t + 1], self.gate[t])
            dw_h += dz[t].T @ self.r[t]
            dh = cont[t] * (dz[t] @ w_h)
        self._backward_z(dz, propagate_down, bottom)
