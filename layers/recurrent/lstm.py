"""LSTM: remembers over many steps, in a cell that is only added to, and forgets what a gate lets go.

bottoms    x (T, N, ...), cont (T, N), static (N, ...) optional; with ``expose_hidden``, last, h and c before (1, N, D)
params     w_x (4 D, I), b (4 D,), w_s (4 D, S) only with static, w_h (4 D, D)
top[0]     h  (T, N, D)       with ``expose_hidden``, h and c after the last step follow, (1, N, D)

z is what x and static contribute, for all steps at once (recurrent.py, with all that the layer shares with RNN), and
r = cont[t] h[t - 1]. Every step t takes from z[t] + w_h r, in this order of rows, three gates and a proposal,

    i = sigmoid(...)       f = cont[t] sigmoid(...)       o = sigmoid(...)       g = tanh(...)

    c[t] = f c[t - 1] + i g        h[t] = o tanh(c[t])

and backwards, from the last step to the first, with dh and dc what the step after and the top want of h[t] and c[t]:

    dc += dh o (1 - tanh²(c[t]))
    dz[t] = (dc g i (1 - i),  dc c[t - 1] f (1 - f),  dh tanh(c[t]) o (1 - o),  dc i (1 - g²))
    dw_h += dz[t]ᵀ r        dh[t - 1] = cont[t] dz[t] w_h        dc[t - 1] = dc f

Kept for backward: ``gate``, (i, f, o, g), ``r`` and ``c`` of every step; c[0] is that before the first one.
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from layers.recurrent.recurrent import Recurrent
from netlib.blob import Blobs


class LSTM(Recurrent):
    """Long short-term memory."""

    remembers = 2  # h and c
    gates = 4

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        z, w_h, cont = self._z(bottom), self.blobs[self.w_h].data, bottom[1].data[:, :, None]
        (T, N, _), D = z.shape, self.param.num_output
        h, c = self._first_states(bottom)
        self.gate = np.empty((T, 4, N, D), self.dtype)
        self.r, self.c = np.empty((T, N, D), self.dtype), np.empty((T + 1, N, D), self.dtype)
        self.c[0] = c
        for t in range(T):
            self.r[t] = cont[t] * h
            i, f, o, g = np.split(z[t] + self.r[t] @ w_h.T, 4, axis=1)
            i, f, o, g = self.gate[t] = expit(i), cont[t] * expit(f), expit(o), np.tanh(g)
            c = self.c[t + 1] = f * c + i * g
            h = top[0].data[t] = o * np.tanh(c)
        self._keep_states((h, c), top)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        w_h, dw_h, cont = self.blobs[self.w_h].data, self.blobs[self.w_h].diff, bottom[1].data[:, :, None]
        T, N, D = top[0].shape
        dz = np.empty((T, N, 4 * D), self.dtype)
        dh_before = dc_before = np.zeros((N, D), self.dtype)
        for t in reversed(range(T)):
            (i, f, o, g), tanh_c = self.gate[t], np.tanh(self.c[t + 1])
            dh = top[0].diff[t] + dh_before
            dc = dc_before + dh * o * (1 - tanh_c**2)
            parts = (dc * g * i * (1 - i), dc * self.c[t] * f * (1 - f), dh * tanh_c * o * (1 - o), dc * i * (1 - g**2))
            dz[t] = np.concatenate(parts, axis=1)
            dw_h += dz[t].T @ self.r[t]
            dh_before, dc_before = cont[t] * (dz[t] @ w_h), dc * f
        self._backward_z(dz, propagate_down, bottom)
