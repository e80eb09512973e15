"""RNN: a simple recurrent layer, whose state depends on the input and the previous state.

bottoms    x (T, N, ...), cont (T, N), static (N, ...) optional; with ``expose_hidden``, then initial h (1, N, D)
params     w_x (D, I), b (D,), w_s (D, S) only with static, w_h (D, D), w_o (D, D), b_o (D,)
top[0]     o  (T, N, D)       with ``expose_hidden``, followed by h after the last step, (1, N, D)

z is the contribution of x and static, computed for all steps at once (recurrent.py, the base class shared with LSTM),
and r = cont[t] h[t - 1]. Each step t computes

    h[t] = tanh(z[t] + w_h r)        o[t] = tanh(w_o h[t] + b_o)

and backwards, from the last step to the first, with dh the gradient of h[t] from the next step:

    da = do[t] (1 - o[t]²)        dw_o += daᵀ h[t]        db_o += da        dh += da w_o
    dz[t] = dh (1 - h[t]²)        dw_h += dz[t]ᵀ r        dh[t - 1] = cont[t] dz[t] w_h

Kept for backward: ``h``, ``r`` and ``o`` of every step.
"""

from __future__ import annotations

import numpy as np

from layers.recurrent.recurrent import Recurrent
from netlib.blob import Array, Blobs


class RNN(Recurrent):
    """Simple recurrent layer."""

    state_count = 1  # h
    gates = 1

    def setup(self, bottom: Blobs, top: Blobs) -> None:
        super().setup(bottom, top)
        D = self.param.num_output
        self.w_o = self.new_param("w_o", (D, D), self.param.weight_filler)
        self.b_o = self.new_param("b_o", (D,), self.param.bias_filler)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        z, cont = self._z(bottom), bottom[1].data[:, :, None]
        w_h, w_o, b_o = self.w_h.data, self.w_o.data, self.b_o.data
        [h] = self._first_states(bottom)
        self.r, self.h = np.empty_like(z), np.empty_like(z)
        for t in range(len(z)):
            self.r[t] = cont[t] * h
            h = self.h[t] = np.tanh(z[t] + self.r[t] @ w_h.T)
        self.o = np.tanh(self.h @ w_o.T + b_o)
        top[0].data[...] = self.o
        self._keep_states([h], top)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        w_h, w_o = self.w_h.data, self.w_o.data
        dw_h, dw_o, db_o = self.w_h.diff, self.w_o.diff, self.b_o.diff
        cont, da = bottom[1].data[:, :, None], top[0].diff * (1 - self.o**2)
        dw_o += flat(da).T @ flat(self.h)
        db_o += flat(da).sum(axis=0, dtype=np.float64)
        dh, dz = da @ w_o, np.empty_like(da)
        before = np.zeros_like(dh[0])
        for t in reversed(range(len(dz))):
            dz[t] = (dh[t] + before) * (1 - self.h[t] ** 2)
            dw_h += dz[t].T @ self.r[t]
            before = cont[t] * (dz[t] @ w_h)
        self._backward_z(dz, propagate_down, bottom)


def flat(array: Array) -> Array:
    """View of (T, N, D) as (T N, D)."""
    return array.reshape(-1, array.shape[2])
